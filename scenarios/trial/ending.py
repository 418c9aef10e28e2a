"""How arm and hand were left by a run that ended in a safe state, in a person's words.

Told from what was heard last and from nothing else: what cannot be known is said to be unknown.
"""

import math
from collections.abc import Sequence

import msgspec

from drivers.interfaces import FINGER_NAMES, ArmState, Detection, GripperState
from grasp.commands import CloseFast
from grasp.fault import ARM, FINGERTIPS, GRIPPER, Fault
from grasp.loop import Issued, Tick
from grasp.monitors.checks import implausible

UNKNOWN = "its force is not measured"
LOOK = "look at the arm, and press the emergency stop if it still moves"
CELL = "nothing there answers: check the cell's power and network"
NAMES = {GRIPPER: "gripper", ARM: "arm", FINGERTIPS: "tactile board"}
LOOK_THERE = "see the phases of the result"
FELT_N = 0.5  # by taxels that can tell: less is no grip


class End(msgspec.Struct, frozen=True):
    """Where arm and hand are, what of the safe state was not seen, and how to go on; ``advice`` is
    empty where the cell ends too."""

    arm: str
    hand: str
    advice: str
    unconfirmed: tuple[str, ...] = ()
    later_faults: tuple[Fault, ...] = ()  # checks that failed since
    open: bool = False  # the hand was seen to be
    where: str = ""  # in which phase the run ended, and how high the arm was


def end_message(
    faults: Sequence[Fault], errors: Sequence[Fault], tick: Tick | None, old_s: float
) -> tuple[str, str]:
    """What went wrong and what to do, with every device that is gone: ``faults`` that no driver
    raised, then ``errors``, which they did, then the devices that are silent."""
    quiet = [] if tick is None else silent(tick, old_s)
    ordered = [*(fault for fault in faults if fault not in errors), *errors]
    named = {fault.device for fault in ordered}
    said = [*dict.fromkeys(fault.line for fault in ordered)]
    said += [f"the {NAMES[device]} is silent" for device in quiet if device not in named]
    gone = NAMES.keys() <= {*(error.device for error in errors), *quiet}
    remedies = dict.fromkeys(fault.remedy for fault in ordered if fault.remedy)
    return "; ".join(said), CELL if gone else "; ".join(remedies) or LOOK_THERE


def silent(tick: Tick, old_s: float) -> list[str]:
    """Devices that have not been heard for so long, or send nothing of use."""
    ages = {GRIPPER: tick.gripper.age_ns(tick.t_ns), ARM: tick.arm.age_ns(tick.t_ns)}
    quiet = [name for name, age_ns in ages.items() if age_ns > old_s * 1e9]
    stale = tick.frame is not None and tick.frame.stale
    return [*quiet, FINGERTIPS] if stale else quiet


def end_of(
    tick: Tick | None, hand: Issued | None, old_s: float, way_out: str,
    faults: Sequence[Fault] = (), errors: Sequence[Fault] = (),
) -> End:  # fmt: skip
    """By the last tick and the last command that reached the hand; None: there was none. What was
    heard longer ago than ``old_s`` is old; ``way_out``: what to do about a closed hand; ``faults``:
    what is not to be believed; ``errors``: which drivers failed."""
    if tick is None:
        return End("the arm was told nothing", "the hand was told nothing", "")
    deaf = set(silent(tick, old_s))
    failed = {error.device for error in errors}
    dull = FINGERTIPS in deaf | failed or implausible(faults, FINGERTIPS)
    felt = _felt(tick, not dull)
    doubted = implausible(faults, GRIPPER) or (tick.gripper.active and not tick.gripper.fresh)
    told = _hand(tick, hand, felt, GRIPPER in deaf, doubted)
    seen_open = tick.gripper.is_open and GRIPPER not in deaf and not doubted
    advice = "start the run again" if way_out and seen_open else way_out
    arm_lies = implausible(faults, ARM)
    if way_out and _unknown(tick.arm, ARM in deaf, arm_lies):
        advice = f"{LOOK}; {advice}"
    return End(_arm(tick.arm, ARM in deaf, arm_lies), told, advice, open=seen_open)


def between_trials(
    arm: ArmState | None, gripper: GripperState | None, now_ns: int, old_s: float, way_out: str
) -> End:
    """While an object is put in place, which a hand that is open does not hold yet."""
    if arm is None or gripper is None:
        return End("the arm was told nothing", "the hand was told nothing", way_out)
    deaf_arm, deaf_hand = (device.age_ns(now_ns) > old_s * 1e9 for device in (arm, gripper))
    opened = gripper.is_open
    how = "open" if opened else f"at {gripper.positions} counts"
    hand = f"the hand was {how} when last heard" if deaf_hand else f"the hand is {how}"
    look = LOOK if way_out and deaf_arm else ""
    advice = "; ".join(filter(None, (look, "" if opened else way_out)))
    return End(_arm(arm, deaf_arm, doubted=False), hand, advice, open=opened and not deaf_hand)


