"""Judges the last line of a run: are its cause and its words on arm and hand true?

Shared by faults in virtual time, lifts over spoilt wires and the soak test.
"""

import re

import msgspec

from grasp.guard import GuardSettings

MOST_N = GuardSettings().force_limit_n + GuardSettings().overshoot_n  # true force of a finger
GRIPPED_N = 7.0  # of a hand that is closed to the limit, though the object slipped since
MISREAD_N = 1.5  # error of fingertips without a fault
FELT_N, TOUCH_N = 1.0, 0.05  # surely pressed; less is no contact
STILL_MPS, SLIDES_MPS = 1e-4, 1e-3
LET_GO_M, SLID_M = 0.003, 0.015  # height of a dropped object; slip in the hand that is no holding
TIMED_OUT = r"did not end in time|lasted longer than"
LATE = r"stale|stands still|stood still|silent|does not answer|no data|in time|_late\b|loop_"
# the hand could not be commanded, and the last line says so
CANNOT_COMMAND = r"holds by itself|status is implausible|refuses every motion|not heard"
BLAMED = {
    "gripper": r"gripper|\bhand\b|\bfingers?\b|thumb",
    "arm": r"\barm\b|\barm_",
    "fingertips": r"fingertip|tactile|taxel|feels nothing|measured force",
    "detector": r"detector",
    "loop": r"loop_|the control step began",
}
WAY_OUT = "open the hand"  # advice of the simulated rig


class Known(msgspec.Struct, frozen=True, kw_only=True):
    """What is known after the end; None: not observed. ``wrong``: devices with a fault, by their
    names in ``BLAMED``; "loop" where the machine stalled."""

    wrong: frozenset[str]
    pressed_n: float | None = None  # by the most loaded finger
    opened: bool | None = None  # the hand
    arm_moves: bool | None = None
    fingers_move: bool | None = None
    gripped: bool = False  # as the safe state began
    opening: bool = False  # commanded to let go
    safety_stop: bool | None = None  # of the arm, by its own safety system


def misled(message: str, arm: str, hand: str, known: Known) -> list[str]:
    """What the last line says and is not true, or lacks."""
    sentences = {**_of_arm(arm, known), **_of_hand(hand, known)}
    found = [text for text, is_wrong in sentences.items() if is_wrong]
    return [*found, *filter(None, [blames_another(message, known.wrong)])]


def blames_another(message: str, wrong: frozenset[str]) -> str:
    """Whether the cause names only devices without a fault, or none. Lateness is excused where the
    machine stalled."""
    named = {device for device, words in BLAMED.items() if re.search(words, message)}
    if not message:
        return "no word of the cause"
    if message.startswith("lost: "):  # of the object: no device is named
        return ""
    if not named:
        return f"names nothing: {message}"
    if "loop" in wrong and re.search(LATE, message):
        return ""
    innocent = named - wrong
    if named <= innocent or "detector" in innocent:
        return f"nothing is wrong with the {' and '.join(sorted(innocent))}: {message}"
    return ""


def _of_arm(said: str, known: Known) -> dict[str, bool]:
    reachable = not known.wrong & {"arm", "loop"}
    stopped = "its own safety system" in said
    safety = "arm" in known.wrong if known.safety_stop is None else known.safety_stop
    return {
        "no word of the arm": not said,
        "the arm moves": said == "the arm is stationary" and known.arm_moves is True,
        "by its last line the arm is left moving": said.startswith("the arm is still moving")
        and known.arm_moves is not True,
        "the arm was reachable": "at its last status" in said and reachable,
        "the arm can be believed": said.startswith("the arm reports") and reachable,
        "the arm moves, and no safety system stops it": stopped and known.arm_moves is True,
        "no safety system stopped the arm": stopped and not safety,
    }


def _of_hand(said: str, known: Known) -> dict[str, bool]:
    reachable = not known.wrong & {"gripper", "loop"}
    here = "at its last status" not in said and "reports that it is" not in said
    pressed_n, felt = known.pressed_n, re.search(r"(\d+\.\d) N measured", said)
    felt_n = float(felt[1]) if felt else 0.0
    presses = pressed_n is not None and pressed_n > FELT_N
    empty = pressed_n is not None and pressed_n <= TOUCH_N
    alone = "holds by itself" in said
    return {
        "no word of the hand": not said,
        "the hand is not open": said == "the hand is open" and (presses or known.opened is False),
        "it is not closed to the limit": here and pressed_n is not None and pressed_n < GRIPPED_N
        and ("closed to the limit" in said or "closed to its last count" in said),
        "its force is less": here and pressed_n is not None and "fingertips" not in known.wrong
        and felt_n > pressed_n + MISREAD_N,
        "it has contact": here and "without measured contact" in said and presses
        and not ("may still be in it" in said and "fingertips" in known.wrong),
        "it holds nothing": here and "with its previous grip" in said and empty,
        "the fingers move": alone and known.fingers_move is True,
        "it let go": alone and known.gripped and empty and not known.opening,
        "by its last line the hand is left moving": here and "still moving, " in said
        and known.fingers_move is not True,
        "the hand was reachable": "cannot be commanded" in said and reachable,
        "the hand refuses nothing": "refuses every motion" in said and reachable,
        "the hand can be believed": "status is implausible" in said and reachable,
        "the hand is activated": "is not activated" in said and reachable,
        "the hand reports nothing": "the hand reports" in said and reachable,
    }  # fmt: skip
