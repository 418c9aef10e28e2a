"""Checks the last line of a run: cause and final state of arm and hand must be true.

Shared by the fault tests in virtual time, the chaos tests and the soak test.
"""

import os
import re

import msgspec

from grasp.control.guard import GuardSettings

MOST_N = GuardSettings().force_limit_n + GuardSettings().overshoot_n  # true force of a finger
FIRST_GRASP = os.environ.get("FIRST_GRASP", "counts")  # of the lifts
# least force of a hand closed to the limit, even after slip; by touch, fingertips read too much
GRIPPED_N = 7.0 if FIRST_GRASP == "counts" else 4.5
MISREAD_N = 1.5  # error of fingertips without a fault
PRESSED_N, TOUCH_N = 1.0, 0.05  # clear contact; less is no contact
STILL_MPS, SLIDES_MPS = 1e-4, 1e-3
DROPPED_M, SLID_M = 0.003, 0.015  # height of a dropped object; slip that counts as dropped
TIMED_OUT = r"did not end in time|lasted longer than"
LATE = r"stale|stands still|stood still|silent|does not answer|no data|in time|_late\b|loop_"
# the hand could not be commanded, and the last line says so
CANNOT_COMMAND = r"holds by itself|status is implausible|refuses every motion|does not report"
DEVICE_WORDS = {
    "gripper": r"gripper|\bhand\b|\bfingers?\b|thumb",
    "arm": r"\barm\b|\barm_",
    "fingertips": r"fingertip|tactile|taxel|estimated force",
    "detector": r"detector",
    "loop": r"loop_|the control step began",
}
WAY_OUT = "open the hand"  # advice of the simulated rig


class Known(msgspec.Struct, frozen=True, kw_only=True):
    """True state after the end; None: not observed. ``wrong``: devices with a fault, by their names
    in ``DEVICE_WORDS``; "loop" where the machine stalled."""

    wrong: frozenset[str]
    pressed_n: float | None = None  # by the most loaded finger
    opened: bool | None = None  # the hand
    arm_moves: bool | None = None
    fingers_move: bool | None = None
    gripped: bool = False  # as the safe state began
    opening: bool = False  # the hand was commanded to open
    safety_stop: bool | None = None  # of the arm, by its own safety system


def false_statements(message: str, arm: str, hand: str, known: Known) -> list[str]:
    """False or missing statements of the last line."""
    sentences = {**_of_arm(arm, known), **_of_hand(hand, known)}
    found = [text for text, is_wrong in sentences.items() if is_wrong]
    return [*found, *filter(None, [wrong_cause(message, known.wrong)])]


def wrong_cause(message: str, wrong: frozenset[str]) -> str:
    """The problem if the cause names only devices without a fault, or none. Lateness is no problem
    where the machine stalled."""
    named = {device for device, words in DEVICE_WORDS.items() if re.search(words, message)}
    if not message:
        return "no cause"
    if message.startswith("lost: "):  # of the object: no device is named
        return ""
    if not named:
        return f"names no device: {message}"
    if "loop" in wrong and re.search(LATE, message):
        return ""
    innocent = named - wrong
    if named <= innocent or "detector" in innocent:
        return f"nothing is wrong with the {' and '.join(sorted(innocent))}: {message}"
    return ""


def _of_arm(text: str, known: Known) -> dict[str, bool]:
    reachable = not known.wrong & {"arm", "loop"}
    stopped = "its own safety system" in text
    safety = "arm" in known.wrong if known.safety_stop is None else known.safety_stop
    return {
        "no state of the arm": not text,
        "the arm moves": text == "the arm is stationary" and known.arm_moves is True,
        "by its last line the arm is left moving": text.startswith("the arm is still moving")
        and known.arm_moves is not True,
        "the arm was reachable": "at its last status" in text and reachable,
        "the arm's status is plausible": text.startswith("the arm reports") and reachable,
        "the arm moves, and no safety system stops it": stopped and known.arm_moves is True,
        "no safety system stopped the arm": stopped and not safety,
    }


def _of_hand(text: str, known: Known) -> dict[str, bool]:
    reachable = not known.wrong & {"gripper", "loop"}
    current = "at its last status" not in text and "reports that it is" not in text
    pressed_n, measured = known.pressed_n, re.search(r"(\d+\.\d) N measured", text)
    estimated_n = float(measured[1]) if measured else 0.0
    presses = pressed_n is not None and pressed_n > PRESSED_N
    empty = pressed_n is not None and pressed_n <= TOUCH_N
    alone = "holds by itself" in text
    return {
        "no state of the hand": not text,
        "the hand is not open": text == "the hand is open" and (presses or known.opened is False),
        "it is not closed to the limit": current and pressed_n is not None
        and pressed_n < GRIPPED_N
        and ("closed to the limit" in text or "closed to its last count" in text),
        "its force is less": current and pressed_n is not None and "fingertips" not in known.wrong
        and estimated_n > pressed_n + MISREAD_N,
        "it has contact": current and "without measured contact" in text and presses
        and not ("may still be in it" in text and "fingertips" in known.wrong),
        "it holds nothing": current and "with its previous grip" in text and empty,
        "the fingers move": alone and known.fingers_move is True,
        "it opened": alone and known.gripped and empty and not known.opening,
        "by its last line the hand is left moving": current and "still moving, " in text
        and known.fingers_move is not True,
        "the hand was reachable": "cannot be commanded" in text and reachable,
        "the hand refuses nothing": "refuses every motion" in text and reachable,
        "the hand's status is plausible": "status is implausible" in text and reachable,
        "the hand is activated": "is not activated" in text and reachable,
        "the hand reports no fault": "the hand reports" in text and reachable,
    }  # fmt: skip
