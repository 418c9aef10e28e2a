"""State of arm and hand after a run that ended in a safe state, as text for the operator.

Based on the last status messages only: what they do not show is reported as unknown.
"""

import math
from collections.abc import Sequence

import msgspec

from drivers.interfaces import FINGER_NAMES, ArmState, Detection, GripperState
from grasp.control.commands import CloseToLimit
from grasp.control.fault import ARM, FINGERTIPS, GRIPPER, Fault
from grasp.control.monitors.checks import implausible
from grasp.run.loop import Issued, Tick

UNKNOWN = "its force is not measured"
LOOK = "look at the arm, and press the emergency stop if it still moves"
CELL = "no device answers: check the cell's power and network"
NAMES = {GRIPPER: "gripper", ARM: "arm", FINGERTIPS: "tactile board"}
LOOK_THERE = "see the phases of the result"
CONTACT_N = 0.5  # sum over the taxels that work: less is no grip
NO_COMMAND = ("no command was sent to the arm", "no command was sent to the hand")


class FinalState(msgspec.Struct, frozen=True):
    """State of arm and hand, what of the safe state was not confirmed, and how to continue.

    ``advice`` is empty where the emulated cell ends with the run.
    """

    arm: str
    hand: str
    advice: str
    unconfirmed: tuple[str, ...] = ()
    later_faults: tuple[Fault, ...] = ()  # checks that failed after the run had ended
    open: bool = False  # the status confirms that the hand is open
    where: str = ""  # phase in which the run ended, and height of the arm


def end_message(
    faults: Sequence[Fault], errors: Sequence[Fault], tick: Tick | None, old_s: float
) -> tuple[str, str]:
    """Cause and remedy, naming every failed device: first ``faults`` that no driver raised, then
    the drivers' ``errors``, then the devices without recent data."""
    stale = [] if tick is None else silent(tick, old_s)
    ordered = [*(fault for fault in faults if fault not in errors), *errors]
    named = {fault.device for fault in ordered}
    causes = [*dict.fromkeys(fault.line for fault in ordered)]
    causes += [f"the {NAMES[device]} is silent" for device in stale if device not in named]
    all_lost = NAMES.keys() <= {*(error.device for error in errors), *stale}
    remedies = dict.fromkeys(fault.remedy for fault in ordered if fault.remedy)
    return "; ".join(causes), CELL if all_lost else "; ".join(remedies) or LOOK_THERE


def silent(tick: Tick, old_s: float) -> list[str]:
    """Devices whose last usable data is older than ``old_s``."""
    ages = {GRIPPER: tick.gripper.age_ns(tick.t_ns), ARM: tick.arm.age_ns(tick.t_ns)}
    old = [name for name, age_ns in ages.items() if age_ns > old_s * 1e9]
    stale = tick.frame is not None and tick.frame.stale
    return [*old, FINGERTIPS] if stale else old


def final_state(
    tick: Tick | None, hand: Issued | None, old_s: float, way_out: str,
    faults: Sequence[Fault] = (), errors: Sequence[Fault] = (),
) -> FinalState:  # fmt: skip
    """The final state by the last tick and the last command that reached the hand (None: none).

    A status older than ``old_s`` is stale. ``way_out``: what to do about a closed hand;
    ``faults``: failed plausibility checks; ``errors``: errors of drivers.
    """
    if tick is None:
        return FinalState(*NO_COMMAND, "")
    stale = set(silent(tick, old_s))
    failed = {error.device for error in errors}
    untrusted = FINGERTIPS in stale | failed or implausible(faults, FINGERTIPS)
    force = _force(tick, not untrusted)
    suspect = implausible(faults, GRIPPER) or (tick.gripper.active and not tick.gripper.fresh)
    hand_text = _hand(tick, hand, force, GRIPPER in stale, suspect)
    is_open = _opened(tick, force) and GRIPPER not in stale and not suspect
    advice = "start the run again" if way_out and is_open else way_out
    arm_suspect = implausible(faults, ARM)
    if way_out and _unknown(tick.arm, ARM in stale, arm_suspect):
        advice = f"{LOOK}; {advice}"
    return FinalState(_arm(tick.arm, ARM in stale, arm_suspect), hand_text, advice, open=is_open)


def state_between_trials(
    arm: ArmState | None, gripper: GripperState | None, now_ns: int, old_s: float, way_out: str
) -> FinalState:
    """The state while an object is put in place; an open hand does not hold it yet."""
    if arm is None or gripper is None:
        return FinalState(*NO_COMMAND, way_out)
    arm_stale, hand_stale = (device.age_ns(now_ns) > old_s * 1e9 for device in (arm, gripper))
    opened = gripper.is_open
    how = "open" if opened else f"at {gripper.positions} counts"
    hand = f"the hand was {how} at its last status" if hand_stale else f"the hand is {how}"
    look = LOOK if way_out and arm_stale else ""
    advice = "; ".join(filter(None, (look, "" if opened else way_out)))
    return FinalState(_arm(arm, arm_stale, False), hand, advice, open=opened and not hand_stale)


