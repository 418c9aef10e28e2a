"""Runs a series of trials of one experiment, with devices on one rig that stays open."""

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path

import msgspec

from drivers.errors import GraspError, Refused, Stale
from drivers.interfaces import Vector3
from grasp.control.controller import GraspController
from grasp.control.fault import IMPLAUSIBLE, INTERRUPTED
from grasp.run import signals
from grasp.run.clock import Clock
from grasp.run.loop import Tick
from scenarios.rigs.opening import open_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import GraspRig
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import OnTick, Watch
from scenarios.trial.final_state import state_between_trials
from scenarios.trial.operator_prompts import Operator, place_object
from scenarios.trial.result import Failure, FinishedRun, ResultT
from scenarios.world.truth import Truth

MAX_REPEATS = 3  # of the same trial
HOME_TOLERANCE_M = 0.005  # from here the arm may go to the first trial's home by itself; assumed

# runs and judges one trial: from seed, open rig and the arm's home to the result and the new home
Attempt = Callable[[int, GraspRig, Vector3 | None], tuple[FinishedRun[ResultT], Vector3]]
Series = Generator[FinishedRun[ResultT], None, None]


class RemainingTrials(msgspec.Struct, frozen=True):
    """The trials that a resumed series still lacks."""

    numbers: tuple[int, ...]  # of these trials, from 1
    of: int  # size of the whole series
    home: Vector3 | None = None  # where its trials begin; None: at the arm's current position


