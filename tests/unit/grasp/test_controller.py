"""The controller as a pure function: observations in, commands out."""

import pytest

from drivers.interfaces import Detection
from grasp.control.commands import (
    BeginRest,
    CloseToLimit,
    HoldFingers,
    MoveArm,
    MoveFingers,
    OpenFingers,
    StopArm,
)
from grasp.control.controller_settings import ControllerSettings
from grasp.control.fault import lines
from grasp.control.monitors.checks import failed
from grasp.control.states import State
from tests.unit.grasp.builders import arm, frame, gripper, observation
from tests.unit.grasp.controller_driver import HEIGHT, LATCHED, MOVING, RESTING, TICK, Driver


def test_approach_shapes_the_hand_then_takes_rest_counts_then_grasps() -> None:
    d = Driver()
    d.until(State.BRACE)
    assert [type(c) for c in d.commands] == [MoveFingers, BeginRest, MoveFingers]
    targets = [c.targets_counts for c in d.commands if isinstance(c, MoveFingers)]
    assert targets == [(0, 40, 40), (25, 55, 55)]  # the thumb comes last
    assert d.until(State.CLOSE).commands[0].targets_counts == (55, 55, 55)  # the thumb comes last


def test_grasp_waits_until_the_status_is_fresh_and_no_command_is_on_its_way() -> None:
    d = Driver()
    d.until(State.BRACE)
    for fresh, detections, pending in ((True, RESTING, True), (False, RESTING, False),
                                       (True, MOVING, False)):  # fmt: skip
        for _ in range(80):
            now = d.hand(detections=detections, fresh=fresh)
            assert d.step(gripper=now, pending=pending).state is State.BRACE
    assert not d.controller.slip_monitor.status.armed


def test_approach_waits_for_the_hand_and_for_the_arm_at_its_home() -> None:
    d = Driver(home=(0.3, 0.2, 0.4))
    d.until(State.SHAPE)
    waits: tuple[dict[str, object], ...] = (
        {"gripper": d.hand(detections=MOVING)},
        {"pending": True},
        {"arm": arm(TICK, 0.02)},
        {"arm": arm(TICK, 0.0, moving=True)},
    )
    assert {d.step(**wait).state for wait in waits} == {State.SHAPE}
    d.until_next()
    assert d.controller.state is State.TARE


def test_lost_preshape_command_is_repeated() -> None:
    d = Driver()
    d.until(State.SHAPE)
    command = d.commands.pop()
    for _ in range(3):
        assert d.step(gripper=d.hand(positions=(0, 0, 0))).state is State.SHAPE
        assert d.commands.pop() == command
    d.until_next()
    assert d.controller.state is State.TARE


def test_object_wider_than_stated_ends_the_run_before_the_thumb_presses_it() -> None:
    d = Driver()
    d.until(State.SHAPE)
    stopped = (Detection.AT_TARGET, Detection.CONTACT_CLOSING, Detection.AT_TARGET)
    d.step(gripper=d.hand(positions=(0, 33, 40), requested=(0, 40, 40), detections=stopped))
    assert d.controller.state is State.FAULT
    assert "finger B stopped on contact" in lines(d.controller.faults)
    pushed = Driver()
    pushed.until(State.BRACE)
    moving = pushed.hand(detections=MOVING)
    for estimated_n in ((0.3, 0.2, 0.2), (0.2, 0.3, 0.3)):  # one side alone proves nothing
        now = observation(pushed.t_ns, estimated_n=estimated_n, gripper=moving)
        assert pushed.controller.step(now).state is State.BRACE
    wide = observation(pushed.t_ns, estimated_n=(0.3, 0.1, 0.3), gripper=moving)
    assert pushed.controller.step(wide).commands == (StopArm(1.0), HoldFingers())
    assert "wider" in lines(pushed.controller.faults)
    assert "grip_counts" in pushed.controller.faults[0].remedy


