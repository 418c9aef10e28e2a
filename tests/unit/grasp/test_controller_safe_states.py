"""Safe states of the controller: commands after faults and stops, and their duration."""

import pytest

from grasp.control.commands import (
    CloseToLimit,
    HoldFingers,
    StopArm,
)
from grasp.control.controller_settings import ControllerSettings
from grasp.control.fault import Fault
from grasp.control.monitors.checks import failed
from grasp.control.states import State
from tests.unit.grasp.builders import LOST, STOP, arm, frame, gripper, observation
from tests.unit.grasp.controller_driver import MOVING, TICK, Driver

FAULTS = [
    {"errors": LOST},
    {"frame": frame(stale=True)},
    {"gripper": gripper(-200_000_000)},
    {"arm": arm(-200_000_000)},
    {"gripper": gripper(0, fault=13)},
    {"arm": arm(0, stopped_by_safety=True)},
]


@pytest.mark.parametrize("change", FAULTS, ids=lambda c: next(iter(c)))
def test_fault_before_contact_stops_and_does_not_close(change: dict[str, object]) -> None:
    d = Driver()
    d.step()
    d.commands.clear()
    d.step(**change)
    assert d.controller.state is State.FAULT
    assert d.commands == [StopArm(1.0), HoldFingers()]


@pytest.mark.parametrize("change", FAULTS, ids=lambda c: next(iter(c)))
def test_fault_in_the_air_stops_the_arm_and_closes_to_the_limit(change: dict[str, object]) -> None:
    d = Driver().lift()
    d.step(**change)
    assert d.commands[0] == StopArm(1.0)
    assert isinstance(d.commands[1], CloseToLimit)
    assert d.commands[1].force_limit_n == 10.0


def test_lost_gripper_stops_the_arm_and_commands_nothing_else() -> None:
    d = Driver().lift()
    d.step(errors=LOST, gripper_lost=True)
    assert d.commands == [StopArm(1.0)]


def test_run_finishes_once_the_safe_state_is_confirmed() -> None:
    d = Driver().lift()
    d.step(errors=LOST)
    d.commands.clear()
    d.step()
    assert not d.controller.finished  # an earlier command may still start the hand
    d.rest()
    assert d.controller.finished
    assert d.commands == []


def test_stop_is_repeated_until_the_arm_has_stopped() -> None:
    d = Driver().lift()
    d.step(errors=LOST)
    for _ in range(100):
        d.climb()
    stops = [c for c in d.commands if isinstance(c, StopArm)]
    assert 8 <= len(stops) <= 11
    assert not d.controller.finished
    d.rest()
    assert d.controller.finished


def test_unconfirmed_safe_state_ends_in_time_and_names_the_unconfirmed_parts() -> None:
    d = Driver().lift()
    d.step(errors=LOST)
    for _ in range(310):
        d.climb()
    assert d.controller.finished
    assert d.controller.unconfirmed == ("the arm still moves",)


FROZEN = failed("arm_frozen", seconds=0.4)
UNCONFIRMED = failed("gripper_unconfirmed", seconds=0.16, how="")


@pytest.mark.parametrize(
    "change",
    [
        {"faults": (FROZEN,)},
        {"faults": (failed("loop_stood_still", seconds=0.2), FROZEN)},
        {"errors": LOST, "faults": (*LOST, FROZEN)},
    ],
    ids=["alone", "after another check", "after an error"],
)
def test_implausible_arm_is_stopped_repeatedly_and_never_confirmed(
    change: dict[str, object],
) -> None:
    d = Driver().lift()
    d.step(**change)
    for _ in range(310):
        d.step()
    assert sum(isinstance(c, StopArm) for c in d.commands) > 20
    assert d.controller.finished
    assert "unknown" in d.controller.unconfirmed[0]


@pytest.mark.parametrize("closes", [State.BRACE, State.CLOSE, "firmly"])
def test_closing_hand_is_held_when_a_person_stops_the_run(closes: str) -> None:
    d = Driver(firm=closes == "firmly")
    d.until(State.BRACE if closes == State.BRACE else State.CLOSE)
    if closes == "firmly":
        d.until_next()
    d.commands.clear()
    d.step(stop=STOP)
    assert d.commands == [StopArm(1.0), HoldFingers()]
    d.step(gripper=d.hand(detections=MOVING))
    assert not d.controller.finished
    d.rest()
    assert d.controller.finished


