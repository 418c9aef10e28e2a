"""Trials of one scenario, one after the other: on one open rig where there are real wires."""

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path

import msgspec

from drivers.errors import GraspError, Refused, Stale
from drivers.interfaces import Vector3
from grasp import signals
from grasp.controller import GraspController
from grasp.fault import IMPLAUSIBLE, INTERRUPTED
from grasp.loop import Tick
from scenarios.rigs.opening import open_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import GraspRig
from scenarios.trial.config import TrialConfig
from scenarios.trial.ending import between_trials
from scenarios.trial.execution import OnTick, Watch
from scenarios.trial.person import Operator, place_object
from scenarios.trial.result import Failure, FinishedRun, ResultT
from scenarios.world.truth import Truth

MOST_AGAIN = 3  # times that a person is asked for the same trial anew
NEAR_M = 0.005  # from there the arm goes to the first trial's home by itself; assumed

# one judged trial: its seed, an open rig and the arm's home in; what it left and that home out
Attempt = Callable[[int, GraspRig, Vector3 | None], tuple[FinishedRun[ResultT], Vector3]]
Series = Generator[FinishedRun[ResultT], None, None]


class Begun(msgspec.Struct, frozen=True):
    """What is known of a series that is gone on with."""

    numbers: tuple[int, ...]  # of the trials that are left, from 1
    of: int  # all of them
    home: Vector3 | None = None  # that its trials begin from; None: where the arm stands


