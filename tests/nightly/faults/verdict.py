"""Checks of a run with faults: no dropped object, no motion after the end, no excess force, and a
true last line."""

import re
from collections.abc import Callable

from grasp.control.controller_settings import ControllerSettings
from grasp.control.safe_state import SAFE_STATE_NS
from grasp.control.states import AIRBORNE_STATES, State
from scenarios.lift.scoring import SUCCESSES, LiftOutcome
from scenarios.trial.final_state import LOOK
from tests.nightly.faults.cases import Fault
from tests.nightly.faults.declared import DECLARED
from tests.nightly.faults.run import REACTION_S, Ended
from tests.nightly.last_line import (
    DEVICE_WORDS,
    DROPPED_M,
    GRIPPED_N,
    MOST_N,
    PRESSED_N,
    SLID_M,
    SLIDES_MPS,
    Known,
    false_statements,
    wrong_cause,
)

BRAKES_MPS2 = ControllerSettings().stop_deceleration_mps2
SAFE_S = SAFE_STATE_NS * 1e-9
LOOK_S = 0.06  # between two observations of the simulation, and a step
LEAST_WAY_M = 0.001  # tolerance of a distance
LOOSENED = 0.5  # least share of the force at the start of the safe state
RAISED_M = 0.03  # an object that was lifted
OPENS = frozenset({State.OPEN.value, State.RETREAT.value})
CLOSES = frozenset({State.BRACE.value, State.CLOSE.value})  # the object is not held yet
BUGS = frozenset({"", LiftOutcome.INTERNAL_ERROR, LiftOutcome.INTERRUPTED})


def dropped(end: Ended) -> str:
    """The object is lost in the air, or slides down and out."""
    if end.lost_at_m > DROPPED_M:
        return f"lost at {end.lost_at_m * 1e3:.0f} mm"
    if end.slid_m > SLID_M:
        return f"slid {end.slid_m * 1e3:.0f} mm in the air"
    hangs = end.height_m > DROPPED_M and end.later_pressed_n > 0.0
    slides = hangs and end.slip_mps > SLIDES_MPS
    return f"still slides at {end.slip_mps:.3f} m/s" if slides else ""


def forced(end: Ended) -> str:
    return f"{end.peak_n:.1f} N" if end.peak_n > MOST_N else ""


def moving(end: Ended) -> str:
    """Motion at the end of the run, or long after."""
    parts = {
        "arm at the end": end.arm_mps, "arm": end.later_arm_mps, "fingers": end.later_fingers_mps,
    }  # fmt: skip
    return ", ".join(f"{part} at {mps:.3f} m/s" for part, mps in parts.items() if mps > 0.0)


def unstopped(end: Ended) -> str:
    """Arm or hand needs longer for the safe state than reaction and braking take."""
    if end.arm_s is None or end.hand_s is None:
        return ""
    way_m = end.safe_mps * REACTION_S + end.safe_mps**2 / (2.0 * BRAKES_MPS2)
    if end.safe_way_m > way_m + LEAST_WAY_M:
        return f"the arm moved {end.safe_way_m * 1e3:.0f} mm, but braking takes {way_m * 1e3:.0f}"
    if end.arm_s > end.safe_mps / BRAKES_MPS2 + REACTION_S + LOOK_S:
        return f"the arm stopped {end.arm_s:.2f} s after the safe state"
    late = end.hand_s > SAFE_S + LOOK_S
    return f"the fingers stopped {end.hand_s:.2f} s after the safe state" if late else ""


def gripped(end: Ended) -> bool:
    """Whether the hand gripped the object at the start of the safe state."""
    return end.entered_n is not None and end.entered_n > PRESSED_N


def loosened(end: Ended) -> str:
    """A hand that gripped at the start of the safe state loosens, or does not close in the air."""
    if end.entered_n is None or end.least_n is None or not gripped(end) or dropped(end):
        return ""
    if end.phase not in OPENS | CLOSES and end.least_n < LOOSENED * end.entered_n:
        return f"from {end.entered_n:.1f} N to {end.least_n:.1f} N"
    injected = any(fault.device == "gripper" for fault in end.case.faults)
    weak = end.phase in AIRBORNE_STATES and not injected and end.pressed_n < GRIPPED_N
    return f"not closed: {end.pressed_n:.1f} N" if weak else ""


