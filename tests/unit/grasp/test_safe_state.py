"""Safe states: commands to arm and hand, and unconfirmed parts."""

import msgspec
import pytest

from drivers.interfaces import Detection
from grasp.control.commands import CloseToLimit, Command, HoldFingers, StopArm
from grasp.control.contact_estimator import Stiffness
from grasp.control.controller_settings import ControllerSettings, GripPlan
from grasp.control.fault import ARM, Fault
from grasp.control.lift_line import LiftLine
from grasp.control.monitors.checks import failed
from grasp.control.observation import Observation
from grasp.control.safe_state import SafeState, SafeStateSupervisor
from grasp.control.slip_response.close import SlipResponse
from grasp.control.states import AIRBORNE_STATES, CLOSING_STATES, SAFE_STATES, UNMOVED_STATES, State
from tests.unit.grasp.builders import LOST, arm, gripper, observation

CLOSURE = CloseToLimit(10.0, (True, False, False), (255, 255, 255), 0.06)
MOVING = (Detection.MOVING, Detection.AT_TARGET, Detection.AT_TARGET)
LATCHED = (Detection.CONTACT_CLOSING, Detection.AT_TARGET, Detection.AT_TARGET)
OLD_NS = 100e6
ENTERED_NS, LATER_NS = 5, 10_000_005
LOOSE = [p for p in State if p not in AIRBORNE_STATES | SAFE_STATES | UNMOVED_STATES]


def state(phase: State, before: State, *faults: Fault) -> SafeState:
    return SafeState(phase, before, ENTERED_NS, faults)


def later(**changes: object) -> Observation:
    return observation(LATER_NS, **changes)


HANDS: list[tuple[State, State, tuple[Command, ...]]] = [
    *((State.FAULT, p, (CLOSURE,)) for p in sorted(AIRBORNE_STATES)),
    *((State.FAULT, p, (HoldFingers(),)) for p in LOOSE),
    *((State.STOPPED, p, ()) for p in sorted(AIRBORNE_STATES)),
    *((State.STOPPED, p, (HoldFingers(),)) for p in sorted(CLOSING_STATES)),
    (State.STOPPED, State.HOME, (HoldFingers(),)),
    (State.STOPPED, State.SHAPE, (HoldFingers(),)),
    *((State.LOST, p, ()) for p in sorted(AIRBORNE_STATES)),
    *((p, before, ()) for p in sorted(SAFE_STATES) for before in sorted(UNMOVED_STATES)),
]


def test_hand_closes_only_in_a_fault_in_the_air() -> None:
    for phase, before, expected in HANDS:
        assert state(phase, before).hand_commands(CLOSURE) == expected, (phase, before)


def test_arm_is_implausible_by_any_of_the_faults() -> None:
    frozen, dead = failed("arm_frozen", seconds=0.4), failed("fingertip_dead", finger="A")
    stopped = Fault("arm_safety_stop", ARM, "arm stopped by its safety system")
    named = failed("detector_failed", how="KeyError: 'arm_frozen'")
    for faults in ((frozen,), (dead, frozen), (*LOST, frozen)):
        assert state(State.FAULT, State.LIFT, *faults).unconfirmed_arm(later(), OLD_NS)
    for faults in ((dead,), (stopped,), (named,), ()):
        assert not state(State.FAULT, State.LIFT, *faults).unconfirmed_arm(later(), OLD_NS)


@pytest.mark.parametrize(
    ("changes", "expected_text"),
    [
        ({}, ()),
        ({"arm": arm(LATER_NS, moving=True)}, ("the arm still moves",)),
        ({"pending": True}, ("the arm still moves",)),
        ({"arm": arm(LATER_NS - 100_000_000)}, ()),
        ({"arm": arm(LATER_NS - 101_000_000)},
         ("the arm does not report: whether it has stopped is unknown",)),
    ],
)  # fmt: skip
def test_arm_that_is_not_confirmed_stopped_is_unconfirmed(
    changes: dict[str, object], expected_text: tuple[str, ...]
) -> None:
    assert state(State.FAULT, State.LIFT).unconfirmed_arm(later(**changes), OLD_NS) == expected_text


