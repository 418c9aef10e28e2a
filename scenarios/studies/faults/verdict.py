"""What of a run was not as it must be, and whether that had been named beforehand."""

import re
from collections.abc import Callable

from grasp.controller_settings import ControllerSettings
from grasp.guard import GuardSettings
from grasp.phases import AIRBORNE_PHASES, Phase
from scenarios.lift.scoring import SUCCESSES, LiftOutcome
from scenarios.studies.faults.cases import Fault
from scenarios.studies.faults.declared import DECLARED, Declared
from scenarios.studies.faults.last_line import (
    BLAMED,
    FELT_N,
    GRIPPED_N,
    TIMED_OUT,
    Known,
    blames_another,
    of_arm,
    of_hand,
)
from scenarios.studies.faults.run import REACTION_S, SLIDES_MPS, WAY_OUT, Ended
from scenarios.trial.ending import LOOK

MOST_N = GuardSettings().force_limit_n + GuardSettings().overshoot_n
BRAKES_MPS2 = ControllerSettings().stop_deceleration_mps2
SAFE_S = ControllerSettings().safe_state_s
LOOK_S = 0.06  # between two looks at what the simulation knows, and a step
LET_GO_M = 0.003  # in the air
SLID_M = 0.015  # so far down in the hand, in the air, is no holding
LOOSENED = 0.5  # of what it pressed with as the safe state began, and less: it lets go
RAISED_M = 0.03  # an object that was lifted
OPENS = frozenset({Phase.RELEASE.value, Phase.RETREAT.value})  # on the table, and told to let go
CLOSES = frozenset({Phase.GRASP.value, Phase.OPPOSE.value})  # it begins to touch, and holds nothing
BUGS = frozenset({"", LiftOutcome.INTERNAL_ERROR, LiftOutcome.INTERRUPTED})  # nobody asked for it
# all that a last line may say, whatever is put into it
_FELT = r"(nothing measured yet|its force is not measured|\d+\.\d N measured at finger [ABC])"
_AT = r"at \(\d+, \d+, \d+\) counts"
# the first of each: in rows made before it said where
_CLOSED = (
    rf"(closed as it was|closed with the grip that it had, {_AT}|closed to the limit of \d+ N|"
    r"closed to its last count, within the limit of \d+ N|"
    r"closed by position, short of the limit of \d+ N)"
)
_EMPTY = (
    r"(closed, and feels nothing any more|"
    rf"closed as it was told, {_AT}, and feels nothing: the object may still be in it)"
)
_PARTLY = rf"partly closed, {_AT}"
_STATE = (
    rf"(open|still moving, {_FELT}|{_CLOSED}, {_FELT}|{_EMPTY}|"
    rf"{_PARTLY}(, and feels nothing|; what it feels is not known))"
)
_ALONE = r"(cannot be told anything|is not activated|refuses every motion \(.+\)) and holds"
_MOVES = r"moving at (\d+\.\d\d m/s|less than 0\.01 m/s|a speed that it does not tell)"
SAID = {
    "arm": rf"the arm (stands|is stopped by its own safety system|says that it stands|is still "
    rf"{_MOVES}|says that it is still {_MOVES}|(stood|was still {_MOVES}) when last heard)",
    "hand": rf"the hand (is {_STATE}|reports .+: it is {_STATE}|is not believed, and may still "
    rf"move: it says that it is {_STATE}|{_ALONE} by itself: (it is|when last heard it was) "
    rf"{_STATE})",
    "advice": rf"({LOOK}; )?({WAY_OUT}|start the run again)",
}


def dropped(end: Ended) -> str:
    """An object that the hand had in the air is let go there, or slides down and out."""
    if end.let_go_m > LET_GO_M:
        return f"let go at {end.let_go_m * 1e3:.0f} mm"
    if end.slid_m > SLID_M:
        return f"slid {end.slid_m * 1e3:.0f} mm in the air"
    hangs = end.height_m > LET_GO_M and end.later_pressed_n > 0.0
    return (
        f"goes on sliding at {end.slip_mps:.3f} m/s" if hangs and end.slip_mps > SLIDES_MPS else ""
    )