def test_tare_ends_only_once_the_hand_is_at_rest() -> None:
    d = Driver()
    d.until(State.TARE)
    assert d.step(gripper=d.hand(detections=MOVING)).state is State.TARE
    assert d.step(pending=True).state is State.TARE
    assert d.step(rest_taken=False).state is State.TARE
    assert d.step().state is State.BRACE


def test_arm_is_home_only_once_the_hand_rests_and_no_command_is_on_its_way() -> None:
    d = Driver(home=(0.3, 0.2, 0.4))
    d.height_m = 0.05
    assert d.step().state is State.HOME
    d.height_m = 0.0
    assert d.step(gripper=d.hand(detections=MOVING)).state is State.HOME
    assert d.step(pending=True).state is State.HOME
    assert d.step().state is State.SHAPE


def test_finger_latched_by_contact_in_the_grasp_is_a_fault_and_nothing_is_lifted() -> None:
    d = Driver()
    d.until(State.BRACE)
    d.commands.clear()
    d.step(gripper=d.hand(detections=LATCHED))
    assert d.controller.state is State.FAULT
    assert "finger A" in lines(d.controller.faults)
    assert d.commands == [StopArm(1.0), HoldFingers()]


def test_detector_is_reset_and_armed_only_once_the_fingers_rest() -> None:
    d = Driver()
    d.until(State.BRACE)
    resets = [d.step().reset_detector for _ in range(40)]
    assert resets.count(True) == 2  # at rest, and again when listening begins
    assert d.controller.slip_monitor.status.armed


def test_firm_grip_closes_to_the_limit_and_settles_once_the_thumb_has_stopped() -> None:
    d = Driver(firm=True)
    d.until(State.CLOSE)
    d.until_next()
    assert d.commands[-1] == CloseToLimit(10.0, (True, True, True), (255, 255, 255), 0.022)
    d.step(gripper=d.hand(detections=MOVING))
    assert d.controller.state is State.CLOSE
    for _ in range(70):
        d.step(gripper=d.hand(detections=LATCHED))
    phases = [c.phase for c in d.controller.machine.log]
    assert phases == [
        "approach.shape", "grasp.tare", "grasp.brace", *["grasp.close"] * 2, "grasp.settle",
        "grasp.baseline", "lift",
    ]  # fmt: skip


def test_thumb_that_meets_no_object_in_a_firm_grip_is_a_fault_before_the_lift() -> None:
    d = Driver(firm=True)
    d.until(State.CLOSE)
    d.until_next()
    d.commands.clear()
    d.step(gripper=d.hand(positions=(255, 55, 55), detections=RESTING))
    assert d.controller.state is State.FAULT
    assert "met no object" in lines(d.controller.faults)
    assert d.commands == [StopArm(1.0), HoldFingers()]


def test_first_grasp_is_set_only_when_the_arm_starts_to_rise() -> None:
    d = Driver()
    decisions = [d.step() for _ in range(90)]
    assert [x.state for x in decisions if x.first_grasp] == [State.LIFT]


def test_finished_lift_sets_down_opens_and_retreats() -> None:
    d = Driver(hold_s=0.1).lift()
    d.height_m = HEIGHT
    d.until(State.DESCEND)
    d.height_m = 0.0
    d.until(State.OPEN)
    d.height_m = 0.05
    d.until(State.SET_DOWN)
    assert d.controller.finished
    assert [type(c) for c in d.commands] == [MoveArm, OpenFingers, MoveArm]


def test_closed_hand_is_a_fault_before_the_arm_moves() -> None:
    d = Driver(home=(0.3, 0.2, 0.4))
    d.height_m = 0.05
    d.step(gripper=gripper(TICK, positions=(255, 55, 55)))
    assert d.controller.state is State.FAULT
    assert not any(isinstance(c, MoveArm) for c in d.commands)


def test_arm_that_never_reaches_the_top_is_a_fault() -> None:
    d = Driver(phase_timeout_s=1.0).slip()
    d.height_m = HEIGHT - 0.0015
    for _ in range(200):
        d.step()
    assert d.controller.state is State.FAULT


