"""Runs a series of trials on one rig, on hardware with an operator, and stores it as a campaign.

Rows, file and summary are those of a campaign. A campaign runs unattended in worker processes and
never on real devices; a series runs in one process on any rig.
"""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

import msgspec

from drivers.interfaces import Vector3
from grasp.control.fault import INTERRUPTED, SAFETY_STOP
from scenarios.campaign.experiments import EXPERIMENTS
from scenarios.campaign.spec import CampaignSpec, Combination, Task
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.worker import Row, cost_columns, error_row, judged_row
from scenarios.trial.config import TrialConfig
from scenarios.trial.experiment import TrialContext
from scenarios.trial.result import JudgedTrial
from scenarios.trial.series import run_series


class TrialSeries(msgspec.Struct, frozen=True):
    """One experiment with fixed settings, repeated with consecutive seeds."""

    scenario: Literal["lift", "tap"]
    config: TrialConfig
    seed: int  # of the first trial
    trials: int

    def spec(self) -> CampaignSpec:
        """Specification for its file. Settings are compared by their hash only, so that an address
        may change before the series is resumed."""
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
                set_down=not self.config.controller.keep,
            )
            for number in range(self.trials)
        ]  # fmt: skip

    def store(self, out: Path, resume: bool) -> CampaignStore:
        """Create its file, or open it to resume; raises as ``CampaignStore.create``."""
        grid = [Combination(self.scenario, {}, self.config)]
        return CampaignStore.create(out, self.spec(), grid, resume)

    def run(
        self, context: TrialContext, store: CampaignStore | None
    ) -> Iterator[tuple[JudgedTrial[Any], Row | None]]:
        """Run the trials that the store lacks; yields each with its row, which is already stored.

        Ends after one with a failure. An interrupted trial has no row, and a device error makes an
        error row: both are run again on resumption, or at once as in ``scenarios.trial.series``.
        Raises as ``scenarios.trial.series``, and CouldNotRecord.
        """
        rows = [] if store is None else store.rows()
        stored = {row.trial for row in rows if row.status == "done"}
        todo = {task.seed: task for task in self.tasks() if task.number not in stored}
        if not todo:
            return
        numbers = [task.number + 1 for task in todo.values()]
        wall, cpu = time.perf_counter(), time.process_time()
        experiment, seeds = EXPERIMENTS[self.scenario], list(todo)
        with closing(
            run_series(experiment, self.config, seeds, context, numbers, self.trials, home_of(rows))
        ) as series:
            for judged in series:
                result = judged.result  # None: the trial did not begin
                row = None if result is None else row_of(todo[result.seed], judged)
                if result is not None and row is not None:
                    row = msgspec.structs.replace(row, **cost_columns(wall, cpu))
                    if store is not None:
                        row = store.add(_with_recording(row, result.recording, store.path))
                yield judged, row
                wall, cpu = time.perf_counter(), time.process_time()


def _with_recording(row: Row, recording: str | None, file: Path) -> Row:
    """The row with the path of the recording relative to the series' file."""
    shown = None if recording is None else os.path.relpath(recording, file.parent)
    return msgspec.structs.replace(row, recording=shown)


def home_of(rows: Sequence[Row]) -> Vector3 | None:
    """The arm's home of the stored trials; None where no trial has one."""
    homes = (msgspec.json.decode(row.result).get("home_m") for row in rows if row.result)
    return next((msgspec.convert(home, Vector3) for home in homes if home is not None), None)


def row_of(task: Task, judged: JudgedTrial[Any]) -> Row | None:
    """The row of a trial; None for an interrupted one, an error row for one that a device error
    ended or that ended before it took a home."""
    failure, result = judged.failure, judged.result
    if result is None or (failure is not None and failure.kind == INTERRUPTED):
        return None
    # a safety stop is a verdict: no device failed
    if failure is not None and (failure.kind != SAFETY_STOP or result.home_m is None):
        return error_row(task, failure.message, result)
    return judged_row(task, result, failure)
