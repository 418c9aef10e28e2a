"""The benchmark's lifts, in which a false alarm has a price.

Half of the lifts start with a grip that is too weak, half with a sufficient one, and a quarter of
the objects are fragile: those break at a multiple of the force that they need, so the hand responds
with `stop_and_step`. A lift is right if the object is held at the end, no slip of 2 mm or more
was missed, nothing was registered before slip began, and a fragile object is whole. Its quality
falls with the slip, to 0 at 20 mm.
"""

import math
from collections import deque

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings
from detector.interface import SlipDetector
from drivers.interfaces import FINGERS
from grasp.control.controller import GraspController
from grasp.run.loop import Tick
from scenarios.acquire.config import with_values
from scenarios.acquire.datasets.causes import PERMISSIVE
from scenarios.acquire.datasets.plan import part_of_job, random_parameters
from scenarios.acquire.datasets.random_objects import (
    MAX_TRIES,
    Range,
    first_grip_n,
    random_object,
)
from scenarios.benchmark.protocol import LiftRanges, SplitName, load_protocol
from scenarios.lift.config import LiftConfig
from scenarios.lift.lift import lift
from scenarios.lift.scoring import SUCCESSES, LiftOutcome, LiftResult
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig
from scenarios.rigs.simulated import cell_settings
from scenarios.trial.execution import make_guard, run_trial
from scenarios.world.contact import GRAVITY_MPS2
from scenarios.world.objects import GraspObject
from scenarios.world.settings import GROSS_SLIP_MPS, GROSS_TURN_RADPS
from scenarios.world.truth import Truth

MISSED_M = 0.002  # a slip of this that was never registered
TOO_FAR_M = 0.02  # a slip of this is too much, however it ended: lost contact also closes the hand
FRAGILE = {"controller.slip_response": "stop_and_step", "controller.margin_steps": 1}
RIGHT, TOO_EARLY, GROUNDLESS, MISSED, SLID, LOST, CRUSHED, STUCK, CHEATED, FAILED = (
    "right", "answered before slip", "answered without slip", "missed", "slid 20 mm", "lost",
    "crushed", "alarm stayed", "not a function of the counts", "fault or excess force",
)  # fmt: skip
ORACLE_RULE = RuleSettings(consecutive=1, release=1)


class LiftTask(msgspec.Struct, frozen=True):
    """One lift. ``oracle_s``: delay of an ideal detector that replaces the configured one; longer
    than a lift for one that never registers."""

    config: LiftConfig  # of the detector, with any object and hand
    seed: int
    number: int  # among the lifts of the split
    oracle_s: float | None = None
    checked: bool = False  # repeat the detector on the counts alone


