"""Interface of the experiments lift and tap: configure, act on a rig, judge."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Generic, TypeVar

from drivers.interfaces import Vector3
from grasp.control.guard import ForceGuard
from scenarios.rigs.config import part
from scenarios.rigs.rig import GraspRig
from scenarios.trial import series
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import FinishedTrial, OnTick, Watch, make_guard
from scenarios.trial.operator_prompts import Operator
from scenarios.trial.result import FinishedRun, ResultT
from scenarios.trial.run_folder import Record, check_runs
from scenarios.trial.series import Series, TrialContext

ConfigT = TypeVar("ConfigT", bound=TrialConfig)
TrialT = TypeVar("TrialT", bound=FinishedTrial)


class Experiment(ABC, Generic[ConfigT, TrialT, ResultT]):
    """One kind of trial. Subclasses define ``configure``, ``act`` and ``judge``."""

    name: str
    settings: type[ConfigT]

    def select(self, config: TrialConfig) -> ConfigT:
        """The settings of this experiment, without sections of other experiments."""
        return part(config, self.settings)

    @abstractmethod
    def configure(
        self, config: ConfigT, seeds: Sequence[int] = (), operator: Operator | None = None
    ) -> ConfigT:
        """The settings as trials with those seeds use them. Raises ConfigError for an experiment
        that is impossible with them."""

    @abstractmethod
    def act(
        self, config: ConfigT, seed: int, rig: GraspRig, guard: ForceGuard, watch: Watch,
        operator: Operator | None = None, home: Vector3 | None = None,
    ) -> TrialT:  # fmt: skip
        """Run one trial on an open rig, with ``config`` from ``configure``. On hardware an operator
        replaces the simulated world. Ctrl-C stops the arm and keeps the grip."""

    @abstractmethod
    def judge(self, config: ConfigT, seed: int, trial: TrialT, recording: str | None) -> ResultT:
        """Verdict and figures of a finished trial."""

    def run(
        self, config: ConfigT, seed: int, runs: Path | None, on_tick: OnTick = lambda tick: None
    ) -> FinishedRun[ResultT]:
        """Run and judge one trial on a new rig. ``runs``: the parent of its folder; None records
        nothing.

        Raises ConfigError, CouldNotRecord and the drivers' errors for what goes wrong before the
        run begins; an error while running ends in the safe state and is reported in the result.
        """
        return next(self.run_series(config, (seed,), TrialContext(runs, on_tick=on_tick)))

    def run_series(
        self, config: ConfigT, seeds: Sequence[int], context: TrialContext
    ) -> Series[ResultT]:
        """Run and judge one trial per seed, each with its own folder
        (``scenarios.trial.series``)."""
        used = self.configure(config, seeds, context.operator)
        make_guard(used)  # raises before any trial
        check_runs(context.runs)

        def attempt(
            seed: int, rig: GraspRig, home: Vector3 | None
        ) -> tuple[FinishedRun[ResultT], Vector3]:
            context.on_open(rig.clock)
            with Record(
                used, self.name, seed, context.runs, rig.clock, context.look, home
            ) as record:
                guard = make_guard(used)  # it remembers the grip of a trial
                trial = self.act(used, seed, rig, guard, record.tick, context.operator, home)
                finished = record.finish(trial, lambda: self.judge(used, seed, trial, record.path))
                return finished, trial.controller.home

        return series.run_series(used, seeds, context, attempt)