def pressed(end: Ended) -> str:
    return f"{end.peak_n:.1f} N" if end.peak_n > MOST_N else ""


def moving(end: Ended) -> str:
    """What goes on moving: as the run ends, or long after."""
    parts = {
        "arm at the end": end.arm_mps, "arm": end.later_arm_mps, "fingers": end.later_fingers_mps,
    }  # fmt: skip
    return ", ".join(f"{part} at {mps:.3f} m/s" for part, mps in parts.items() if mps > 0.0)


def unstopped(end: Ended) -> str:
    """A safe state that arm or hand did not come to: no more than it takes to hear of it and to
    brake, and of the hand than the time that it is asked for."""
    if end.arm_s is None or end.hand_s is None:
        return ""
    way_m = end.safe_mps * REACTION_S + end.safe_mps**2 / (2.0 * BRAKES_MPS2)
    if end.safe_way_m > way_m:
        return f"the arm went on for {end.safe_way_m * 1e3:.0f} mm, and {way_m * 1e3:.0f} brake it"
    if end.arm_s > end.safe_mps / BRAKES_MPS2 + REACTION_S + LOOK_S:
        return f"the arm stood {end.arm_s:.2f} s after the safe state"
    late = end.hand_s > SAFE_S + LOOK_S
    return f"the fingers rested {end.hand_s:.2f} s after the safe state" if late else ""


def gripped(end: Ended) -> bool:
    """Whether the hand pressed on something when the safe state began."""
    return end.entered_n is not None and end.entered_n > FELT_N


def loosened(end: Ended) -> str:
    """A hand that held something when the safe state began, in the air or on the table, and lets
    go; one that was opening may go on, one that closes in pushes by one finger and may stop, and a
    dropped object is found by another check."""
    if end.entered_n is None or end.least_n is None or not gripped(end) or dropped(end):
        return ""
    if end.phase not in OPENS | CLOSES and end.least_n < LOOSENED * end.entered_n:
        return f"from {end.entered_n:.1f} N to {end.least_n:.1f} N"
    obeys = end.phase in AIRBORNE_PHASES and not _struck(end, "gripper")
    return f"not closed: {end.pressed_n:.1f} N" if obeys and end.pressed_n < GRIPPED_N else ""


def missed(end: Ended) -> str:
    """A lift that fails, though no fault is told: its outcome is all that the user has."""
    told = end.outcome in SUCCESSES | {LiftOutcome.FAULT, LiftOutcome.OVER_FORCE}
    if told or dropped(end):
        return ""
    return f"{end.outcome}, lifted by {end.lifted_m * 1e3:.0f} mm"


def buggy(end: Ended) -> str:
    """A program that fails by itself."""
    return f"outcome {end.outcome!r}" if end.outcome in BUGS else ""


def timed_out(end: Ended) -> str:
    if not end.finished:
        return "the run did not end in time"
    return end.cause if re.search(TIMED_OUT, end.cause) else ""


def misled(end: Ended) -> str:
    """What the last line says and is not so."""
    lost, due, known = bool(dropped(end)), _told(end), known_of(end)
    wrong = {
        **(of_arm(end.arm, known) if due else {}), **(of_hand(end.hand, known) if due else {}),
        **_of_advice(end),
        "nothing was missed": "the arm still moves" in end.unreached and end.arm_mps == 0.0
        and end.later_arm_mps == 0.0 and "is still moving" not in end.arm,
        "it was dropped": lost and end.outcome in SUCCESSES,
        "no word": end.outcome == "fault" and not end.message,
        "it was not lifted": end.outcome in SUCCESSES and end.lifted_m < RAISED_M,
        **_of_words(end),
    }  # fmt: skip
    found = [text for text, is_wrong in wrong.items() if is_wrong]
    return "; ".join([*found, *filter(None, [blamed_others(end)])])


