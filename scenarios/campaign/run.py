"""Runs the missing trials of a campaign, and stores each as it finishes."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import msgspec

from drivers.errors import GraspError
from scenarios.campaign.spec import CampaignSpec, Task, combinations, trials
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.worker import Row, error_row, remove_left_folders, run_trial
from scenarios.rigs.workers import Outcome, Workers, outcomes

CAMPAIGNS = Path("runs/campaigns")


class Progress(msgspec.Struct, frozen=True):
    """Progress of a campaign, in trials."""

    total: int
    done: int  # rows in the file
    new: int  # of these, rows of this call
    successes: int  # among the new ones
    errors: int


OnProgress = Callable[[Progress], None]
Work = Callable[[Task], tuple[Row, bytes | None]]


def default_path(spec: CampaignSpec) -> Path:
    return CAMPAIGNS / f"{spec.name}.sqlite"


def run(
    spec: CampaignSpec,
    out: Path,
    workers: Workers,
    resume: bool = False,
    on_progress: OnProgress = lambda progress: None,
    work: Work = run_trial,
) -> Progress:
    """Run the trials that the file lacks, and again those with an error.

    Raises ConfigError before anything runs, CouldNotRecord when a row cannot be written.
    KeyboardInterrupt passes through: every reported row is in the file.
    """
    grid = combinations(spec)
    remove_left_folders()
    with CampaignStore.create(out, spec, grid, resume) as store:
        tasks = list(trials(spec, grid))
        finished = store.finished()
        todo = [task for task in tasks if task.number not in finished]
        progress = Progress(len(tasks), len(finished), 0, 0, 0)
        on_progress(progress)
        # closed on any exception: the workers must not outlive this call
        with closing(outcomes(work, todo, workers)) as results:
            for outcome in results:
                row = store.add(*(outcome.result or (_error_row(outcome), None)))
                progress = Progress(
                    total=progress.total,
                    done=progress.done + 1,
                    new=progress.new + 1,
                    successes=progress.successes + bool(row.success),
                    errors=progress.errors + (row.status == "error"),
                )
                on_progress(progress)
    return progress


def _error_row(outcome: Outcome[Task, tuple[Row, bytes | None]]) -> Row:
    error = outcome.error
    known = isinstance(error, GraspError)
    return error_row(outcome.task, str(error) if known else f"{type(error).__name__}: {error}")
