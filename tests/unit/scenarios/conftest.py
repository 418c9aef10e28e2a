"""Lifts on the simulated rig, in virtual time."""

from collections.abc import Callable
from functools import cache
from typing import Any

import msgspec
import pytest

from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.campaign.config import load_config
from scenarios.lift.config import LiftConfig
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftResult
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig, Rig
from scenarios.trial.execution import FinishedTrial, make_guard, run_trial
from tests.unit.scenarios import checkpoint

AnyRig = Rig[Any, Any]
QUIET = "fingertip.holding_share=0.1"  # low enough that EAGER has no false alarm
EAGER = "energy.threshold_counts=3"  # a detector that detects slip at once

# A rigid fingertip of the paper's data set, for tests of rare events whose seeds depend on it
RIGID = tuple(
    f"fingertip.{name}={value}"
    for name, value in {
        "depth_mm": 3.23, "crown_radius_mm": 65.8, "tilt_rad": 0.0854, "spring_mm": 2.0,
        "foundation_n_per_mm3": 0.223, "relaxation_share": 0.1, "relaxation_slow_share": 0.0,
        "relaxation_s": 0.2, "wander_mm": 0.0372, "wander_fast_s": 0.0323, "wander_slow_s": 0.212,
        "vibration_mm": 0.00831, "vibration_hz": 18.7, "vibration_damping": 0.08, "shift_mm": 0.0,
        "rock_rad": 0.0, "noise_counts": 0.3, "lever_x": 0.0, "slip_direction_deg": 0.0,
        "holding_share": 0.2,
    }.items()
)  # fmt: skip


def by_default(*assignments: str, object_name: str = "can") -> LiftConfig:
    """Packaged settings of a lift, with the default detector."""
    return load_config(object_name, "simulated", None, None, assignments).for_lift()


def config(*assignments: str, object_name: str = "can") -> LiftConfig:
    """Settings of a lift in which `energy` detects slip at once, for tests of the response to slip
    at a known time. Tests of the force limit, faults, taps and rigs use ``by_default``."""
    values = (QUIET, EAGER, *assignments)
    return load_config(object_name, "simulated", "energy", None, values).for_lift()


@cache
def judged(*assignments: str, seed: int = 0, object_name: str = "can") -> LiftResult:
    result = lift.run(config(*assignments, object_name=object_name), seed, None).result
    assert result is not None
    return result


class InPhase:
    """True from the given number of ticks into a phase on."""

    def __init__(self, phase: State, after_ticks: int = 10) -> None:
        self.phase, self._after, self.ticks = phase, after_ticks, 0

    def __call__(self, tick: Tick) -> bool:
        self.ticks += tick.decision.state is self.phase
        return self.ticks > self._after

    @property
    def at_first(self) -> bool:
        return self._after == 0


in_phase = InPhase


class Staged:
    """One lift with an action on the rig at the first tick that meets a condition.

    For a condition on a phase, the lift continues from a checkpoint of that phase, if there is one.
    """

    def __init__(
        self, *assignments: str, seed: int = 0, made: Callable[..., LiftConfig] = config
    ) -> None:
        self.config = made(*assignments)
        self.seed = seed
        self.ticks: list[Tick] = []
        self.done_at_ns: int | None = None
        self.loop: Any = None
        self.on_tick: Callable[[Tick], None] = lambda tick: None
        self._kept = checkpoint.kept(self.config.digest(), seed)

    def run(self, when: Callable[[Tick], bool], act: Callable[[AnyRig], None]) -> FinishedTrial:
        if isinstance(when, InPhase) and not when.at_first and when.phase in self._kept:
            parts, ticks = self._kept[when.phase]
            self.ticks, when.ticks = [*ticks], 1
            parts = checkpoint.copied(parts)
            self.loop = parts[1]
            with checkpoint.resumed(parts) as rig:
                return self._run(rig, when, act)
        with (
            open_rig(self.config, self.seed, paced=False) as rig,
            checkpoint.parts_of(rig) as parts_now,
        ):

            def keep(tick: Tick) -> None:
                self.loop = parts_now()[1]
                phase = tick.decision.state
                if self.done_at_ns is None and phase not in self._kept:
                    self._kept[phase] = checkpoint.copied(parts_now()), [*self.ticks]

            return self._run(rig, when, act, keep if isinstance(when, InPhase) else None)

    def _run(
        self, rig: GraspRig, when: Callable[[Tick], bool], act: Callable[[AnyRig], None],
        keep: Callable[[Tick], None] | None = None,
    ) -> FinishedTrial:  # fmt: skip
        self.rig = rig

        def watch(tick: Tick, truth: Any, controller: Any) -> None:
            self.ticks.append(tick)
            self.on_tick(tick)
            if keep is not None:
                keep(tick)
            if self.done_at_ns is None and when(tick):
                self.done_at_ns = tick.t_ns
                act(rig)

        return run_trial(self.config, rig, make_guard(self.config), watch)

    def result(self, trial: FinishedTrial) -> LiftResult:
        return lift.judge(self.config, self.seed, trial, None)


HAND_ALONE = "controller.slip_response=close"  # the arm does not stop
ONE_SPEED = "controller.closing=constant"


def phases_without_feel(result: Any) -> list[str]:
    """Phases of a run without `lower.feel`, which may occur any number of times."""
    return [p.phase for p in result.phases if p.phase != "lower.feel"]


def well_in(phase: State) -> Callable[[Tick], bool]:
    """Some ticks into a phase; in the lift after its pauses."""
    return in_phase(phase, 40 if phase is State.LIFT else 5)


@pytest.fixture(scope="session")
def plain_lift() -> LiftResult:
    return judged()


def changed(config: LiftConfig, section: str, **values: Any) -> LiftConfig:
    part = msgspec.structs.replace(getattr(config, section), **values)
    return msgspec.structs.replace(config, **{section: part})
