"""What follows from what a step was told: whether the hand rests, and stands at the cap."""

from typing import Any

import pytest

from drivers.interfaces import Detection
from grasp.commands import CloseFast
from tests.unit.grasp.builders import gripper, seen
from tests.unit.grasp.controller_driver import LATCHED, MOVING

THUMB = CloseFast(10.0, (True, False, False), (60, 255, 255), 0.06)
AT_60 = gripper(positions=(60, 55, 55))
SHORT = gripper(positions=(59, 55, 55))

CAPS: list[tuple[str, dict[str, Any], bool]] = [
    ("the last count", {"gripper": AT_60, "last_close": THUMB}, True),
    ("short of it", {"gripper": SHORT, "last_close": THUMB}, False),
    ("in contact", {"gripper": gripper(detections=LATCHED), "last_close": THUMB}, True),
    ("nothing was closed", {"gripper": AT_60}, False),
    (
        "a command on its way to the arm",
        {"gripper": AT_60, "last_close": THUMB, "pending": True},
        True,
    ),
    (
        "still moving",
        {"gripper": gripper(positions=(60, 55, 55), detections=MOVING), "last_close": THUMB},
        False,
    ),
    (
        "another finger in contact",
        {
            "gripper": gripper(
                detections=(Detection.AT_TARGET, Detection.CONTACT_CLOSING, Detection.AT_TARGET)
            ),
            "last_close": THUMB,
        },
        False,
    ),
]


@pytest.mark.parametrize(("told", "at_cap"), [c[1:] for c in CAPS], ids=[c[0] for c in CAPS])
def test_hand_is_at_the_cap_where_another_closing_would_do_nothing(
    told: dict[str, Any], at_cap: bool
) -> None:
    assert seen(0, **told).at_cap is at_cap
