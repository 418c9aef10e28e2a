"""What of a run was not as it must be, and whether that had been named beforehand."""

import re
from collections.abc import Callable

from grasp.phases import AIRBORNE_PHASES, Phase
from scenarios.lift.scoring import SUCCESSES
from scenarios.studies.faults.declared import DECLARED, Declared
from scenarios.studies.faults.run import SLIDES_MPS, Ended

MOST_N = 11.2  # limit and overshoot, with what the last count of a stiff object adds
LET_GO_M = 0.003  # in the air
SLID_M = 0.015  # so far down in the hand, in the air, is no holding
GRIPPED_N = 7.0  # of a hand that is closed to the limit, though the object slipped since
FELT_N = 1.0
TOUCH_N = 0.05  # less is nothing
OPENS = frozenset({Phase.RELEASE.value, Phase.RETREAT.value})  # on the table, and told to let go
BLAMED = {
    "gripper": r"gripper|\bhand\b|\bfingers?\b|thumb",
    "arm": r"\barm\b|\barm_",
    "fingertips": r"fingertip|tactile|taxel|feels nothing|measured force",
    "detector": r"detector",
    "loop": r"loop_|nobody was in control",
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
    parts = {"arm": end.later_arm_mps, "fingers": end.later_fingers_mps}
    return ", ".join(f"{part} at {mps:.3f} m/s" for part, mps in parts.items() if mps > 0.0)


def gripped(end: Ended) -> bool:
    """Whether the hand pressed on something when the safe state began."""
    return end.entered_n is not None and end.entered_n > FELT_N


def loosened(end: Ended) -> str:
    """A hand that held something when the safe state began, in the air or on the table, and lets
    go; one that was opening may go on, and a dropped object is found by another check."""
    if not gripped(end) or end.phase in OPENS or dropped(end) or end.least_n is None:
        return ""
    return f"from {end.entered_n:.1f} N to none" if end.least_n <= TOUCH_N else ""


def timed_out(end: Ended) -> str:
    if not end.finished:
        return "the run did not end in time"
    return end.cause if "lasted longer than" in end.cause else ""


def misled(end: Ended) -> str:
    """What the last line says and is not so."""
    lost = bool(dropped(end))
    wrong = {
        "the arm moves": end.arm == "the arm stands" and end.arm_mps > 0.0,
        "the hand is not open": end.hand == "the hand is open" and end.pressed_n > FELT_N,
        "it is not closed to the limit": "the hand is closed to the limit" in end.hand
        and end.phase in AIRBORNE_PHASES and end.pressed_n < GRIPPED_N,
        "it feels something": "feels nothing" in end.hand and end.pressed_n > FELT_N,
        "nothing was missed": "the arm still moves" in end.unreached and end.arm_mps == 0.0
        and end.later_arm_mps == 0.0 and "is still moving" not in end.arm,
        "it was dropped": lost and end.outcome in SUCCESSES,
        "no word": end.outcome == "fault" and not end.message,
        f"nothing is wrong with what it names: {end.cause}": blames_another(end),
    }  # fmt: skip
    return "; ".join(text for text, is_wrong in wrong.items() if is_wrong)


def blames_another(end: Ended) -> bool:
    """Whether the cause speaks of devices, and of none that something was wrong with."""
    named = {device for device, words in BLAMED.items() if re.search(words, end.cause)}
    return bool(named) and named.isdisjoint({fault.device for fault in end.case.faults})


CHECKS: dict[str, Callable[[Ended], str]] = {
    "dropped": dropped, "force": pressed, "moving": moving, "hand": loosened,
    "time-out": timed_out, "misleading": misled,
}  # fmt: skip


def problems(end: Ended) -> dict[str, str]:
    """By the name of the check, what it found."""
    return {name: text for name, check in CHECKS.items() if (text := check(end))}


def declared(end: Ended, found: dict[str, str]) -> Declared | None:
    """The case that was named beforehand and covers all that was found, if there is one."""
    told = "; ".join((end.outcome, end.message, end.arm, end.hand, *end.unreached))
    return next((d for d in DECLARED if d.covers(end.case, end.phase, found, told)), None)


def fell(end: Ended) -> dict[str, str]:
    """What was found and had not been named."""
    found = problems(end)
    return {} if declared(end, found) is not None else found