def missed(end: Ended) -> str:
    """The lift fails without a reported fault; only its outcome informs the user."""
    reported = end.outcome in SUCCESSES | {LiftOutcome.FAULT, LiftOutcome.OVER_FORCE}
    if reported or dropped(end):
        return ""
    return f"{end.outcome}, lifted by {end.lifted_m * 1e3:.0f} mm"


def buggy(end: Ended) -> str:
    return f"outcome {end.outcome!r}" if end.outcome in BUGS else ""


def timed_out(end: Ended) -> str:
    if not end.finished:
        return "the run did not end in time"
    return end.cause if end.timed_out else ""


def misleading(end: Ended) -> str:
    """False statements of the last line."""
    injected = frozenset(fault.device for fault in end.case.faults)
    if end.case.description is not None:
        injected |= {"gripper", "fingertips"}
    moves = end.arm_mps > 0.0 or end.later_arm_mps > 0.0
    known = Known(
        wrong=injected, pressed_n=end.pressed_n, arm_moves=end.arm_mps > 0.0,
        fingers_move=end.fingers_mps > 0.0, gripped=gripped(end), opening=end.phase in OPENS,
        safety_stop=any(fault.what == "protective_stop" for fault in end.case.faults),
    )  # fmt: skip
    due = end.outcome == "fault" or any((end.arm, end.hand, end.advice))
    wrong = {
        "no advice to look at a moving arm": bool(end.arm) and moves
        and LOOK not in end.advice and "still moving" not in end.arm,
        "no advice": due and not end.advice,
        "advice to start with a hand that holds": end.advice.endswith("start the run again")
        and end.pressed_n > PRESSED_N,
        "the arm does not move": "the arm still moves" in end.unconfirmed and not moves
        and "is still moving" not in end.arm,
        "it was dropped": bool(dropped(end)) and end.outcome in SUCCESSES,
        "it was not lifted": end.outcome in SUCCESSES and end.lifted_m < RAISED_M,
    }  # fmt: skip
    found = [text for text, is_wrong in wrong.items() if is_wrong]
    causes = [*filter(None, (end.cause, *end.message.split("; then ")))]
    if due:
        found += false_statements((causes or [""])[0], end.arm, end.hand, known)
    found += filter(None, (wrong_cause(text, injected) for text in causes[due:]))
    return "; ".join(found)


CHECKS: dict[str, Callable[[Ended], str]] = {
    "dropped": dropped, "force": forced, "moving": moving, "unstopped": unstopped,
    "hand": loosened, "time-out": timed_out, "misleading": misleading, "missed": missed,
    "bug": buggy,
}  # fmt: skip


def problems(end: Ended) -> dict[str, str]:
    """Problems by the name of the check."""
    return {name: text for name, check in CHECKS.items() if (text := check(end))}


def fell(end: Ended) -> dict[str, str]:
    """Problems that are not accepted in ``declared``. Of a wrong description none is accepted but
    force, of a hand stronger than its calibration, and a failed lift, and both must be reported."""
    found = problems(end)
    if end.case.description is not None:
        reported = end.outcome not in SUCCESSES
        return {k: v for k, v in found.items() if not (k in ("force", "missed") and reported)}
    text = "; ".join((end.outcome, end.message, end.arm, end.hand, *end.unconfirmed))
    covered = any(d.covers(_explaining(end), end.phase, found, text) for d in DECLARED)
    return {} if covered else found


def _explaining(end: Ended) -> list[tuple[Fault, bool]]:
    """Faults that can explain the problems, and whether they ended: a lost command must have
    occurred, and of a pair only faults count whose device the last line names."""
    case = end.case
    text = "; ".join((end.cause, end.message, end.arm, end.hand))
    found = []
    for fault, ends, taken in ((case.fault, case.recovers, end.taken),
                               (case.then, case.then_recovers, end.then_taken)):  # fmt: skip
        if fault is None or (fault.part == "command" and not taken):
            continue
        misses = fault.device == "detector" and end.outcome != "fault"
        together = case.then_ticks == 0  # each makes the other plausible, so no line need name it
        shows = case.then is None or together or fault.part == "command" or misses
        if shows or re.search(DEVICE_WORDS[fault.device], text):
            found.append((fault, ends))
    return found
