"""What lift and tap have in common: an experiment is configured, acts on a rig, and is judged."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Generic, TypeVar

from drivers.interfaces import Vector3
from grasp.guard import ForceGuard
from scenarios.rigs.config import part
from scenarios.rigs.rig import GraspRig
from scenarios.trial import series
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import FinishedTrial, OnTick, Watch, make_guard
from scenarios.trial.person import Operator
from scenarios.trial.result import FinishedRun, ResultT
from scenarios.trial.run_folder import Record, check_runs
from scenarios.trial.series import Bench, Series

ConfigT = TypeVar("ConfigT", bound=TrialConfig)
TrialT = TypeVar("TrialT", bound=FinishedTrial)


class Experiment(ABC, Generic[ConfigT, TrialT, ResultT]):
    """One kind of trial."""

    name: str
    settings: type[ConfigT]

    def own(self, config: TrialConfig) -> ConfigT:
        """The sections of this experiment, of settings that may have those of others too."""
        return part(config, self.settings)

    @abstractmethod
    def configure(
        self, config: ConfigT, seeds: Sequence[int] = (), operator: Operator | None = None
    ) -> ConfigT:
        """The settings as trials with those seeds use them. Raises ConfigError for what cannot be
        tried."""

    @abstractmethod
    def act(
        self, config: ConfigT, seed: int, rig: GraspRig, guard: ForceGuard, watch: Watch,
        operator: Operator | None = None, home: Vector3 | None = None,
    ) -> TrialT:  # fmt: skip
        """One trial on an open rig, ``config`` from ``configure``; an operator helps where no world
        does. Ctrl-C stops the arm and keeps the grip."""

    @abstractmethod
    def judge(self, config: ConfigT, seed: int, trial: TrialT, recording: str | None) -> ResultT:
        """Verdict and figures of a finished trial."""

    def run(
        self, config: ConfigT, seed: int, runs: Path | None, on_tick: OnTick = lambda tick: None
    ) -> FinishedRun[ResultT]:
        """One judged trial on a rig of its own. With ``runs`` it leaves a folder there; None
        records nothing.

        Raises ConfigError, CouldNotRecord and the drivers' errors for what goes wrong before the
        run begins; an error while running ends in the safe state and is reported in the result.
        """
        return next(self.run_series(config, (seed,), Bench(runs, on_tick=on_tick)))

    def run_series(self, config: ConfigT, seeds: Sequence[int], bench: Bench) -> Series[ResultT]:
        """One judged trial a seed, as ``scenarios.trial.series`` runs them, each recorded in a
        folder of its own."""
        used = self.configure(config, seeds, bench.operator)
        guard = make_guard(used)
        check_runs(bench.runs)

        def attempt(
            seed: int, rig: GraspRig, home: Vector3 | None
        ) -> tuple[FinishedRun[ResultT], Vector3]:
            with Record(used, self.name, seed, bench.runs, rig.clock, bench.look, home) as record:
                trial = self.act(used, seed, rig, guard, record.tick, bench.operator, home)
                finished = record.finish(trial, lambda: self.judge(used, seed, trial, record.path))
                return finished, trial.controller.home

        return series.run_series(used, seeds, bench, attempt)