@pytest.mark.parametrize(
    ("before", "changes", "safe"),
    [
        (State.LIFT, {}, False),
        (State.LIFT, {"last_close": CLOSURE}, False),
        (State.LIFT, {"last_close": CLOSURE, "gripper": gripper(detections=LATCHED)}, True),
        (State.LIFT, {"last_close": CLOSURE, "gripper": gripper(detections=MOVING)}, False),
        (State.LIFT, {"overloaded": True}, True),
        (State.LIFT, {"overloaded": True, "gripper": gripper(detections=MOVING)}, False),
        (State.BRACE, {}, True),
        (State.BRACE, {"pending": True}, False),
        (State.BRACE, {"gripper": gripper(detections=MOVING)}, False),
        (State.START, {"gripper": gripper(detections=MOVING)}, True),
    ],
)
def test_hand_is_safe_once_its_status_confirms_the_command(
    before: State, changes: dict[str, object], safe: bool
) -> None:
    fault = state(State.FAULT, before)
    assert fault.hand_is_safe(later(**changes)) is safe
    assert fault.unconfirmed_hand(later(**changes)) == (
        () if safe else ("the hand has not reached its safe state",)
    )


def test_hand_status_of_the_first_step_confirms_nothing() -> None:
    at_rest = observation(ENTERED_NS)
    assert not state(State.FAULT, State.BRACE).hand_is_safe(at_rest)
    assert state(State.STOPPED, State.LIFT).hand_is_safe(at_rest)  # nothing is asked of it


def test_unreachable_hand_is_reported_to_keep_its_position() -> None:
    safe = state(State.FAULT, State.LIFT)
    assert "does not report" in safe.unconfirmed_hand(later(gripper_lost=True))[0]
    refusing = msgspec.structs.replace(gripper(fault=13), active=False)
    assert "reports a fault" in safe.unconfirmed_hand(later(gripper=refusing))[0]
    warning = later(gripper=gripper(fault=13))  # it obeys all the same
    assert safe.unconfirmed_hand(warning) == ("the hand has not reached its safe state",)


def test_half_done_closing_is_finished_when_a_person_stops_the_run() -> None:
    half = SafeState(State.STOPPED, State.LIFT, ENTERED_NS, half_closed=True)
    assert half.hand_commands(CLOSURE) == (CLOSURE,)


SETTINGS = ControllerSettings(stale_after_s=0.1)


def supervisor(since_ns: int = 0) -> SafeStateSupervisor:
    safe = SafeState(State.FAULT, State.LIFT, since_ns)
    plan = GripPlan((40, 55, 55), (55, 55, 55), 10.0, Stiffness(1.9))
    return SafeStateSupervisor(
        safe, SETTINGS, SlipResponse(SETTINGS, plan, LiftLine(SETTINGS, (0.0, 0.0, 0.0)))
    )


def unsafe(t_ns: int, **changes: object) -> Observation:
    return observation(t_ns, **{"arm": arm(t_ns, moving=True), **changes})


def test_unconfirmed_parts_are_requested_again_after_the_repeat_time() -> None:
    for t_ns, expected in ((99_999_999, False), (100_000_000, True)):
        assert bool(supervisor().step(unsafe(t_ns))) is expected


def test_supervision_of_a_safe_state_ends_after_its_time() -> None:
    for t_ns, over in ((2_999_999_999, False), (3_000_000_000, True)):
        supervised = supervisor()
        supervised.step(unsafe(t_ns))
        assert supervised.over is over


def test_stale_arm_state_is_unconfirmed() -> None:
    for old_ns, fresh in ((100_000_000, True), (100_000_001, False)):
        supervised = supervisor()
        supervised.step(later(arm=arm(LATER_NS - old_ns)))
        reported_missing = any("the arm does not report" in text for text in supervised.unconfirmed)
        assert reported_missing is not fresh


def test_an_arm_that_rests_gets_no_further_stop() -> None:
    moving, resting = unsafe(LATER_NS), later()
    assert StopArm(SETTINGS.stop_deceleration_mps2) in supervisor().request(moving)
    assert not any(isinstance(c, StopArm) for c in supervisor().request(resting))