def test_force_that_stays_above_the_limit_while_the_arm_moves_is_a_fault() -> None:
    d = Driver(hold_s=0.1).lift()
    d.height_m = HEIGHT
    d.until(State.DESCEND)
    for _ in range(5):
        d.step(overloaded=True, arm=arm(d.t_ns + TICK, 0.1, moving=True))
    assert d.controller.state is State.FAULT
    assert "force" in lines(d.controller.faults)


def test_force_above_the_limit_is_no_fault_while_the_arm_is_at_rest() -> None:
    d = Driver(hold_s=1.0).lift()
    d.height_m = HEIGHT
    d.until(State.HOLD)
    for _ in range(50):
        d.step(overloaded=True)
    assert d.controller.state is State.HOLD


def test_missing_contact_is_a_fault_before_the_lift() -> None:
    d = Driver()
    d.until(State.BRACE, estimated_n=(0.0, 0.0, 0.0))
    for _ in range(80):
        d.step(estimated_n=(0.0, 0.0, 0.0))
    assert d.controller.state is State.FAULT
    assert "no contact" in lines(d.controller.faults)
    assert not any(isinstance(c, MoveArm) for c in d.commands)


UNLOADED = {"estimated_n": (2.0, 2.0, 0.02)}  # finger C


def test_finger_without_load_closes_by_single_counts_until_it_is_loaded() -> None:
    d = Driver()
    d.until(State.SETTLE)
    for counts in (56, 57):
        decision = d.until(State.CLOSE, **UNLOADED)
        assert decision.commands == (MoveFingers((55, 55, counts), 0.022, 10.0),)
        d.until(State.SETTLE, **UNLOADED)
    d.until(State.LIFT)
    assert d.requested == (55, 55, 57)


@pytest.mark.parametrize(
    ("settings", "estimated_n", "counts"),
    [({}, (2.0, 2.0, 0.02), 5),  # also a fingertip that feels no load
     ({}, (8.5, 8.5, 0.02), 0),  # another count could pass the limit of 10 N
     ({"firm": True}, (7.0, 7.0, 0.02), 0)],
)  # fmt: skip
def test_finger_that_stays_without_load_is_a_fault_before_the_lift(
    settings: dict[str, object], estimated_n: tuple[float, ...], counts: int
) -> None:
    d = Driver(**settings)  # type: ignore[arg-type]
    d.until(State.FAULT, estimated_n=estimated_n)
    cause = f"finger C bears nothing: its fingertip shows 0.02 N after {counts} more counts; "
    assert lines(d.controller.faults).startswith(cause)
    assert "grip_counts" in d.controller.faults[0].remedy
    assert d.requested == (55, 55, 55 + counts)
    assert not any(isinstance(c, MoveArm | OpenFingers) for c in d.commands)


def test_hand_stops_closing_on_a_fingertip_that_shows_nothing_while_the_thumb_feels_more() -> None:
    """Pressing C also unloads B: the message names C, which was unloaded first."""
    d = Driver()
    for _ in range(400):
        c = d.requested[2] - 55
        estimated_n = (1.0 + 0.5 * c, 0.01 if c else 0.5, 0.02)
        if d.step(estimated_n=estimated_n).state is State.FAULT:
            break
    assert sum(d.requested) - 3 * 55 == 2
    assert "finger C bears nothing" in lines(d.controller.faults)
    assert "the fingertip may be dead" in lines(d.controller.faults)


def test_weak_grip_and_grip_with_implausible_fingertips_are_lifted_as_they_are() -> None:
    implausible = (failed("fingertip_few_taxels", finger="C"),)
    for changes in ({"estimated_n": (0.6, 0.4, 0.15)}, {**UNLOADED, "reported": implausible}):
        d = Driver()
        d.until(State.LIFT, **changes)
        assert d.requested == (55, 55, 55)