def _unknown(arm: ArmState, deaf: bool, doubted: bool) -> bool:
    """Whether nobody knows that the arm stands."""
    return deaf or (doubted and not arm.stopped_by_safety)


def _arm(arm: ArmState, deaf: bool, doubted: bool) -> str:
    moves = f"moving at {_speed(math.hypot(*arm.velocity_mps))}"
    if deaf:
        return f"the arm {f'was still {moves}' if arm.moving else 'stood'} when last heard"
    if arm.stopped_by_safety:
        return "the arm is stopped by its own safety system"
    if doubted:
        return f"the arm says that it {'is still ' + moves if arm.moving else 'stands'}"
    return f"the arm is still {moves}" if arm.moving else "the arm stands"


def _speed(mps: float) -> str:
    if math.isfinite(mps):
        return f"{mps:.2f} m/s" if mps >= 0.01 else "less than 0.01 m/s"
    return "a speed that it does not tell"


def _felt(tick: Tick, feels: bool) -> str:
    """Force at the most loaded finger."""
    if not feels:
        return UNKNOWN
    if tick.frame is None:
        return "nothing measured yet"
    most_n = max(tick.measured_n)
    return f"{most_n:.1f} N measured at finger {FINGER_NAMES[tick.measured_n.index(most_n)]}"


def _hand(tick: Tick, asked: Issued | None, felt: str, deaf: bool, doubted: bool) -> str:
    """``doubted``: its status does not speak of the last command, or cannot be."""
    gripper = tick.gripper
    state = _stands(tick, asked, felt)
    if deaf:
        alone = "the hand cannot be told anything and holds by itself"
        return f"{alone}: when last heard it was {state}"
    if gripper.fault and not gripper.active:
        alone = f"the hand refuses every motion ({gripper.fault_text}) and holds by itself"
        return f"{alone}: it is {state}"
    if doubted:
        return f"the hand is not believed, and may still move: it says that it is {state}"
    if not gripper.active:
        return f"the hand is not activated and holds by itself: it is {state}"
    if gripper.fault:  # one that keeps it from nothing
        return f"the hand reports {gripper.fault_text}: it is {state}"
    return f"the hand is {state}"


def _stands(tick: Tick, asked: Issued | None, felt: str) -> str:
    moves = any(f.detection is Detection.MOVING for f in tick.gripper.fingers)
    if moves and tick.gripper.active:  # one that is not obeys nothing, and says nothing of motion
        return f"still moving, {felt}"
    if tick.gripper.is_open:
        return "open"
    if not _grips(tick, felt):
        feels = "; what it feels is not known" if felt == UNKNOWN else ", and feels nothing"
        return f"partly closed, at {tick.gripper.positions} counts{feels}"
    obeys = tick.gripper.fresh and tick.gripper.active  # the status speaks of the last command
    if not obeys or asked is None or not isinstance(asked.admitted, CloseFast):
        return f"closed with the grip that it had, at {tick.gripper.positions} counts, {felt}"
    if felt != UNKNOWN and sum(tick.observation.responsive_n) < FELT_N:  # or they read their rest
        at = f"closed as it was told, at {tick.gripper.positions} counts"
        return f"{at}, and feels nothing: the object may still be in it"
    return f"{_closed(tick, asked.admitted)}, {felt}"


def _closed(tick: Tick, close: CloseFast) -> str:
    """How far: to the force, or to the last count that the guard lets the hand have."""
    fingers = zip(tick.gripper.fingers, close.closing, strict=True)
    if any(closes and f.detection is Detection.CONTACT_CLOSING for f, closes in fingers):
        return f"closed to the limit of {close.force_cap_n:g} N"
    if close.first_stage:
        return f"closed by position, short of the limit of {close.force_cap_n:g} N"
    return f"closed to its last count, within the limit of {close.force_cap_n:g} N"


def _grips(tick: Tick, felt: str) -> bool:
    """What was felt last is not what a hand that moved since feels now."""
    feels = felt != UNKNOWN and sum(tick.observation.responsive_n) >= FELT_N
    return feels or _touches(tick.gripper)


def _touches(gripper: GripperState) -> bool:
    return any(f.detection is Detection.CONTACT_CLOSING for f in gripper.fingers)