class Bench(msgspec.Struct, frozen=True):
    """Where trials are recorded, at which pace they go, who watches or helps, and who allows it."""

    runs: Path | None = None  # each leaves a folder of its own there; None records nothing
    paced: bool = False
    on_tick: OnTick = lambda tick: None
    operator: Operator | None = None
    permit: MotionPermit | None = None
    begun: Begun | None = None
    watch: Watch | None = None  # as on_tick, but shown the truth and the controller too
    on_trial: Callable[[int, int], None] = lambda number, of: None  # before each: which, of all
    placed: bool = False  # the object of the first trial is in place: nobody is asked for it

    def look(self, tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        """Let whoever watches see a tick."""
        self.on_tick(tick)
        if self.watch is not None:
            self.watch(tick, truth, controller)


def run_series(
    config: TrialConfig, seeds: Sequence[int], bench: Bench, attempt: Attempt[ResultT]
) -> Series[ResultT]:
    """One trial a seed. Ends after one that failed as a run; raises KeyboardInterrupt when it is
    stopped between two and nobody is asked for objects, and Refused where the arm stands too far
    from the home in ``begun``, or the hand of a rig without a world is closed.

    The simulated rig is opened anew for each, so that a trial depends on its own seed alone. A
    wired one is opened once: its world loads the next object, or a person puts it back, and every
    trial begins from the home that the first one took. With a person there, a trial in which a
    device was not heard or not believed is asked for again, as long as the hand is open; a device
    that goes while an object is put in place, or a signal then, ends the series with a failure and
    no result. So does, with its verdict, a trial that leaves such a rig's hand closed (an object
    that was lost).
    """
    _ = config.memory_s  # a detector that cannot be loaded is told before anything is opened
    begun = bench.begun or Begun(tuple(range(1, len(seeds) + 1)), len(seeds))
    with signals.deferred():
        if config.rig == "simulated":
            yield from _anew(config, seeds, bench, attempt, begun)
            return
        with open_rig(config.built_for(seeds[0]), seeds[0], bench.paced, bench.permit) as rig:
            yield from _on_one_rig(config, seeds, rig, bench, attempt, begun)


def _on_one_rig(
    config: TrialConfig, seeds: Sequence[int], rig: GraspRig, bench: Bench,
    attempt: Attempt[ResultT], begun: Begun,
) -> Series[ResultT]:  # fmt: skip
    home, first, operator = begun.home, True, bench.operator
    _check_hand(rig)
    _check_home(rig, home)
    for seed, number in zip(seeds, begun.numbers, strict=True):
        for words in _times(f"Trial {number} of {begun.of}"):
            if operator is None:
                signals.check()
            if not first and rig.load is not None:
                rig.load(config.built_for(seed), seed)
            ended = None
            if operator is not None and not (first and bench.placed):
                ended = _ended_while_placed(config, rig, operator, words)
            if ended is not None:
                yield FinishedRun(None, ended)
                return
            bench.on_trial(number, begun.of)
            finished, found = attempt(seed, rig, home)
            first = False
            if finished.result is not None and finished.result.home_m is not None:
                home = found
            yield finished
            if finished.failure is None and (rig.load is not None or not leaves_closed(finished)):
                break
            if operator is None or not _may_be_repeated(finished):
                return
        else:
            return


def leaves_closed(finished: FinishedRun[ResultT]) -> bool:
    """Whether it was judged and has ended in a safe state with a hand that is not open."""
    result = finished.result
    return result is not None and result.end is not None and not result.end.open


def _ended_while_placed(
    config: TrialConfig, rig: GraspRig, operator: Operator, words: str
) -> Failure | None:
    """Have the object put in place; why that ended otherwise, a device that went or a signal, and
    how arm and hand were left."""
    try:
        signals.check()
        place_object(rig, operator, words)
    except GraspError as error:
        kind, message, remedy = error.kind, error.message, error.remedy
    except KeyboardInterrupt as stop:
        kind, remedy = INTERRUPTED, ""
        message = f"{signals.cause(stop)} before {words[0].lower()}{words[1:]}"
    else:
        return None
    gripper = None if rig.gripper is None else rig.gripper.state
    old_s = config.controller.stale_after_s
    end = between_trials(rig.arm.state, gripper, rig.clock.now_ns, old_s, rig.release_hint)
    return Failure(kind, message, remedy, end)


def _times(title: str) -> Iterator[str]:
    yield title
    for _ in range(MOST_AGAIN):
        yield f"{title} again, for a device was not heard or not believed"


def _may_be_repeated(finished: FinishedRun[ResultT]) -> bool:
    """Whether it was no trial, and has left an arm that stands and a hand that is open."""
    failure = finished.failure
    if failure is None or failure.kind not in (Stale.kind, IMPLAUSIBLE) or failure.end is None:
        return False
    return failure.end.open and not failure.end.unconfirmed


def _check_hand(rig: GraspRig) -> None:
    """Raises Refused where the hand is not open and no world opens it: nothing is tried then."""
    gripper = None if rig.gripper is None else rig.gripper.state
    if rig.load is None and gripper is not None and not gripper.is_open:
        raise Refused(
            f"the hand is not open, at {gripper.positions} counts: it may hold something",
            rig.release_hint or "open it first",
        )


def _check_home(rig: GraspRig, home: Vector3 | None) -> None:
    """Raises Refused where the arm is not where the first trial began: it goes there by itself from
    the top of its own lifts alone (``arm.workspace_low_m``)."""
    arm = rig.arm.state
    if home is None or arm is None or math.dist(arm.position_m, home) <= NEAR_M:
        return
    x, y, z = (1e3 * there for there in home)
    raise Refused(
        f"the arm stands {math.dist(arm.position_m, home) * 1e3:.0f} mm from where the first trial "
        f"began, x {x:.1f}, y {y:.1f}, z {z:.1f} mm",
        "bring it back there with the hand open, or begin another series with another --out",
    )


def _anew(
    config: TrialConfig, seeds: Sequence[int], bench: Bench, attempt: Attempt[ResultT], begun: Begun
) -> Series[ResultT]:
    for seed, number in zip(seeds, begun.numbers, strict=True):
        bench.on_trial(number, begun.of)
        with open_rig(config.built_for(seed), seed, bench.paced) as rig:
            finished, _ = attempt(seed, rig, None)
        yield finished
        if finished.failure is not None:
            return