class TrialContext(msgspec.Struct, frozen=True):
    """Surroundings of trials: folder, pace, observers, operator and permission to move."""

    runs: Path | None = None  # parent of the trials' folders; None records nothing
    paced: bool = False
    on_tick: OnTick = lambda tick: None
    operator: Operator | None = None
    permit: MotionPermit | None = None
    remaining: RemainingTrials | None = None
    watch: Watch | None = None  # like on_tick, with truth and controller
    on_trial: Callable[[int, int], None] = lambda number, of: None  # before each: number, total
    on_open: Callable[[Clock], None] = lambda clock: None  # before each: the rig's clock
    placed: bool = False  # the first object is in place: the operator is not asked for it

    def look(self, tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        """Pass a tick to the observers."""
        self.on_tick(tick)
        if self.watch is not None:
            self.watch(tick, truth, controller)


def run_series(
    config: TrialConfig, seeds: Sequence[int], context: TrialContext, attempt: Attempt[ResultT]
) -> Series[ResultT]:
    """Run one trial per seed; ends after one with a failure.

    Every trial gets a new simulated rig, so that it depends on its own seed alone. Any other rig is
    opened once: its world loads the next object, or the operator places it, and every trial begins
    at the home of the first. With an operator, a trial with stale or implausible device data is
    repeated as long as the hand is open. A device error or a signal while an object is placed ends
    the series with a failure and no result. On hardware, a trial that leaves the hand closed ends
    the series with its verdict.

    Raises KeyboardInterrupt for a stop between two trials without an operator. Raises Refused where
    the arm is too far from the home in ``context.remaining``, or the hand on hardware is closed.
    """
    _ = config.memory_s  # raises for a detector that cannot be loaded, before a rig opens
    remaining = context.remaining or RemainingTrials(tuple(range(1, len(seeds) + 1)), len(seeds))
    with signals.deferred():
        if config.rig == "simulated":
            yield from _on_fresh_rigs(config, seeds, context, attempt, remaining)
            return
        with open_rig(config.built_for(seeds[0]), seeds[0], context.paced, context.permit) as rig:
            yield from _on_one_rig(config, seeds, rig, context, attempt, remaining)


def _on_one_rig(
    config: TrialConfig, seeds: Sequence[int], rig: GraspRig, context: TrialContext,
    attempt: Attempt[ResultT], remaining: RemainingTrials,
) -> Series[ResultT]:  # fmt: skip
    home, first, operator = remaining.home, True, context.operator
    _check_hand(rig)
    _check_home(rig, home)
    for seed, number in zip(seeds, remaining.numbers, strict=True):
        for prompt in _prompts(f"Trial {number} of {remaining.of}"):
            if operator is None:
                signals.check()
            if not first and rig.load is not None:
                rig.load(config.built_for(seed), seed)
            ended = None
            if operator is not None and not (first and context.placed):
                ended = _place_or_fail(config, rig, operator, prompt)
            if ended is not None:
                yield FinishedRun(None, ended)
                return
            context.on_trial(number, remaining.of)
            finished, new_home = attempt(seed, rig, home)
            first = False
            if finished.result is not None and finished.result.home_m is not None:
                home = new_home
            yield finished
            if finished.failure is None and (rig.load is not None or not leaves_closed(finished)):
                break
            if operator is None or not _may_be_repeated(finished):
                return
        else:
            return


def leaves_closed(finished: FinishedRun[ResultT]) -> bool:
    """Whether it has a verdict and ended in a safe state with a hand that is not open."""
    result = finished.result
    return result is not None and result.end is not None and not result.end.open


def _place_or_fail(
    config: TrialConfig, rig: GraspRig, operator: Operator, prompt: str
) -> Failure | None:
    """Let the operator place the object; the failure where a device error or a signal ended
    that."""
    try:
        signals.check()
        place_object(rig, operator, prompt)
    except GraspError as error:
        kind, message, remedy = error.kind, error.message, error.remedy
    except KeyboardInterrupt as stop:
        kind, remedy = INTERRUPTED, ""
        message = f"{signals.cause(stop)} before {prompt[0].lower()}{prompt[1:]}"
    else:
        return None
    gripper = None if rig.gripper is None else rig.gripper.state
    old_s = config.controller.stale_after_s
    end = state_between_trials(rig.arm.state, gripper, rig.clock.now_ns, old_s, rig.release_hint)
    return Failure(kind, message, remedy, end)


def _prompts(title: str) -> Iterator[str]:
    yield title
    for _ in range(MAX_REPEATS):
        yield f"{title} again, because device data was stale or implausible"


def _may_be_repeated(finished: FinishedRun[ResultT]) -> bool:
    """Whether stale or implausible data ended it, with a stationary arm and an open hand."""
    failure = finished.failure
    if failure is None or failure.kind not in (Stale.kind, IMPLAUSIBLE) or failure.end is None:
        return False
    return failure.end.open and not failure.end.unconfirmed


def _check_hand(rig: GraspRig) -> None:
    """Raises Refused where the hand is not open and no simulated world opens it."""
    gripper = None if rig.gripper is None else rig.gripper.state
    if rig.load is None and gripper is not None and not gripper.is_open:
        raise Refused(
            f"the hand is not open, at {gripper.positions} counts: it may hold something",
            rig.release_hint or "open it first",
        )


def _check_home(rig: GraspRig, home: Vector3 | None) -> None:
    """Raises Refused where the arm is not where the first trial began: it only returns there by
    itself at the end of a trial (``arm.workspace_low_m``)."""
    arm = rig.arm.state
    if home is None or arm is None or math.dist(arm.position_m, home) <= HOME_TOLERANCE_M:
        return
    x, y, z = (1e3 * there for there in home)
    raise Refused(
        f"the arm is {math.dist(arm.position_m, home) * 1e3:.0f} mm from where the first trial "
        f"began, x {x:.1f}, y {y:.1f}, z {z:.1f} mm",
        "move it back there with the hand open, or start a new series with another --out",
    )


def _on_fresh_rigs(
    config: TrialConfig,
    seeds: Sequence[int],
    context: TrialContext,
    attempt: Attempt[ResultT],
    remaining: RemainingTrials,
) -> Series[ResultT]:
    for seed, number in zip(seeds, remaining.numbers, strict=True):
        context.on_trial(number, remaining.of)
        with open_rig(config.built_for(seed), seed, context.paced) as rig:
            finished, _ = attempt(seed, rig, None)
        yield finished
        if finished.failure is not None:
            return