def known_of(end: Ended) -> Known:
    """What the simulation knows of it."""
    faults = end.case.faults
    return Known(
        wrong=frozenset(fault.device for fault in faults), pressed_n=end.pressed_n,
        arm_moves=end.arm_mps > 0.0, fingers_move=end.fingers_mps > 0.0, gripped=gripped(end),
        opening=end.phase in OPENS,
        safety_stop=any(fault.what == "protective_stop" for fault in faults),
    )  # fmt: skip


def _told(end: Ended) -> bool:
    """Whether there has to be a last line; a lift that ended as planned has none."""
    return end.outcome == "fault" or any((end.arm, end.hand, end.advice))


def _of_words(end: Ended) -> dict[str, bool]:
    """Sentences that are none, or lack after a fault."""
    told = {"arm": end.arm, "hand": end.hand, "advice": end.advice}
    return {f"no such {name}: {said!r}": _told(end) and re.fullmatch(SAID[name], said) is None
            for name, said in told.items()}  # fmt: skip


def _of_advice(end: Ended) -> dict[str, bool]:
    """What is advised: where the arm moves, to look at it; where the hand is closed, to open it."""
    said, moves = end.advice, end.arm_mps > 0.0 or end.later_arm_mps > 0.0
    told = bool(end.arm)
    again = said.endswith("start the run again")
    return {
        "nobody is told to look at an arm that moves": told and moves and LOOK not in said
        and "still moving" not in end.arm,
        "nobody is told what to do": told and not said,
        "it says to start with a hand that holds": again and end.pressed_n > FELT_N,
    }  # fmt: skip


def _struck(end: Ended, device: str) -> bool:
    """Whether something was wrong with it."""
    return any(fault.device == device for fault in end.case.faults)


def blamed_others(end: Ended) -> str:
    """A cause, or one of the failures that came after it, that speaks of others; of a lift that
    ended as planned, or failed without a fault, there is none."""
    struck = frozenset(fault.device for fault in end.case.faults)
    texts = [*filter(None, (end.cause, *end.message.split("; then ")))]
    return "; ".join(filter(None, (blames_another(text, struck) for text in texts)))


CHECKS: dict[str, Callable[[Ended], str]] = {
    "dropped": dropped, "force": pressed, "moving": moving, "unstopped": unstopped,
    "hand": loosened, "time-out": timed_out, "misleading": misled, "missed": missed, "bug": buggy,
}  # fmt: skip


def problems(end: Ended) -> dict[str, str]:
    """By the name of the check, what it found."""
    return {name: text for name, check in CHECKS.items() if (text := check(end))}


def declared(end: Ended, found: dict[str, str]) -> Declared | None:
    """The case that was named beforehand and covers all that was found, if there is one. Of a pair
    the half that is named must show in what was told: it names its device; and a command must have
    been taken."""
    told = "; ".join((end.outcome, end.message, end.arm, end.hand, *end.unreached))
    return next((d for d in DECLARED if d.covers(explaining(end), end.phase, found, told)), None)


def explaining(end: Ended) -> tuple[tuple[Fault, bool], ...]:
    """Those of a run's faults that can have led to what was found, and whether they ended by
    themselves. A detector that is deaf shows by nothing but the outcome."""
    case = end.case
    halves = ((case.fault, case.recovers, end.taken), (case.then, case.then_recovers,
                                                       end.then_taken))  # fmt: skip
    told = "; ".join((end.cause, end.message, end.arm, end.hand))
    found = []
    for fault, ends, taken in halves:
        if fault is None or (fault.part == "command" and not taken):
            continue
        shows = case.then is None or fault.part == "command" or (
            fault.device == "detector" and end.outcome != "fault"
        )  # fmt: skip
        if shows or re.search(BLAMED[fault.device], told):
            found.append((fault, ends))
    return tuple(found)


def fell(end: Ended) -> dict[str, str]:
    """What was found and had not been named."""
    found = problems(end)
    return {} if declared(end, found) is not None else found