def test_next_run_begins_from_the_home_of_the_first_with_the_fingers_as_they_are() -> None:
    d = Driver(home=(0.3, 0.2, 0.4))
    d.height_m = 0.05
    assert d.step().state is State.HOME
    assert [type(c) for c in d.commands] == [MoveArm]
    assert d.commands[0].position_m == pytest.approx((0.3, 0.2, 0.4))  # type: ignore[attr-defined]
    d.step()
    assert len(d.commands) == 1
    d.height_m = 0.0
    assert d.step().state is State.SHAPE
    assert isinstance(d.commands[1], MoveFingers)
    d.until(State.BRACE)


def test_gripper_that_already_holds_an_object_is_not_opened() -> None:
    d = Driver()
    d.step(gripper=gripper(TICK, detections=LATCHED))
    assert d.controller.state is State.FAULT
    assert lines(d.controller.faults) == "the hand is closed and may hold an object"
    assert d.commands == [StopArm(1.0)]


def test_hand_that_may_hold_an_object_by_position_is_not_opened() -> None:
    d = Driver()
    d.step(gripper=gripper(TICK, positions=(55, 55, 55)))
    assert d.controller.state is State.FAULT
    assert "not open" in lines(d.controller.faults)
    assert d.commands == [StopArm(1.0)]


@pytest.mark.parametrize("says", [Detection.CONTACT_OPENING, Detection.AT_TARGET])
def test_arm_does_not_retreat_if_the_fingers_are_not_open(says: Detection) -> None:
    d = released()
    d.commands.clear()
    d.step(gripper=d.hand(positions=(55, 55, 55), detections=(says,) * 3))
    assert d.controller.state is State.FAULT
    assert "not open" in lines(d.controller.faults)
    assert not any(isinstance(c, MoveArm) for c in d.commands)


def test_phase_that_lasts_too_long_is_a_fault() -> None:
    d = Driver(phase_timeout_s=1.0)
    d.until(State.BRACE)
    for _ in range(110):
        d.step(gripper=d.hand(detections=MOVING))
    cause = lines(d.controller.faults)
    assert cause == "phase grasp.brace lasted longer than 1 s: the fingers still move"


def test_stale_fingertips_are_no_fault_once_the_hand_opens() -> None:
    d = released()
    for _ in range(20):
        d.step(frame=frame(stale=True), gripper=d.hand(detections=MOVING))
    assert d.controller.state is State.OPEN
    d.height_m = ControllerSettings().retreat_m
    d.until(State.SET_DOWN, frame=frame(stale=True))


def test_arm_is_clear_only_once_the_hand_rests_and_the_arm_is_up() -> None:
    d = released()
    d.until(State.RETREAT)
    assert d.step().state is State.RETREAT
    d.height_m = ControllerSettings().retreat_m
    assert d.step(gripper=d.hand(detections=MOVING)).state is State.RETREAT
    assert d.step().state is State.SET_DOWN


def released() -> Driver:
    """Driver whose hand was just commanded to open, at the height where the lift began."""
    d = Driver(hold_s=0.1).lift()
    d.height_m = HEIGHT
    d.until(State.DESCEND)
    d.height_m = 0.0
    d.until(State.OPEN)
    return d


@pytest.mark.parametrize("phase", [State.HOME, State.RETREAT])
def test_arm_that_does_not_arrive_is_a_fault_in_its_time(phase: State) -> None:
    d = Driver(home=(0.3, 0.2, 0.4), phase_timeout_s=1.0, hold_s=0.1)
    if phase is State.HOME:
        d.height_m = 0.05
    else:
        d.lift()
        d.height_m = HEIGHT
        d.until(State.DESCEND)
        d.height_m = 0.0
    d.until(phase)
    for _ in range(110):
        d.step(arm=arm(d.t_ns + TICK, 0.03, moving=True))
    assert d.controller.state is State.FAULT
    cause = lines(d.controller.faults)
    assert cause == f"phase {phase} lasted longer than 1 s: the arm has not arrived"


def test_missing_rest_counts_are_a_fault_of_the_fingertips() -> None:
    d = Driver(phase_timeout_s=1.0)
    d.until(State.TARE)
    for _ in range(110):
        d.step(rest_taken=False)
    assert lines(d.controller.faults) == (
        "fingertips_slow: too few samples for rest counts within 1 s"
    )
