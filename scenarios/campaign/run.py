"""Runs what a campaign still lacks, and writes every trial as it finishes."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import msgspec

from drivers.errors import GraspError
from scenarios.campaign.spec import CampaignSpec, Task, combinations, trials
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.worker import Finished, Row, error_row, run_trial
from scenarios.rigs.workers import Outcome, Workers, outcomes

CAMPAIGNS = Path("runs/campaigns")


class Progress(msgspec.Struct, frozen=True):
    """Where a campaign stands."""

    total: int
    done: int  # rows in the file, this call's and those of calls before
    new: int  # rows of this call
    successes: int  # among those of this call
    errors: int


OnProgress = Callable[[Progress], None]
Work = Callable[[Task], Finished]


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
    """Run the trials that the file lacks; those that errored before are run again.

    Raises ConfigError before anything runs, CouldNotRecord when a row cannot be written.
    KeyboardInterrupt passes through: every row that was reported is in the file.
    """
    places = combinations(spec)
    with CampaignStore.create(out, spec, places, resume) as store:
        every = list(trials(spec, places))
        had = store.finished()
        todo = [trial for trial in every if trial.number not in had]
        progress = Progress(len(every), len(had), 0, 0, 0)
        on_progress(progress)
        # closed at once when something goes wrong here: the workers must not outlive it
        with closing(outcomes(work, todo, workers)) as found:
            for outcome in found:
                row = store.add(outcome.result or Finished(_error_row(outcome)))
                progress = Progress(
                    total=progress.total,
                    done=progress.done + 1,
                    new=progress.new + 1,
                    successes=progress.successes + bool(row.success),
                    errors=progress.errors + (row.status == "error"),
                )
                on_progress(progress)
    return progress


def _error_row(outcome: Outcome[Task, Finished]) -> Row:
    error = outcome.error
    known = isinstance(error, GraspError)
    return error_row(outcome.task, str(error) if known else f"{type(error).__name__}: {error}")