def _unknown(arm: ArmState, stale: bool, suspect: bool) -> bool:
    """Whether it is unknown that the arm is stationary."""
    return stale or (suspect and not arm.stopped_by_safety)


def _arm(arm: ArmState, stale: bool, suspect: bool) -> str:
    """``suspect``: the status failed a plausibility check."""
    moves = f"moving at {_speed(math.hypot(*arm.velocity_mps))}"
    if stale:
        return f"the arm was {f'still {moves}' if arm.moving else 'stationary'} at its last status"
    if arm.stopped_by_safety:
        return "the arm is stopped by its own safety system"
    if suspect:
        return f"the arm reports that it is {f'still {moves}' if arm.moving else 'stationary'}"
    return f"the arm is still {moves}" if arm.moving else "the arm is stationary"


def _speed(mps: float) -> str:
    if math.isfinite(mps):
        return f"{mps:.2f} m/s" if mps >= 0.01 else "less than 0.01 m/s"
    return "an unknown speed"


def _force(tick: Tick, trusted: bool) -> str:
    """Estimated force at the most loaded finger."""
    if not trusted:
        return UNKNOWN
    if tick.frame is None:
        return "nothing measured yet"
    most_n = max(tick.estimated_n)
    return f"{most_n:.1f} N measured at finger {FINGER_NAMES[tick.estimated_n.index(most_n)]}"


def _hand(tick: Tick, command: Issued | None, force: str, stale: bool, suspect: bool) -> str:
    """``suspect``: the status is implausible, or does not follow the last command yet."""
    gripper = tick.gripper
    state = _closure(tick, command, force)
    if stale:
        alone = "the hand cannot be commanded and holds by itself"
        return f"{alone}: at its last status it was {state}"
    if gripper.fault and not gripper.active:
        alone = f"the hand refuses every motion ({gripper.fault_text}) and holds by itself"
        return f"{alone}: it is {state}"
    if suspect:
        may = "the hand's status is implausible, and it may still move"
        return f"{may}: it reports that it is {state}"
    if not gripper.active:
        return f"the hand is not activated and holds by itself: it is {state}"
    if gripper.fault:  # one that prevents no motion
        return f"the hand reports {gripper.fault_text}: it is {state}"
    return f"the hand is {state}"


def _closure(tick: Tick, command: Issued | None, force: str) -> str:
    moves = any(f.detection is Detection.MOVING for f in tick.gripper.fingers)
    if moves and tick.gripper.active:  # the motion bits of an inactive hand mean nothing
        return f"still moving, {force}"
    if _opened(tick, force):
        return "open"
    if not _grips(tick, force):
        contact = "; its contact is unknown" if force == UNKNOWN else ", without contact"
        return f"partly closed, at {tick.gripper.positions} counts{contact}"
    obeys = tick.gripper.fresh and tick.gripper.active  # the status follows the last command
    if not obeys or command is None or not isinstance(command.admitted, CloseToLimit):
        return f"closed with its previous grip, at {tick.gripper.positions} counts, {force}"
    # or the fingertips still measure their rest counts
    if force != UNKNOWN and sum(tick.observation.responsive_n) < CONTACT_N:
        at = f"closed as commanded, at {tick.gripper.positions} counts"
        return f"{at}, without measured contact: the object may still be in it"
    return f"{_closed(tick, command.admitted)}, {force}"


def _closed(tick: Tick, close: CloseToLimit) -> str:
    """Whether the hand closed to the force limit, or to the last count that the guard allows."""
    fingers = zip(tick.gripper.fingers, close.closing, strict=True)
    if any(closes and f.detection is Detection.CONTACT_CLOSING for f, closes in fingers):
        return f"closed to the limit of {close.force_limit_n:g} N"
    if close.first_stage:
        return f"closed by position, short of the limit of {close.force_limit_n:g} N"
    return "closed to its last count, within the force limit"


def _opened(tick: Tick, force: str) -> bool:
    """Whether the hand is open. A wide object can be gripped at the counts of an open hand."""
    return tick.gripper.is_open and not _grips(tick, force)


def _grips(tick: Tick, force: str) -> bool:
    """Whether force or detection bits show contact: a hand that moved since the last frame may have
    lost the force measured then."""
    measured = force != UNKNOWN and sum(tick.observation.responsive_n) >= CONTACT_N
    return measured or any(f.detection is Detection.CONTACT_CLOSING for f in tick.gripper.fingers)
