"""Interface of the experiments lift and tap: configure, act, judge; runs one trial of them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from drivers.interfaces import Vector3
from grasp.control.controller import GraspController
from grasp.control.guard import ForceGuard
from grasp.run import signals
from grasp.run.clock import Clock
from grasp.run.loop import Tick
from scenarios.rigs.config import part
from scenarios.rigs.opening import open_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import GraspRig
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import FinishedTrial, OnTick, Watch, make_guard
from scenarios.trial.operator_prompts import Operator
from scenarios.trial.result import JudgedTrial, ResultT
from scenarios.trial.run_folder import Record, check_runs
from scenarios.world.truth import Truth

ConfigT = TypeVar("ConfigT", bound=TrialConfig)
TrialT = TypeVar("TrialT", bound=FinishedTrial)


class TrialContext(msgspec.Struct, frozen=True):
    """Surroundings of trials: folder, pace, observers, operator and permission to move."""

    runs: Path | None = None  # parent of the trials' folders; None records nothing
    paced: bool = False
    on_tick: OnTick = lambda tick: None
    operator: Operator | None = None
    permit: MotionPermit | None = None
    watch: Watch | None = None  # like on_tick, with truth and controller
    on_trial: Callable[[int, int], None] = lambda number, of: None  # before each: number, total
    on_open: Callable[[Clock], None] = lambda clock: None  # before each: the rig's clock
    placed: bool = False  # the first object is in place: the operator is not asked for it

    def look(self, tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        """Pass a tick to the observers."""
        self.on_tick(tick)
        if self.watch is not None:
            self.watch(tick, truth, controller)


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

    def prepare(self, config: ConfigT, seeds: Sequence[int], context: TrialContext) -> ConfigT:
        """The settings as its trials use them, after the checks that need no device. Raises
        ConfigError, UsageError and CouldNotRecord."""
        used = self.configure(config, seeds, context.operator)
        make_guard(used)
        check_runs(context.runs)
        _ = used.memory_s  # raises for a detector that cannot be loaded
        return used

    def run(
        self, config: ConfigT, seed: int, runs: Path | None, on_tick: OnTick = lambda tick: None
    ) -> JudgedTrial[ResultT]:
        """Run and judge one trial on a new rig. ``runs``: the parent of its folder; None records
        nothing.

        Raises ConfigError, CouldNotRecord and the drivers' errors for what goes wrong before the
        run begins; an error while running ends in the safe state and is reported in the result.
        """
        context = TrialContext(runs, on_tick=on_tick)
        return self.run_on_new_rig(self.prepare(config, (seed,), context), seed, context)

    def run_on_new_rig(
        self, used: ConfigT, seed: int, context: TrialContext
    ) -> JudgedTrial[ResultT]:
        """As ``run``, with settings from ``prepare``."""
        rig_settings = used.built_for(seed)
        with (
            signals.deferred(),
            open_rig(rig_settings, seed, context.paced, context.permit) as rig,
        ):
            return self.run_on(rig, used, seed, context)

    def run_on(
        self, rig: GraspRig, used: ConfigT, seed: int, context: TrialContext,
        home: Vector3 | None = None,
    ) -> JudgedTrial[ResultT]:  # fmt: skip
        """Run, record and judge one trial on an open rig, with settings from ``prepare`` and
        signals deferred. ``home``: the arm's home from an earlier trial on this rig."""
        context.on_open(rig.clock)
        with Record(used, self.name, seed, context.runs, rig.clock, context.look, home) as record:
            guard = make_guard(used)  # it remembers the grip of a trial
            trial = self.act(used, seed, rig, guard, record.tick, context.operator, home)
            return record.finish(trial, lambda: self.judge(used, seed, trial, record.path))