def test_half_done_closing_is_finished_when_a_person_stops_the_run() -> None:
    d = Driver(slip_response="close").lift()
    d.reach = (60, 55, 55)
    d.climb(0.9)
    d.climb(0.9)
    (first,) = (c for c in d.commands if isinstance(c, CloseToLimit))
    assert first.first_stage
    d.commands.clear()
    d.step(stop=STOP)
    assert [type(c) for c in d.commands] == [StopArm, CloseToLimit]
    assert d.controller.state is State.STOPPED


def test_internal_error_during_a_fault_in_the_air_does_not_end_the_closing() -> None:
    d = Driver().lift()
    d.step(errors=LOST)
    assert [type(c) for c in d.controller.abort_commands()] == [StopArm, CloseToLimit]


def test_after_an_abort_old_states_and_a_moving_arm_confirm_nothing() -> None:
    d = Driver().lift()
    stop, *_ = d.controller.abort_commands()
    assert stop == StopArm(ControllerSettings().stop_deceleration_mps2)
    moving = observation(d.t_ns + TICK, arm=arm(d.t_ns + TICK, 0.05, moving=True))
    assert d.controller.unconfirmed_parts(moving).arm == ("the arm still moves",)
    old = observation(d.t_ns + 10**10, gripper=d.hand(), arm=arm(d.t_ns))
    arm_text, hand_text = d.controller.unconfirmed_parts(old)
    assert "does not report" in arm_text[0] and "does not report" in hand_text[0]


@pytest.mark.parametrize(
    "fault",
    [failed("arm_wrong_way", mm=50.0), failed("gripper_impossible", finger="A", how="jumped")],
)
def test_later_fault_in_a_safe_state_is_reported_once_and_changes_no_command(fault: Fault) -> None:
    d = Driver().lift()
    d.step(faults=(UNCONFIRMED,))
    d.commands.clear()
    for _ in range(20):
        d.step(faults=(failed("gripper_unconfirmed", seconds=0.3, how=""), fault))
    assert d.controller.faults == (UNCONFIRMED,)
    d.step(faults=(failed("fingertips_frozen", samples=9),))
    assert [f.code for f in d.controller.later_faults] == [fault.code, "fingertips_frozen"]
    assert {type(c) for c in d.commands} <= {StopArm, CloseToLimit}


def test_arm_that_becomes_implausible_in_the_safe_state_is_not_confirmed() -> None:
    d = Driver().lift()
    d.step(errors=LOST, arm=arm(d.t_ns + TICK, 0.05, moving=True))
    d.step(faults=(failed("arm_wrong_way", mm=50.0),))
    assert not d.controller.finished
    for _ in range(310):
        d.step()
    assert "unknown" in d.controller.unconfirmed[0]
    assert sum(isinstance(c, StopArm) for c in d.commands) > 20


@pytest.mark.parametrize("phase", [State.SETTLE, State.LIFT])
def test_fault_after_a_person_has_stopped_the_run_keeps_the_grip_as_it_is(phase: State) -> None:
    d, frozen = Driver(), failed("fingertips_frozen", samples=9)
    d.until(phase)
    d.commands.clear()
    d.step(stop=STOP, arm=arm(d.t_ns + TICK, 0.05, moving=True))
    for _ in range(20):
        d.step(faults=(frozen,), arm=arm(d.t_ns + TICK, 0.05, moving=True))
    assert d.controller.state is State.STOPPED
    assert d.controller.later_faults == (frozen,)
    assert {type(c) for c in d.commands} == {StopArm}


def test_safe_state_is_not_requested_again_while_the_request_is_pending() -> None:
    d = Driver().lift()
    d.step(errors=LOST)
    d.commands.clear()
    for _ in range(50):
        d.climb(pending=True)
    assert d.commands == []


def test_gripper_that_reconnects_still_gets_the_closing() -> None:
    d = Driver().lift()
    d.step(errors=LOST, gripper_lost=True)
    for _ in range(8):
        d.step(gripper_lost=True)
    assert not any(isinstance(c, CloseToLimit) for c in d.commands)
    for _ in range(20):
        d.step()
    assert sum(isinstance(c, CloseToLimit) for c in d.commands) == 1
    assert d.controller.finished


@pytest.mark.parametrize("phase", [State.SHAPE, State.SETTLE, State.BASELINE, State.LIFT])
def test_interruption_stops_the_arm_and_never_opens_a_grip(phase: State) -> None:
    d = Driver(stop_deceleration_mps2=2.0)
    d.until(phase)
    d.commands.clear()
    d.step(stop=STOP, arm=arm(d.t_ns + TICK, 0.05, moving=True))
    assert d.controller.state is State.STOPPED
    assert d.commands == [StopArm(2.0), *([HoldFingers()] if phase is State.SHAPE else [])]
    d.rest()
    assert d.controller.finished
    assert d.controller.unconfirmed == ()
