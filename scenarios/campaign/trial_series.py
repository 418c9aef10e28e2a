"""Trials on one open rig, with a person's help where no world helps; kept as a campaign's are.

The same rows, store and Table IV. A campaign runs in workers, where nobody watches, and stays off
real devices; this runs in one process, and is how they get their rows.
"""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Literal

import msgspec

from drivers.interfaces import Vector3
from scenarios.campaign.config import EXPERIMENTS
from scenarios.campaign.spec import CampaignSpec, Combination, Task
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.worker import AnyRun, Finished, Row, error_row, judged, spent
from scenarios.trial.config import TrialConfig
from scenarios.trial.series import Begun, Bench

INTERRUPTED = "interrupted"  # a failure's kind: no row, the trial is run again
JUDGED = "safety_stop"  # a failure's kind: the trial itself ended so; no device was to blame


class TrialSeries(msgspec.Struct, frozen=True):
    """One experiment with one set of settings, so many times, with seeds one after the other."""

    scenario: Literal["lift", "tap"]
    config: TrialConfig
    seed: int  # of the first
    trials: int

    def spec(self) -> CampaignSpec:
        """As its file states it. Settings are compared by their hash alone, so that an address may
        change before the series is resumed."""
        config = self.config
        return CampaignSpec(
            name=f"{config.rig}-{self.scenario}-{config.object.name}-{self.seed}",
            scenarios=(self.scenario,),
            objects=(config.object.name,),
            profiles=(config.profile,),
            detectors=(config.detector_name,),
            repetitions=self.trials,
            recordings="all",
        )

    def tasks(self) -> list[Task]:
        return [
            Task(
                number=number, scenario=self.scenario, repetition=number, seed=self.seed + number,
                swept={}, config=self.config, recordings="all",
            )
            for number in range(self.trials)
        ]  # fmt: skip

    def store(self, out: Path, resume: bool) -> CampaignStore:
        """Its file, to go on with or a new one; raises what ``CampaignStore.create`` raises."""
        places = [Combination(self.scenario, {}, self.config)]
        return CampaignStore.create(out, self.spec(), places, resume)


def run(
    trials: TrialSeries, bench: Bench, store: CampaignStore | None
) -> Iterator[tuple[AnyRun, Row | None]]:
    """The trials that the store lacks, each with its row, which is written before the next begins.

    Ends after one that failed as a run. One that was interrupted or never began has no row, one
    that a device ended has a row that says so: they are run again on resumption, or at once,
    as ``scenarios.trial.series`` says. Raises what ``scenarios.trial.series`` raises, and
    CouldNotRecord.
    """
    rows = [] if store is None else store.rows()
    had = {row.trial for row in rows if row.status == "done"}
    todo = {task.seed: task for task in trials.tasks() if task.number not in had}
    if not todo:
        return
    begun = Begun(tuple(task.number + 1 for task in todo.values()), trials.trials, home_of(rows))
    wall, cpu = time.perf_counter(), time.process_time()
    bench = msgspec.structs.replace(bench, begun=begun)
    experiment = EXPERIMENTS[trials.scenario]
    with closing(experiment.run_series(trials.config, list(todo), bench)) as series:
        for finished in series:
            result = finished.result  # none: it never began
            row = None if result is None else row_of(todo[result.seed], finished)
            if row is not None:
                row = msgspec.structs.replace(row, **spent(wall, cpu))
                if store is not None:
                    left = None if result is None else result.recording  # where the run left it
                    if left is not None:
                        left = os.path.relpath(left, store.path.parent)
                    row = store.add(Finished(msgspec.structs.replace(row, recording=left)))
            yield finished, row
            wall, cpu = time.perf_counter(), time.process_time()


def home_of(rows: Sequence[Row]) -> Vector3 | None:
    """Of the arm, that the trials up to now began from; None where none of them has one."""
    homes = (msgspec.json.decode(row.result).get("home_m") for row in rows if row.result)
    return next((msgspec.convert(home, Vector3) for home in homes if home is not None), None)


def row_of(task: Task, finished: AnyRun) -> Row | None:
    """Its row; None for a trial that was interrupted. One that ended before it had taken a home
    tried nothing: it does not count."""
    failure, result = finished.failure, finished.result
    if result is None or (failure is not None and failure.kind == INTERRUPTED):
        return None
    if failure is not None and (failure.kind != JUDGED or result.home_m is None):
        return error_row(task, failure.message, result)
    return judged(task, result, failure)
