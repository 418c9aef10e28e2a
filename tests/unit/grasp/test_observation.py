"""Properties of an observation: whether the hand is at rest, and whether it is at the cap."""

from typing import Any

from drivers.interfaces import Detection
from grasp.control.commands import CloseToLimit
from tests.unit.grasp.builders import gripper, observation
from tests.unit.grasp.controller_driver import LATCHED, MOVING

THUMB = CloseToLimit(10.0, (True, False, False), (60, 255, 255), 0.06)
AT_60 = gripper(positions=(60, 55, 55))
SHORT = gripper(positions=(59, 55, 55))

AT, LAST = {"gripper": AT_60}, {"last_close": THUMB}
OTHER = (Detection.AT_TARGET, Detection.CONTACT_CLOSING, Detection.AT_TARGET)
GOING = gripper(positions=(60, 55, 55), detections=MOVING)
CAPS: list[tuple[str, dict[str, Any], bool]] = [
    ("the last count", AT | LAST, True),
    ("short of it", {"gripper": SHORT, **LAST}, False),
    ("in contact", {"gripper": gripper(detections=LATCHED), **LAST}, True),
    ("nothing was closed", AT, False),
    ("a command on its way to the arm", {**AT, **LAST, "pending": True}, True),
    ("still moving", {"gripper": GOING, **LAST}, False),
    ("another finger in contact", {"gripper": gripper(detections=OTHER), **LAST}, False),
]


def test_hand_is_at_the_limit_if_another_closing_has_no_effect() -> None:
    for name, inputs, at_limit in CAPS:
        assert observation(0, **inputs).at_limit is at_limit, name
