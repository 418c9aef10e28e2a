"""What of a run was not as it must be: nothing dropped that could be held, nothing left moving, no
force over the bound, and a true last line."""

import re
from collections.abc import Callable

from grasp.controller_settings import ControllerSettings
from grasp.safe_state import SAFE_STATE_NS
from grasp.states import AIRBORNE_STATES, State
from scenarios.lift.scoring import SUCCESSES, LiftOutcome
from scenarios.trial.ending import LOOK
from tests.nightly.faults.cases import Fault
from tests.nightly.faults.declared import DECLARED
from tests.nightly.faults.run import REACTION_S, Ended
from tests.nightly.last_line import (
    BLAMED,
    FELT_N,
    GRIPPED_N,
    LET_GO_M,
    MOST_N,
    SLID_M,
    SLIDES_MPS,
    Known,
    blames_another,
    misled,
)

BRAKES_MPS2 = ControllerSettings().stop_deceleration_mps2
SAFE_S = SAFE_STATE_NS * 1e-9
LOOK_S = 0.06  # between two looks of the simulation, and a step
LEAST_WAY_M = 0.001  # a way that is not worth a finding
LOOSENED = 0.5  # share of the force at the begin of the safe state; less is letting go
RAISED_M = 0.03  # an object that was lifted
OPENS = frozenset({State.OPEN.value, State.RETREAT.value})
CLOSES = frozenset({State.BRACE.value, State.CLOSE.value})  # begins to touch, holds nothing
BUGS = frozenset({"", LiftOutcome.INTERNAL_ERROR, LiftOutcome.INTERRUPTED})


def dropped(end: Ended) -> str:
    """An object in the air is let go, or slides down and out."""
    if end.let_go_m > LET_GO_M:
        return f"let go at {end.let_go_m * 1e3:.0f} mm"
    if end.slid_m > SLID_M:
        return f"slid {end.slid_m * 1e3:.0f} mm in the air"
    hangs = end.height_m > LET_GO_M and end.later_pressed_n > 0.0
    slides = hangs and end.slip_mps > SLIDES_MPS
    return f"goes on sliding at {end.slip_mps:.3f} m/s" if slides else ""


def forced(end: Ended) -> str:
    return f"{end.peak_n:.1f} N" if end.peak_n > MOST_N else ""


def moving(end: Ended) -> str:
    """What moves as the run ends, or long after."""
    parts = {
        "arm at the end": end.arm_mps, "arm": end.later_arm_mps, "fingers": end.later_fingers_mps,
    }  # fmt: skip
    return ", ".join(f"{part} at {mps:.3f} m/s" for part, mps in parts.items() if mps > 0.0)


def unstopped(end: Ended) -> str:
    """Arm or hand takes longer to the safe state than reaction and braking need."""
    if end.arm_s is None or end.hand_s is None:
        return ""
    way_m = end.safe_mps * REACTION_S + end.safe_mps**2 / (2.0 * BRAKES_MPS2)
    if end.safe_way_m > way_m + LEAST_WAY_M:
        return f"the arm went on for {end.safe_way_m * 1e3:.0f} mm, and {way_m * 1e3:.0f} brake it"
    if end.arm_s > end.safe_mps / BRAKES_MPS2 + REACTION_S + LOOK_S:
        return f"the arm stood {end.arm_s:.2f} s after the safe state"
    late = end.hand_s > SAFE_S + LOOK_S
    return f"the fingers rested {end.hand_s:.2f} s after the safe state" if late else ""


def gripped(end: Ended) -> bool:
    """Whether the hand pressed on something as the safe state began."""
    return end.entered_n is not None and end.entered_n > FELT_N


def loosened(end: Ended) -> str:
    """A hand that held as the safe state began lets go, or does not close in the air."""
    if end.entered_n is None or end.least_n is None or not gripped(end) or dropped(end):
        return ""
    if end.phase not in OPENS | CLOSES and end.least_n < LOOSENED * end.entered_n:
        return f"from {end.entered_n:.1f} N to {end.least_n:.1f} N"
    struck = any(fault.device == "gripper" for fault in end.case.faults)
    weak = end.phase in AIRBORNE_STATES and not struck and end.pressed_n < GRIPPED_N
    return f"not closed: {end.pressed_n:.1f} N" if weak else ""


