"""Trials of one scenario, one after the other: on one open rig where there are real wires."""

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path

import msgspec

from drivers.errors import Refused
from drivers.interfaces import Vector3
from grasp import interruption
from scenarios.rigs.opening import open_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import GraspRig
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import DOUBTED, STALE, OnTick
from scenarios.trial.person import Operator, place_object
from scenarios.trial.result import FinishedRun, ResultT

MOST_AGAIN = 3  # times that a person is asked for the same trial anew
NEAR_M = 0.02  # aside of the first trial's home, or beyond the top of a lift over it

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


def run_series(
    config: TrialConfig, seeds: Sequence[int], bench: Bench, attempt: Attempt[ResultT]
) -> Series[ResultT]:
    """One trial a seed. Ends after one that failed as a run; raises KeyboardInterrupt when it is
    stopped between two, and Refused where the arm stands too far from the home in ``begun``.

    The simulated rig is opened anew for each, so that a trial depends on its own seed alone. A
    wired one is opened once: its world loads the next object, or a person puts it back, and every
    trial begins from the home that the first one took. With a person there, a trial in which a
    device was not heard or not believed is asked for again, as long as the hand is open.
    """
    begun = bench.begun or Begun(tuple(range(1, len(seeds) + 1)), len(seeds))
    with interruption.held():
        if config.rig == "simulated":
            yield from _anew(config, seeds, bench.paced, attempt)
            return
        with open_rig(config, seeds[0], bench.paced, bench.permit) as rig:
            yield from _on_one_rig(config, seeds, rig, bench.operator, attempt, begun)


def _on_one_rig(
    config: TrialConfig, seeds: Sequence[int], rig: GraspRig, operator: Operator | None,
    attempt: Attempt[ResultT], begun: Begun,
) -> Series[ResultT]:  # fmt: skip
    home, first = begun.home, True
    way = _way_home(config, rig, home)
    for seed, title in _asked(seeds, begun):
        for words in _times(title):
            interruption.check()
            if not first and rig.load is not None:
                rig.load(config, seed)
            if operator is not None:
                place_object(rig, operator, f"{words}{way}")
            finished, found = attempt(seed, rig, home)
            first, way = False, ""
            if finished.result is not None and finished.result.home_m is not None:
                home = found
            yield finished
            if finished.failure is None:
                break
            if operator is None or not _may_be_repeated(finished):
                return
        else:
            return


def _asked(seeds: Sequence[int], begun: Begun) -> Iterator[tuple[int, str]]:
    for seed, number in zip(seeds, begun.numbers, strict=True):
        yield seed, f"Trial {number} of {begun.of}"


def _times(title: str) -> Iterator[str]:
    yield title
    for _ in range(MOST_AGAIN):
        yield f"{title} again, for a device was not heard or not believed"


def _may_be_repeated(finished: FinishedRun[ResultT]) -> bool:
    """Whether it was no trial, and has left an arm that stands and a hand that is open."""
    failure = finished.failure
    if failure is None or failure.kind not in (STALE, DOUBTED) or failure.end is None:
        return False
    return failure.end.open and not failure.end.unreached


def _way_home(config: TrialConfig, rig: GraspRig, home: Vector3 | None) -> str:
    """What a person should know of the way that the arm will go first. Raises Refused for one that
    no lift has left it on."""
    arm = rig.arm.state
    if home is None or arm is None:
        return ""
    x, y, z = (here - there for here, there in zip(arm.position_m, home, strict=True))
    top_m = config.controller.lift_height_m + config.controller.retreat_m
    if math.hypot(x, y) > NEAR_M or not -NEAR_M <= z <= top_m + NEAR_M:
        raise Refused(
            f"the arm stands {math.hypot(x, y, z) * 1e3:.0f} mm from where the first trial began",
            "bring it back there, or begin a series of its own with another --out",
        )
    if math.hypot(x, y, z) < config.controller.at_height_m:
        return ""
    return f" (the arm goes {math.hypot(x, y, z) * 1e3:.0f} mm first, to where the first one began)"


def _anew(
    config: TrialConfig, seeds: Sequence[int], paced: bool, attempt: Attempt[ResultT]
) -> Series[ResultT]:
    for seed in seeds:
        with open_rig(config, seed, paced) as rig:
            finished, _ = attempt(seed, rig, None)
        yield finished
        if finished.failure is not None:
            return
