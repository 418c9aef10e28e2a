"""Whether the last line of a run on the emulated cell is so: what it says of the cause, of arm and
hand, beside what the cell knows when it is all over. That something moves then is no question of
words, and is asked elsewhere."""

import re

import msgspec

from scenarios.studies.faults.verdict import BLAMED, FELT_N, GRIPPED_N, TOUCH_N

STILL_MPS = 1e-4
TIMED_OUT = r"did not end in time|lasted longer than"  # a run that nothing else has ended
LATE = r"stale|stands still|stood still|silent|does not answer|no data|in time|_late\b|loop_"


class Known(msgspec.Struct, frozen=True, kw_only=True):
    """What the cell knows after the end; None: nobody looked. ``wrong``: devices, as in ``BLAMED``,
    that something was wrong with, and "loop" where the machine was not there."""

    wrong: frozenset[str]
    pressed_n: float | None = None  # by the most loaded finger
    opened: bool | None = None  # the hand


def misled(message: str, arm: str, hand: str, known: Known) -> list[str]:
    """What it says and is not so, or does not say."""
    sentences = {**_of_arm(arm, known), **_of_hand(hand, known)}
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


def _of_arm(said: str, known: Known) -> dict[str, bool]:
    heard = not known.wrong & {"arm", "loop"}
    return {
        "no word of the arm": not said,
        "by its last line the arm is left moving": said.startswith("the arm is still moving"),
        "the arm was heard": "when last heard" in said and heard,
        "the arm can be believed": said.startswith("the arm says") and heard,
        "no safety system stopped the arm": "its own safety system" in said
        and "arm" not in known.wrong,
    }


def _of_hand(said: str, known: Known) -> dict[str, bool]:
    heard = not known.wrong & {"gripper", "loop"}
    here = "when last heard" not in said and "says that it is" not in said
    pressed_n = known.pressed_n
    presses = pressed_n is not None and pressed_n > FELT_N
    empty = pressed_n is not None and pressed_n <= TOUCH_N
    return {
        "no word of the hand": not said,
        "the hand is not open": said == "the hand is open" and (presses or known.opened is False),
        "it is not closed to the limit": here and "closed to the limit" in said
        and pressed_n is not None and pressed_n < GRIPPED_N,
        "it feels something": here and "feels nothing" in said and presses,
        "it holds nothing": here and "closed as it was" in said and "partly" not in said and empty,
        "by its last line the hand is left moving": here and "still moving, " in said,
        "the hand was heard": "cannot be told anything" in said and heard,
        "the hand refuses nothing": "refuses every motion" in said and heard,
        "the hand can be believed": "is not believed" in said and heard,
        "the hand is activated": "is not activated" in said and heard,
        "the hand reports nothing": "the hand reports" in said and heard,
    }  # fmt: skip
