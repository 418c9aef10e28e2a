"""Slip, lost contact and hold: responses of the controller, and when they end."""

import msgspec
import pytest

from grasp.control.commands import (
    CloseToLimit,
    MoveArm,
    StopArm,
)
from grasp.control.states import State
from tests.unit.grasp.builders import arm
from tests.unit.grasp.controller_driver import HEIGHT, LATCHED, MOVING, RESTING, TICK, Driver


def test_registered_slip_closes_at_the_closing_speed_in_the_same_step() -> None:
    d = Driver().lift()
    d.climb(0.9)
    assert d.commands == []
    d.climb(0.9)
    assert d.commands == [
        StopArm(8.0),
        CloseToLimit(10.0, (True, True, True), (255, 255, 255), 0.11),
    ]


REACH = (58, 57, 57)
FIRST = CloseToLimit(10.0, (True, True, True), REACH, 0.11, first_stage=True)
TOP_UP = CloseToLimit(10.0, (True, True, True), (255, 255, 255), 0.022)


def staged() -> Driver:
    d = Driver(slip_response="close")
    d.reach = REACH
    return d


def test_closing_is_fast_within_safe_travel_and_then_slow_to_the_limit() -> None:
    d = staged().slip()
    assert d.commands == [FIRST]
    for _ in range(5):
        d.climb(0.9, gripper=d.hand(positions=(57, 55, 55), detections=MOVING))
    assert d.commands == [FIRST]
    d.climb(0.9)
    assert d.commands == [FIRST, TOP_UP]
    for _ in range(5):
        d.climb(0.9, gripper=d.hand(positions=(59, 55, 55), detections=MOVING))
    d.climb(0.9)
    assert d.commands == [FIRST, TOP_UP]


def test_both_stages_are_one_response_although_slip_ends_between_them() -> None:
    d = staged().slip()
    for _ in range(40):
        d.climb(0.0)
    assert d.commands == [FIRST, TOP_UP]
    assert d.controller.response.closings == 1
    assert len(d.controller.slip_monitor.events) == 1
    assert d.controller.state is State.LIFT


def test_thumb_that_meets_the_limit_in_the_first_stage_needs_no_second() -> None:
    d = staged().slip()
    for _ in range(30):
        d.climb(gripper=d.hand(positions=(57, 55, 55), detections=LATCHED))
    assert d.commands == [FIRST]
    assert d.controller.state is State.LIFT


def test_overload_after_the_first_stage_prevents_the_second() -> None:
    d = staged().slip()
    for _ in range(2):
        d.climb(0.9, overloaded=True)
    assert d.commands == [FIRST]


def test_contact_lost_in_the_first_stage_gives_one_stage_at_the_closing_speed() -> None:
    d = staged().slip()
    for _ in range(10):
        d.climb(gripper=d.hand(detections=MOVING), estimated_n=(0.0, 0.0, 0.0))
    d.climb(estimated_n=(0.0, 0.0, 0.0))
    assert d.commands == [FIRST, CloseToLimit(10.0, (True, True, True), (255, 255, 255), 0.11)]
    assert d.controller.state is State.COMPENSATE


def test_second_response_has_no_safe_travel_left_and_closes_slowly() -> None:
    d = staged().slip()
    for _ in range(30):
        d.climb()
    d.commands.clear()
    rests = {"positions": (60, 55, 55), "requested": (255, 55, 55), "detections": RESTING}
    for _ in range(2):
        d.climb(0.9, gripper=d.hand(**rests))
    assert d.commands == [TOP_UP]


def test_closing_is_masked_and_does_not_trigger_slip() -> None:
    d = Driver().slip()
    d.commands.clear()
    for _ in range(10):
        d.climb(0.99, gripper=d.hand(detections=MOVING))
    for _ in range(12):  # fingers have stopped, the pads still shake
        d.climb(0.99, gripper=d.hand(detections=LATCHED))
    for _ in range(10):
        d.climb(0.0, gripper=d.hand(detections=LATCHED))
    assert [type(c) for c in d.commands] == [MoveArm]  # on up
    assert d.controller.state is State.LIFT
    assert len(d.controller.slip_monitor.events) == 1


def test_slip_that_continues_at_the_limit_lowers_the_object() -> None:
    d = Driver().slip()
    d.commands.clear()
    since = d.t_ns
    for _ in range(60):
        if d.climb(0.9, gripper=d.hand(detections=LATCHED)).state is State.DESCEND:
            break
    assert d.controller.limit_reached
    assert 0.29e9 <= d.t_ns - since <= 0.35e9
    assert [type(c) for c in d.commands] == [MoveArm]


def test_hold_by_clock_sets_down_in_time_although_slip_stays_registered() -> None:
    d = Driver(slip_response="close", hold_by_clock=True, hold_s=0.5).slip()
    d.commands.clear()
    while d.controller.state is State.COMPENSATE:
        d.climb(0.9, gripper=d.hand(detections=LATCHED))
    assert d.controller.state is State.LIFT
    d.height_m = HEIGHT
    since = d.t_ns
    while d.step(0.9, gripper=d.hand(detections=LATCHED)).state in (State.LIFT, State.HOLD):
        assert d.commands == []  # nothing to close any further
    assert d.controller.state is State.DESCEND
    assert d.t_ns - since == pytest.approx(0.51e9, abs=0.02e9)
    assert d.controller.alarm_stayed and not d.controller.limit_reached


