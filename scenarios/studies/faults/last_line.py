"""Whether the last line of a run is so: what it says of the cause, of arm and hand, beside what is
known when it is all over. One judge for runs in virtual time, on spoilt wires and of an hour."""

import re

import msgspec

GRIPPED_N = 7.0  # of a hand that is closed to the limit, though the object slipped since
MISREAD_N = 1.5  # more than that is not felt by fingertips that nothing is wrong with
FELT_N = 1.0
TOUCH_N = 0.05  # less is nothing
STILL_MPS = 1e-4
TIMED_OUT = r"did not end in time|lasted longer than"  # a run that nothing else has ended
KEPT = r"closed (as it was|with the grip that it had), "  # the first in rows made before
LATE = r"stale|stands still|stood still|silent|does not answer|no data|in time|_late\b|loop_"
BLAMED = {
    "gripper": r"gripper|\bhand\b|\bfingers?\b|thumb",
    "arm": r"\barm\b|\barm_",
    "fingertips": r"fingertip|tactile|taxel|feels nothing|measured force",
    "detector": r"detector",
    "loop": r"loop_|nobody was in control",
}


class Known(msgspec.Struct, frozen=True, kw_only=True):
    """What is known after the end; None: nobody looked, or asks it of more than words. ``wrong``:
    devices, as in ``BLAMED``, that something was wrong with, and "loop" where the machine was not
    there. ``opening``: it was to let go."""

    wrong: frozenset[str]
    pressed_n: float | None = None  # by the most loaded finger
    opened: bool | None = None  # the hand
    arm_moves: bool | None = None
    fingers_move: bool | None = None
    gripped: bool = False  # as the safe state began
    opening: bool = False
    safety_stop: bool | None = None  # of the arm, by its own safety system


def misled(message: str, arm: str, hand: str, known: Known) -> list[str]:
    """What it says and is not so, or does not say."""
    sentences = {**of_arm(arm, known), **of_hand(hand, known)}
    found = [text for text, is_wrong in sentences.items() if is_wrong]
    return [*found, *filter(None, [blames_another(message, known.wrong)])]


def blames_another(message: str, wrong: frozenset[str]) -> str:
    """Whether the cause speaks of something that nothing was wrong with, or of nothing at all. One
    who is late while the machine is not there has a cause, whoever it is."""
    named = {device for device, words in BLAMED.items() if re.search(words, message)}
    if not message:
        return "no word of the cause"
    if not named:
        return f"names nothing: {message}"
    if "loop" in wrong and re.search(LATE, message):
        return ""
    innocent = named - wrong
    # one that is named beside the culprit may have suffered; a detector asks nobody
    if named <= innocent or "detector" in innocent:
        return f"nothing is wrong with the {' and '.join(sorted(innocent))}: {message}"
    return ""


def of_arm(said: str, known: Known) -> dict[str, bool]:
    """What may be wrong with its sentence, and whether that is."""
    heard = not known.wrong & {"arm", "loop"}
    stopped = "its own safety system" in said
    safety = "arm" in known.wrong if known.safety_stop is None else known.safety_stop
    return {
        "no word of the arm": not said,
        "the arm moves": said == "the arm stands" and known.arm_moves is True,
        "by its last line the arm is left moving": said.startswith("the arm is still moving")
        and known.arm_moves is not True,
        "the arm was heard": "when last heard" in said and heard,
        "the arm can be believed": said.startswith("the arm says") and heard,
        "the arm moves, and no safety system stops it": stopped and known.arm_moves is True,
        "no safety system stopped the arm": stopped and not safety,
    }


def of_hand(said: str, known: Known) -> dict[str, bool]:
    """The same."""
    heard = not known.wrong & {"gripper", "loop"}
    here = "when last heard" not in said and "says that it is" not in said
    pressed_n = known.pressed_n
    presses = pressed_n is not None and pressed_n > FELT_N
    weak = pressed_n is not None and pressed_n < GRIPPED_N
    empty = pressed_n is not None and pressed_n <= TOUCH_N
    alone = "holds by itself" in said
    return {
        "no word of the hand": not said,
        "the hand is not open": said == "the hand is open" and (presses or known.opened is False),
        "it is not closed to the limit": here and weak
        and ("closed to the limit" in said or "closed to its last count" in said),
        "it feels less": here and pressed_n is not None and "fingertips" not in known.wrong
        and _felt_n(said) > pressed_n + MISREAD_N,
        "it feels something": here and "feels nothing" in said and presses
        and not ("may still be in it" in said and "fingertips" in known.wrong),
        "it holds nothing": here and re.search(KEPT, said) is not None and empty,
        "the fingers move": alone and known.fingers_move is True,
        "it let go": alone and known.gripped and empty and not known.opening,
        "by its last line the hand is left moving": here and "still moving, " in said
        and known.fingers_move is not True,
        "the hand was heard": "cannot be told anything" in said and heard,
        "the hand refuses nothing": "refuses every motion" in said and heard,
        "the hand can be believed": "is not believed" in said and heard,
        "the hand is activated": "is not activated" in said and heard,
        "the hand reports nothing": "the hand reports" in said and heard,
    }  # fmt: skip


def _felt_n(said: str) -> float:
    """The force that a sentence has; 0: none."""
    found = re.search(r"(\d+\.\d) N measured", said)
    return float(found[1]) if found else 0.0