def missed(end: Ended) -> str:
    """A lift fails and no fault is told: its outcome is all that the user has."""
    told = end.outcome in SUCCESSES | {LiftOutcome.FAULT, LiftOutcome.OVER_FORCE}
    if told or dropped(end):
        return ""
    return f"{end.outcome}, lifted by {end.lifted_m * 1e3:.0f} mm"


def buggy(end: Ended) -> str:
    return f"outcome {end.outcome!r}" if end.outcome in BUGS else ""


def timed_out(end: Ended) -> str:
    if not end.finished:
        return "the run did not end in time"
    return end.cause if end.timed_out else ""


def misleading(end: Ended) -> str:
    """What the last line says and is not true."""
    struck = frozenset(fault.device for fault in end.case.faults)
    moves = end.arm_mps > 0.0 or end.later_arm_mps > 0.0
    known = Known(
        wrong=struck, pressed_n=end.pressed_n, arm_moves=end.arm_mps > 0.0,
        fingers_move=end.fingers_mps > 0.0, gripped=gripped(end), opening=end.phase in OPENS,
        safety_stop=any(fault.what == "protective_stop" for fault in end.case.faults),
    )  # fmt: skip
    due = end.outcome == "fault" or any((end.arm, end.hand, end.advice))
    wrong = {
        "nobody is told to look at an arm that moves": bool(end.arm) and moves
        and LOOK not in end.advice and "still moving" not in end.arm,
        "nobody is told what to do": due and not end.advice,
        "it says to start with a hand that holds": end.advice.endswith("start the run again")
        and end.pressed_n > FELT_N,
        "the arm does not move": "the arm still moves" in end.unconfirmed and not moves
        and "is still moving" not in end.arm,
        "it was dropped": bool(dropped(end)) and end.outcome in SUCCESSES,
        "it was not lifted": end.outcome in SUCCESSES and end.lifted_m < RAISED_M,
    }  # fmt: skip
    found = [text for text, is_wrong in wrong.items() if is_wrong]
    causes = [*filter(None, (end.cause, *end.message.split("; then ")))]
    if due:
        found += misled((causes or [""])[0], end.arm, end.hand, known)
    found += filter(None, (blames_another(text, struck) for text in causes[due:]))
    return "; ".join(found)


CHECKS: dict[str, Callable[[Ended], str]] = {
    "dropped": dropped, "force": forced, "moving": moving, "unstopped": unstopped,
    "hand": loosened, "time-out": timed_out, "misleading": misleading, "missed": missed,
    "bug": buggy,
}  # fmt: skip


def problems(end: Ended) -> dict[str, str]:
    """By the name of the check, what it found."""
    return {name: text for name, check in CHECKS.items() if (text := check(end))}


def fell(end: Ended) -> dict[str, str]:
    """What was found and is not declared."""
    found = problems(end)
    told = "; ".join((end.outcome, end.message, end.arm, end.hand, *end.unconfirmed))
    covered = any(d.covers(_explaining(end), end.phase, found, told) for d in DECLARED)
    return {} if covered else found


def _explaining(end: Ended) -> list[tuple[Fault, bool]]:
    """Faults that can have led to what was found, and whether they ended: a command must have been
    taken, and of a pair the half counts whose device the last line names."""
    case = end.case
    told = "; ".join((end.cause, end.message, end.arm, end.hand))
    found = []
    for fault, ends, taken in ((case.fault, case.recovers, end.taken),
                               (case.then, case.then_recovers, end.then_taken)):  # fmt: skip
        if fault is None or (fault.part == "command" and not taken):
            continue
        deaf = fault.device == "detector" and end.outcome != "fault"
        shows = case.then is None or fault.part == "command" or deaf
        if shows or re.search(BLAMED[fault.device], told):
            found.append((fault, ends))
    return found