def test_hold_by_clock_still_stops_the_arm_when_contact_is_lost_at_the_limit() -> None:
    d = Driver(hold_by_clock=True, hold_s=5.0).slip()
    while d.controller.state is State.COMPENSATE:
        d.climb(0.9, gripper=d.hand(detections=LATCHED))
    for _ in range(10):
        d.climb(0.9, gripper=d.hand(detections=LATCHED), estimated_n=(0.0, 0.0, 0.0))
    assert d.controller.state is State.LOST


@pytest.mark.parametrize("by_clock", [False, True])
def test_hold_restarts_after_a_slip_response_unless_it_ends_by_the_clock(by_clock: bool) -> None:
    d = Driver(hold_by_clock=by_clock, hold_s=0.5).lift()
    d.height_m = HEIGHT
    d.until(State.HOLD)
    first_ns = d.t_ns
    d.until(State.COMPENSATE, 0.9)
    d.until(State.HOLD)
    began_ns = first_ns if by_clock else d.t_ns
    d.until(State.DESCEND)
    assert d.t_ns - began_ns == 500_000_000


def test_reactions_off_records_slip_without_a_response() -> None:
    d = Driver(reactions=False).lift()
    for _ in range(10):
        d.climb(0.9)
    assert d.commands == []
    assert d.controller.slip_monitor.events


def test_closing_without_contact_is_a_lost_object_and_lowers_nothing() -> None:
    d = Driver().slip()
    empty = d.hand(positions=(255, 55, 55), requested=(255, 55, 55), detections=RESTING)
    for _ in range(20):
        empty = msgspec.structs.replace(empty, t_ns=d.t_ns + TICK)
        d.climb(gripper=empty, estimated_n=(0.0, 0.0, 0.0))
    assert d.controller.state is State.LOST
    assert isinstance(d.commands[-1], StopArm)
    assert not any(isinstance(c, MoveArm) for c in d.commands)


def test_contact_lost_while_lowering_stops_the_arm() -> None:
    d = Driver(hold_s=0.1).lift()
    d.height_m = HEIGHT
    d.until(State.DESCEND)
    d.commands.clear()
    for _ in range(8):
        d.step(estimated_n=(0.0, 0.0, 0.0), arm=arm(d.t_ns + TICK, 0.1, moving=True))
    assert d.controller.state is State.LOST
    assert isinstance(d.commands[0], StopArm)


def test_thumb_without_contact_while_lowering_is_no_loss_if_others_have_contact() -> None:
    d = Driver(hold_s=0.1).lift()
    d.height_m = HEIGHT
    d.until(State.DESCEND)
    for _ in range(20):
        d.step(estimated_n=(0.1, 1.0, 1.0), arm=arm(d.t_ns + TICK, 0.1, moving=True))
    assert d.controller.state is State.DESCEND


def test_closing_without_effect_is_not_sent() -> None:
    d = Driver().slip()
    for _ in range(40):
        d.climb(0.0)
    assert d.controller.state is State.LIFT
    d.commands.clear()
    for _ in range(10):
        d.climb(0.9)
    assert d.controller.state is State.COMPENSATE
    assert [type(c) for c in d.commands] == [StopArm]
    assert d.controller.response.closings == 1


def test_repeated_alarms_at_the_limit_extend_the_hold_by_a_bounded_time() -> None:
    d = Driver(hold_s=0.5).slip()
    d.height_m = HEIGHT
    began = d.t_ns
    while d.controller.state is not State.DESCEND and d.t_ns - began < 10_000_000_000:
        d.step(0.9 if d.t_ns // TICK % 6 < 3 else 0.0)
    assert d.t_ns - began < 3_500_000_000
    assert d.controller.response.closings == 1


def test_repeated_alarms_under_overload_extend_the_hold_by_a_bounded_time() -> None:
    d = Driver(hold_s=0.5).slip()
    d.height_m = HEIGHT
    began = d.t_ns
    while d.controller.state is not State.DESCEND and d.t_ns - began < 10_000_000_000:
        d.step(0.9 if d.t_ns // TICK % 40 < 3 else 0.0, last_close=None, overloaded=True)
    assert d.t_ns - began < 3_500_000_000


def test_repeated_slip_gets_a_response_as_long_as_a_closing_has_effect() -> None:
    d = Driver(hold_s=0.5).slip()
    d.height_m = HEIGHT
    began = d.t_ns
    while d.controller.state is not State.DESCEND and d.t_ns - began < 4_000_000_000:
        short = d.hand(detections=RESTING)  # of the cap
        d.step(0.9 if d.t_ns // TICK % 40 < 3 else 0.0, last_close=None, gripper=short)
    assert d.controller.state is not State.DESCEND
    assert d.controller.response.closings > 5
