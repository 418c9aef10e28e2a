"""Closing to the cap, in one stage or in two."""

from typing import Any

import msgspec
import pytest

from drivers.interfaces import Counts3, Detection
from grasp.control.commands import CloseToLimit
from grasp.control.contact_estimator import Stiffness
from grasp.control.controller_settings import ControllerSettings, GripPlan
from grasp.control.lift_line import LiftLine
from grasp.control.observation import Observation
from grasp.control.slip_response.close import STAGE_NS, SlipResponse
from tests.unit.grasp.builders import gripper, observation

S = ControllerSettings(closing_speed_mps=0.1)
LIMIT_N = 10.0
REACH: Counts3 = (60, 61, 62)
FIRST = CloseToLimit(LIMIT_N, (True, True, True), REACH, 0.1, first_stage=True)
SLOWLY = CloseToLimit(LIMIT_N, (True, True, True), (255, 255, 255), 0.022)
AT_ONCE = CloseToLimit(LIMIT_N, (True, True, True), (255, 255, 255), 0.1)
MOVING = (Detection.MOVING,) * 3


def hand(t_ns: int = 0, thumb: int = 55, first: bool = False, **changes: Any) -> Observation:
    """Observation of a hand at rest, after a first stage or without one."""
    values: dict[str, Any] = {
        "gripper": gripper(t_ns, (thumb, 55, 55)),
        "safe_travel_counts": REACH,
    }
    return observation(t_ns, last_close=FIRST if first else None, **values | changes)


def response(**settings: Any) -> SlipResponse:
    s = msgspec.structs.replace(S, **settings)
    plan = GripPlan((40, 55, 55), (55, 55, 55), LIMIT_N, Stiffness(1.9))
    return SlipResponse(s, plan, LiftLine(s, (0.0, 0.0, 0.0)))


def test_first_stage_moves_to_a_position_at_full_speed() -> None:
    assert response().closing(hand()) == FIRST


@pytest.mark.parametrize(("lost", "safe_travel"), [(True, REACH), (False, None)])
def test_unknown_contact_position_gives_one_stage(lost: bool, safe_travel: Any) -> None:
    assert response().closing(hand(safe_travel_counts=safe_travel), lost) == AT_ONCE


def test_constant_closing_has_one_stage_and_one_speed() -> None:
    constant = response(closing="constant")
    assert constant.closing(hand()) == constant.slow_closing() == AT_ONCE
    assert response().slow_closing() == SLOWLY


@pytest.mark.parametrize(("thumb", "expected"), [(59, FIRST), (60, SLOWLY), (61, SLOWLY)])
def test_no_first_stage_if_the_thumb_was_commanded_to_its_safe_travel(
    thumb: int, expected: CloseToLimit
) -> None:
    """Fingers B and C have more travel left."""
    assert response().closing(hand(thumb=thumb)) == expected


def test_thumb_in_contact_has_no_first_stage() -> None:
    latched = gripper(0, (55, 55, 55), (Detection.CONTACT_CLOSING,) * 3)
    assert response().closing(hand(gripper=latched)) == SLOWLY


@pytest.mark.parametrize(("first", "expected"), [(True, FIRST), (False, SLOWLY)])
def test_closing_is_repeated_unchanged_while_the_hand_moves(
    first: bool, expected: CloseToLimit
) -> None:
    moving = gripper(0, (55, 55, 55), MOVING)
    assert response().closing(hand(gripper=moving, first=first)) == expected


def test_second_stage_follows_at_any_rest_position_of_the_first() -> None:
    assert response().closing(hand(thumb=57, first=True)) == SLOWLY


def test_first_stage_that_does_not_end_in_time_is_not_waited_for() -> None:
    two_stage = response()

    def moving(t_ns: int) -> CloseToLimit:
        return two_stage.closing(hand(t_ns, gripper=gripper(t_ns, detections=MOVING), first=True))

    assert STAGE_NS == 500_000_000
    requested_ns = 10**9
    assert two_stage.closing(hand(requested_ns)) == FIRST
    assert moving(requested_ns + STAGE_NS // 2) == FIRST
    assert moving(requested_ns + STAGE_NS) == FIRST
    assert moving(requested_ns + STAGE_NS + 1) == SLOWLY
    later_ns = requested_ns + 3 * STAGE_NS  # another response has its own time
    assert two_stage.closing(hand(later_ns)) == FIRST
    assert moving(later_ns + STAGE_NS) == FIRST
