"""The mode that the hand is in: how B and C are spread (rMOD, gMOD). Whatever this program knows
of positions and forces is of basic mode.
"""

from typing import Final

from drivers.errors import Refused

NAMES: Final = ("basic", "pinch", "wide", "scissor")
BASIC: Final = 0
SCISSOR: Final = 3
TO_BASIC: Final = "`grasp gripper activate`, with an empty hand, sets basic mode"
SPREADS: Final = "; it is in scissor mode: B and C are spread apart too"


def check_closing(mode: int) -> None:
    """Raises Refused in scissor mode, where B and C close on each other and no guard knows of it:
    such a hand is told nothing but to open."""
    if mode == SCISSOR:
        raise Refused(
            "the hand is in scissor mode, in which it is only opened",
            f"support what it holds, `grasp release`; then {TO_BASIC}",
        )


def other_than_basic(mode: int) -> str:
    """What is to be known of a hand that is not in basic mode; empty for one that is."""
    if mode == BASIC:
        return ""
    return f"in {NAMES[mode]} mode: positions, forces and calibrations here are of basic mode"