class LiftRow(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one lift. ``delay_ms``: from the onset of slip to its registration, infinite if
    missed; None without slip."""

    cause: str  # RIGHT, or what went wrong
    delay_ms: float | None
    slip_mm: float | None

    @property
    def quality(self) -> float:
        """From 0 to 1."""
        slip_mm = self.slip_mm or 0.0
        return max(0.0, 1.0 - 1e-3 * slip_mm / TOO_FAR_M) if self.cause == RIGHT else 0.0


class Grip(msgspec.Struct, frozen=True):
    """An object with its first grip, and the forces at the thumb that hold and that crush it."""

    body: GraspObject
    least_n: float
    crush_n: float


class Oracle:
    """Registers slip when the simulated object slips, a fixed delay later."""

    name, threshold, memory = "oracle", 0.5, 1

    def __init__(self, rig: GraspRig, delay_samples: int) -> None:
        self._rig, self._delay = rig, delay_samples
        self.reset()

    def reset(self) -> None:
        self._past = deque([False] * self._delay)

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        truth = self._rig.truth()
        self._past.append(truth is not None and _slips(truth))
        return np.full(FINGERS, float(self._past.popleft()))


def _slips(truth: Truth) -> bool:
    turns = abs(truth.turn_speed_radps) > GROSS_TURN_RADPS
    return turns or abs(truth.slip_speed_mps) > GROSS_SLIP_MPS


class RepeatableDetector:
    """A detector whose inputs and outputs are kept, to repeat them without a simulation."""

    def __init__(self, detector: SlipDetector) -> None:
        self._detector = detector
        self.name, self.threshold, self.memory = (
            detector.name, detector.threshold, detector.memory
        )  # fmt: skip
        self._calls: list[tuple[NDArray[np.int16], NDArray[np.float64]] | None] = []

    def reset(self) -> None:
        self._calls.append(None)
        self._detector.reset()

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        output = self._detector.update(counts)
        self._calls.append((counts.copy(), output.copy()))
        return output

    def repeats(self, fresh: SlipDetector) -> bool:
        """Whether another instance gives the same outputs for the same counts."""
        for call in self._calls:
            if call is None:
                fresh.reset()
            elif not np.array_equal(fresh.update(call[0]), call[1], equal_nan=True):
                return False
        return True


def is_weak(number: int) -> bool:
    return number % 2 == 0


def is_fragile(number: int) -> bool:
    return number % 8 < 2


def run_lift(task: LiftTask) -> LiftRow:
    """Run and judge one lift."""
    number = task.number
    config, grip = sampled(task.config, task.seed, number)
    forces: list[float] = []

    def watch(tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        if truth is not None:
            forces.append(truth.normal_n[0])

    with open_rig(config.built_for(task.seed), task.seed, paced=False) as rig:
        detector: Oracle | RepeatableDetector
        if task.oracle_s is not None:
            detector = Oracle(rig, round(task.oracle_s / config.loop.period_s))
        else:
            detector = RepeatableDetector(config.make_detector(FINGERS))
        trial = run_trial(config, rig, make_guard(config), watch, detector=detector)
    result = lift.judge(config, task.seed, trial, None)
    cause = verdict(result, grip, is_fragile(number), max(forces, default=0.0))
    honest = not (task.checked and isinstance(detector, RepeatableDetector)) or detector.repeats(
        config.make_detector(FINGERS)
    )
    return LiftRow(
        cause=cause if honest else CHEATED, delay_ms=_delay_ms(result, cause),
        slip_mm=None if result.slip_distance_m is None else 1e3 * result.slip_distance_m,
    )  # fmt: skip


def verdict(result: LiftResult, grip: Grip, fragile: bool, peak_n: float) -> str:
    """RIGHT, or the first thing that went wrong."""
    outcome = result.outcome
    if outcome == LiftOutcome.FALSE_START:
        return GROUNDLESS if result.slip_onset_s is None else TOO_EARLY
    slip_m = result.slip_distance_m or 0.0
    if slip_m >= MISSED_M and result.slip_registered_s is None:
        return MISSED  # also where the hand closed because it had lost contact
    if fragile and peak_n > grip.crush_n:
        return CRUSHED
    if outcome in SUCCESSES or outcome in (LiftOutcome.NEVER_SLIPPED, LiftOutcome.BEYOND_12CM):
        return RIGHT if slip_m < TOO_FAR_M else SLID
    if outcome == LiftOutcome.UNDETECTED:
        return RIGHT
    if outcome in (LiftOutcome.DROPPED, LiftOutcome.EXPELLED):
        return MISSED if result.slip_registered_s is None else LOST
    if outcome in (LiftOutcome.LIMIT_REACHED, LiftOutcome.ALARM_STAYED):
        return STUCK
    return FAILED


def _delay_ms(result: LiftResult, cause: str) -> float | None:
    """Delay of the registration; 0 if it came just before gross slip."""
    onset_s, registered_s = result.slip_onset_s, result.slip_registered_s
    if cause in (TOO_EARLY, GROUNDLESS) or (onset_s is None and registered_s is None):
        return None
    if registered_s is None:
        small = (result.slip_distance_m or 0.0) < MISSED_M
        return None if small and cause == RIGHT else math.inf
    return 0.0 if onset_s is None else max(0.0, 1e3 * (registered_s - onset_s))


def sampled(config: LiftConfig, seed: int, number: int) -> tuple[LiftConfig, Grip]:
    """Settings of the lift with its own object and hand, which follow from the seed."""
    ranges, replace = load_protocol().lifts, msgspec.structs.replace
    rng = np.random.default_rng([seed, 47])
    shape = ranges.shapes[int(rng.integers(len(ranges.shapes)))]
    fixed = {**PERMISSIVE, "controller.keep": True, **(FRAGILE if is_fragile(number) else {})}
    fixed |= _fingertips(ranges.hands, seed, number)
    config = with_values(config, fixed)
    hand = replace(
        config.hand, command_latency_s=rng.uniform(*ranges.latency_s),
        debounce_s=rng.uniform(*ranges.debounce_s), tip_mass_kg=rng.uniform(*ranges.tip_mass_kg),
    )  # fmt: skip
    config = replace(config, hand=hand)
    load = ranges.weak if is_weak(number) else ranges.sufficient
    for _ in range(MAX_TRIES):
        config = replace(config, object=random_object(shape, load, config, rng))
        grip = _grip(config, seed, ranges)
        fits = grip.least_n <= ranges.holdable * config.guard.force_limit_n
        if fits and (grip.crush_n <= ranges.crush_n or not is_fragile(number)):
            return config, grip
    raise RuntimeError(f"no object found for the lift with seed {seed}")


def _fingertips(hands: str, seed: int, number: int) -> dict[str, float]:
    protocol = load_protocol()
    dataset = protocol.dataset(hands, "test")  # ranges only: its seed is not used
    part = part_of_job(dataset.parts, number)
    ranges: dict[str, Range] = dataset.randomise | part.randomise
    return random_parameters(ranges, seed)


def _grip(config: LiftConfig, seed: int, ranges: LiftRanges) -> Grip:
    body = cell_settings(config, seed)[0].body
    accelerated = GRAVITY_MPS2 + config.controller.lift_acceleration_mps2
    least_n = body.total_kg * accelerated / (2.0 * body.friction_kinetic)
    return Grip(body, least_n, ranges.crush * max(least_n, first_grip_n(config)[0]))


def tasks(config: LiftConfig, split: SplitName, checked: int) -> list[LiftTask]:
    """All lifts of a split; the first ``checked`` repeat the detector on the counts alone."""
    return [
        LiftTask(config, seed, number, checked=number < checked)
        for number, seed in enumerate(load_protocol().lift_seeds(split))
    ]
