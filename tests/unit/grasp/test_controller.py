"""The controller as a pure function: observations in, commands out."""

import msgspec
import pytest
from transitions import MachineError

from detector.decision import ConsecutiveRule, RuleSettings
from drivers.interfaces import Counts3, Detection, GripperState, Vector3
from grasp.commands import (
    BeginRest,
    CloseFast,
    HoldFingers,
    MoveArm,
    MoveFingers,
    OpenFingers,
    StopArm,
)
from grasp.controller import Decision, GraspController
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.phases import TRANSITIONS, Phase, PhaseMachine, Trigger, mermaid
from grasp.slip import SlipMonitor, SlipSettings
from tests.unit.grasp.builders import arm, frame, gripper, seen

TICK = 10_000_000
HEIGHT = 0.2
MOVING = (Detection.MOVING, Detection.AT_TARGET, Detection.AT_TARGET)
RESTING = (Detection.AT_TARGET, Detection.AT_TARGET, Detection.AT_TARGET)
LATCHED = (Detection.CONTACT_CLOSING, Detection.AT_TARGET, Detection.AT_TARGET)


class Driver:
    """Steps a controller through ticks of 10 ms, and has the hand obey at once: a finger told to a
    position is there, a thumb told to close stops on the object."""

    def __init__(self, home: Vector3 | None = None, **settings: object) -> None:
        merged = msgspec.structs.replace(ControllerSettings(), **settings)
        monitor = SlipMonitor(ConsecutiveRule(RuleSettings(), 3), SlipSettings())
        plan = GripPlan((25, 40, 40), (55, 55, 55), 10.0, home)
        self.controller = GraspController(merged, plan, monitor)
        self.t_ns = 0
        self.height_m = 0.0
        self.closed = False
        self.last_close: CloseFast | None = None
        self.requested: Counts3 = (0, 0, 0)
        self.commands: list[object] = []

    def hand(self, **changes: object) -> GripperState:
        """The hand's status in the coming step."""
        a, b, c = self.requested
        values: dict[str, object] = {"positions": (a, b, c)}
        if self.closed:
            values = {"positions": (60, b, c), "requested": (255, b, c), "detections": LATCHED}
        return gripper(self.t_ns + TICK, **{**values, **changes})  # type: ignore[arg-type]

    def obey(self, command: object) -> None:
        if isinstance(command, MoveFingers):
            self.requested, self.closed = command.targets_counts, False
        elif isinstance(command, CloseFast):
            self.closed = True
            self.last_close = CloseFast(10.0, (True, False, False), (255, 255, 255), 0.06)
        elif isinstance(command, OpenFingers):
            self.requested, self.closed = (6, 6, 6), False

    def rest(self) -> None:
        """Steps until nothing that was told before can set the hand going any more."""
        for _ in range(11):
            self.step()

    def step(self, p: float = 0.0, **changes: object) -> Decision:
        changes.setdefault("gripper", self.hand())
        self.t_ns += TICK
        changes.setdefault("arm", arm(self.t_ns, self.height_m))
        changes.setdefault("last_close", self.last_close)
        decision = self.controller.step(seen(self.t_ns, p, **changes))
        self.commands += decision.commands
        for command in decision.commands:
            self.obey(command)
        return decision

    def until(self, phase: Phase, p: float = 0.0, **changes: object) -> Decision:
        for _ in range(400):
            decision = self.step(p, **changes)
            if decision.phase is phase:
                return decision
        raise AssertionError(f"never reached {phase}, stuck in {self.controller.phase}")

    def lift(self) -> "Driver":
        self.until(Phase.LIFT)
        self.commands.clear()
        return self

    def climb(self, p: float = 0.0, **changes: object) -> Decision:
        """One step with the arm on its way up."""
        return self.step(p, arm=arm(self.t_ns + TICK, 0.05, moving=True), **changes)

    def slip(self) -> "Driver":
        self.lift()
        for _ in range(2):
            self.climb(0.9)
        assert self.controller.phase is Phase.COMPENSATE
        return self


def test_approach_shapes_the_hand_then_takes_rest_counts_then_grasps() -> None:
    d = Driver()
    d.until(Phase.GRASP)
    assert [type(c) for c in d.commands] == [MoveFingers, BeginRest, MoveFingers]
    first, _, second = d.commands
    assert isinstance(first, MoveFingers)
    assert isinstance(second, MoveFingers)
    assert first.targets_counts == (25, 40, 40)
    assert second.targets_counts == (25, 55, 55)
    assert d.until(Phase.OPPOSE).commands[0].targets_counts == (55, 55, 55)  # the thumb comes last


def test_grasp_waits_until_the_status_is_fresh_and_no_command_is_on_its_way() -> None:
    d = Driver()
    d.until(Phase.GRASP)
    for fresh, detections, pending in ((True, RESTING, True), (False, RESTING, False),
                                       (True, MOVING, False)):  # fmt: skip
        for _ in range(80):
            now = d.hand(detections=detections, fresh=fresh)
            assert d.step(gripper=now, pending=pending).phase is Phase.GRASP
    assert not d.controller.monitor.status.armed


def test_finger_latched_by_contact_in_the_grasp_is_a_fault_and_nothing_is_lifted() -> None:
    d = Driver()
    d.until(Phase.GRASP)
    d.commands.clear()
    d.step(gripper=d.hand(detections=LATCHED))
    assert d.controller.phase is Phase.FAULT
    assert "finger A" in d.controller.fault_cause
    assert d.commands == [StopArm(1.0), HoldFingers()]


def test_detector_is_reset_and_armed_only_once_the_fingers_rest() -> None:
    d = Driver()
    d.until(Phase.GRASP)
    resets = [d.step().reset_detector for _ in range(40)]
    assert resets.count(True) == 2  # at rest, and again when listening begins
    assert d.controller.monitor.status.armed


def test_firm_grip_squeezes_to_the_cap_and_relaxes_once_the_thumb_stopped_on_the_object() -> None:
    d = Driver(firm=True)
    d.until(Phase.SQUEEZE)
    assert d.commands[-1] == CloseFast(10.0, (True, True, True), (255, 255, 255), 0.11)
    d.step(gripper=d.hand(detections=MOVING))
    assert d.controller.phase is Phase.SQUEEZE
    for _ in range(70):
        d.step(gripper=d.hand(detections=LATCHED))
    phases = [c.phase for c in d.controller.machine.log]
    assert phases == ["approach", "rest", "grasp", "oppose", "squeeze", "relax", "listen", "lift"]


def test_thumb_that_meets_nothing_in_the_squeeze_is_a_fault_and_nothing_is_lifted() -> None:
    d = Driver(firm=True)
    d.until(Phase.SQUEEZE)
    d.commands.clear()
    d.step(gripper=d.hand(positions=(255, 55, 55), detections=RESTING))
    assert d.controller.phase is Phase.FAULT
    assert "met nothing" in d.controller.fault_cause
    assert d.commands == [StopArm(1.0), HoldFingers()]


@pytest.mark.parametrize(
    "phase", [Phase.REST, Phase.GRASP, Phase.SQUEEZE, Phase.RELAX, Phase.LISTEN]
)
def test_fault_before_the_lift_keeps_the_fingers_where_they_are(phase: Phase) -> None:
    d = Driver(firm=phase is Phase.SQUEEZE)
    d.until(phase)
    d.commands.clear()
    d.step(trouble="link_lost: cable")
    assert d.commands == [StopArm(1.0), HoldFingers()]


def test_guard_is_anchored_when_the_arm_begins_to_rise_and_at_no_other_time() -> None:
    d = Driver()
    decisions = [d.step() for _ in range(90)]
    assert [x.phase for x in decisions if x.anchor] == [Phase.LIFT]


@pytest.mark.parametrize("phase", [Phase.APPROACH, Phase.RELAX, Phase.LISTEN, Phase.LIFT])
def test_person_who_interrupts_stops_the_arm_and_never_opens_a_grip(phase: Phase) -> None:
    d = Driver(stop_deceleration_mps2=2.0)
    d.until(phase)
    d.commands.clear()
    d.step(stop="stopped by hand", arm=arm(d.t_ns + TICK, 0.05, moving=True))
    assert d.controller.phase is Phase.STOPPED
    assert d.commands == [StopArm(2.0), *([HoldFingers()] if phase is Phase.APPROACH else [])]
    d.rest()
    assert d.controller.finished
    assert d.controller.unreached == ()


def test_lift_is_relative_to_where_the_arm_stood() -> None:
    d = Driver(lift_height_m=0.15)
    d.until(Phase.LIFT)
    command = d.commands[-1]
    assert isinstance(command, MoveArm)
    assert command.position_m == pytest.approx((0.3, 0.2, 0.55))


def test_registered_slip_closes_as_fast_as_it_may_in_the_same_step() -> None:
    d = Driver().lift()
    d.climb(0.9)
    assert d.commands == []
    d.climb(0.9)
    assert d.commands == [CloseFast(10.0, (True, True, True), (255, 255, 255), 0.11)]


def test_own_closing_cannot_trigger_itself() -> None:
    d = Driver().slip()
    d.commands.clear()
    for _ in range(10):
        d.climb(0.99, gripper=d.hand(detections=MOVING))
    for _ in range(12):  # fingers have stopped, the pads still shake
        d.climb(0.99, gripper=d.hand(detections=LATCHED))
    for _ in range(10):
        d.climb(0.0, gripper=d.hand(detections=LATCHED))
    assert d.commands == []
    assert d.controller.phase is Phase.LIFT
    assert len(d.controller.monitor.events) == 1


def test_slip_that_goes_on_after_the_last_rise_of_force_reports_the_cap_and_lowers() -> None:
    d = Driver().slip()
    d.commands.clear()
    since = d.t_ns
    for _ in range(60):
        if d.climb(0.9, gripper=d.hand(detections=LATCHED)).phase is Phase.LOWER:
            break
    assert d.controller.cap_reached
    assert 0.29e9 <= d.t_ns - since <= 0.35e9
    assert [type(c) for c in d.commands] == [MoveArm]


def test_hold_by_its_clock_sets_down_in_time_though_slip_stays_registered() -> None:
    d = Driver(hold_by_clock=True, hold_s=0.5).slip()
    d.commands.clear()
    while d.controller.phase is Phase.COMPENSATE:
        d.climb(0.9, gripper=d.hand(detections=LATCHED))
    assert d.controller.phase is Phase.LIFT
    d.height_m = HEIGHT
    since = d.t_ns
    while d.step(0.9, gripper=d.hand(detections=LATCHED)).phase in (Phase.LIFT, Phase.HOLD):
        assert d.commands == []  # nothing to close any further
    assert d.controller.phase is Phase.LOWER
    assert d.t_ns - since == pytest.approx(0.51e9, abs=0.02e9)
    assert d.controller.alarm_stayed and not d.controller.cap_reached


def test_hold_by_its_clock_still_stops_the_arm_when_contact_is_lost_at_the_cap() -> None:
    d = Driver(hold_by_clock=True, hold_s=5.0).slip()
    while d.controller.phase is Phase.COMPENSATE:
        d.climb(0.9, gripper=d.hand(detections=LATCHED))
    for _ in range(10):
        d.climb(0.9, gripper=d.hand(detections=LATCHED), measured_n=(0.0, 0.0, 0.0))
    assert d.controller.phase is Phase.LOST


def test_slip_that_stops_on_the_way_up_leads_back_to_the_lift_and_at_the_top_to_the_hold() -> None:
    d = Driver().slip()
    for _ in range(30):
        d.climb()
    d.height_m = HEIGHT
    d.until(Phase.HOLD)
    d.until(Phase.COMPENSATE, 0.9)
    d.until(Phase.HOLD)
    assert [c.phase for c in d.controller.machine.log[-5:]] == [
        "compensate", "lift", "hold", "compensate", "hold",
    ]  # fmt: skip


def test_hold_begins_anew_after_slip_was_answered() -> None:
    d = Driver(hold_s=0.5).lift()
    d.height_m = HEIGHT
    d.until(Phase.HOLD)
    d.until(Phase.COMPENSATE, 0.9)
    d.until(Phase.HOLD)
    began_ns = d.t_ns
    d.until(Phase.LOWER)
    assert d.t_ns - began_ns == 500_000_000


def test_hold_answers_slip_that_comes_late() -> None:
    d = Driver(hold_s=5.0).lift()
    d.height_m = HEIGHT
    d.until(Phase.HOLD)
    d.step(0.9)
    d.step(0.9)
    assert isinstance(d.commands[0], CloseFast)


def test_finished_lift_sets_down_opens_and_retreats() -> None:
    d = Driver(hold_s=0.1).lift()
    d.height_m = HEIGHT
    d.until(Phase.LOWER)
    d.height_m = 0.0
    d.until(Phase.RELEASE)
    d.height_m = 0.05
    d.until(Phase.DONE)
    assert d.controller.finished
    assert [type(c) for c in d.commands] == [MoveArm, OpenFingers, MoveArm]


def test_keep_goes_on_holding() -> None:
    d = Driver(hold_s=0.1, keep=True).lift()
    d.height_m = HEIGHT
    for _ in range(60):
        d.step()
    assert d.controller.phase is Phase.KEPT
    assert d.controller.finished
    assert d.commands == []


def test_reactions_off_notes_slip_and_does_nothing() -> None:
    d = Driver(reactions=False).lift()
    for _ in range(10):
        d.climb(0.9)
    assert d.commands == []
    assert d.controller.monitor.events


FAULTS = [
    {"trouble": "link_lost: cable"},
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
    assert d.controller.phase is Phase.FAULT
    assert d.commands == [StopArm(1.0), HoldFingers()]


@pytest.mark.parametrize("change", FAULTS, ids=lambda c: next(iter(c)))
def test_fault_in_the_air_stops_the_arm_and_closes_to_the_cap(change: dict[str, object]) -> None:
    d = Driver().lift()
    d.step(**change)
    assert d.commands[0] == StopArm(1.0)
    assert isinstance(d.commands[1], CloseFast)
    assert d.commands[1].force_cap_n == 10.0


def test_lost_gripper_stops_the_arm_and_commands_nothing_else() -> None:
    d = Driver().lift()
    d.step(trouble="link_lost: gripper", gripper_lost=True)
    assert d.commands == [StopArm(1.0)]


def test_fault_is_finished_once_the_safe_state_is_seen_and_sends_nothing_more() -> None:
    d = Driver().lift()
    d.step(trouble="x")
    d.commands.clear()
    d.step()
    assert not d.controller.finished  # what it was told before may still set the hand going
    d.rest()
    assert d.controller.finished
    assert d.commands == []


def test_stop_is_repeated_until_the_arm_is_seen_to_stand() -> None:
    d = Driver().lift()
    d.step(trouble="x")
    for _ in range(100):
        d.climb()
    stops = [c for c in d.commands if isinstance(c, StopArm)]
    assert 8 <= len(stops) <= 11
    assert not d.controller.finished
    d.rest()
    assert d.controller.finished


def test_safe_state_that_is_never_seen_ends_in_its_time_and_says_what_is_missing() -> None:
    d = Driver().lift()
    d.step(trouble="x")
    for _ in range(310):
        d.climb()
    assert d.controller.finished
    assert d.controller.unreached == ("the arm still moves",)


FROZEN = "arm_frozen: the position stands while it is told to move"


@pytest.mark.parametrize(
    "change",
    [
        {"doubt": FROZEN},
        {"doubt": f"loop_stood_still: for 0.2 s nobody was in control; {FROZEN}"},
        {"trouble": "link_lost: the gripper does not answer", "doubt": FROZEN},
    ],
    ids=["alone", "after another doubt", "after trouble"],
)
def test_arm_that_cannot_be_believed_is_stopped_again_and_again_and_never_said_to_stand(
    change: dict[str, object],
) -> None:
    d = Driver().lift()
    d.step(**change)
    for _ in range(310):
        d.step()
    assert sum(isinstance(c, StopArm) for c in d.commands) > 20
    assert d.controller.finished
    assert "unknown" in d.controller.unreached[0]


@pytest.mark.parametrize("phase", [Phase.GRASP, Phase.OPPOSE, Phase.SQUEEZE])
def test_hand_that_closes_onto_the_object_is_held_when_a_person_stops_the_run(phase: Phase) -> None:
    d = Driver(firm=phase is Phase.SQUEEZE)
    d.until(phase)
    d.commands.clear()
    d.step(stop="stopped by hand")
    assert d.commands == [StopArm(1.0), HoldFingers()]
    d.step(gripper=d.hand(detections=MOVING))
    assert not d.controller.finished
    d.rest()
    assert d.controller.finished


def test_bug_of_ours_in_a_fault_in_the_air_does_not_end_its_closing() -> None:
    d = Driver().lift()
    d.step(trouble="x")
    assert [type(c) for c in d.controller.aborted()] == [StopArm, CloseFast]


@pytest.mark.parametrize("doubt", ["arm_jump: 0.05 m", "gripper_impossible: finger A at 300"])
def test_further_doubt_in_a_safe_state_is_told_once_and_moves_nothing(doubt: str) -> None:
    d = Driver().lift()
    d.step(doubt="gripper_silent: 0.16 s without an answer")
    d.commands.clear()
    for _ in range(20):
        d.step(doubt=f"gripper_silent: 0.30 s without an answer; {doubt}")
    assert d.controller.fault_cause.startswith("gripper_silent: 0.16 s")
    assert d.controller.further == [doubt]
    assert {type(c) for c in d.commands} <= {StopArm, CloseFast}


def test_arm_that_is_doubted_only_in_the_safe_state_is_not_said_to_stand() -> None:
    d = Driver().lift()
    d.step(trouble="x", arm=arm(d.t_ns + TICK, 0.05, moving=True))
    d.step(doubt="arm_jump: 0.05 m from one sample to the next")
    assert not d.controller.finished
    for _ in range(310):
        d.step()
    assert "unknown" in d.controller.unreached[0]
    assert sum(isinstance(c, StopArm) for c in d.commands) > 20


@pytest.mark.parametrize("phase", [Phase.RELAX, Phase.LIFT])
def test_doubt_after_a_person_has_stopped_the_run_keeps_the_grip_as_it_is(phase: Phase) -> None:
    d = Driver()
    d.until(phase)
    d.commands.clear()
    d.step(stop="stopped by hand", arm=arm(d.t_ns + TICK, 0.05, moving=True))
    for _ in range(20):
        d.step(doubt="fingertips_frozen: all codes", arm=arm(d.t_ns + TICK, 0.05, moving=True))
    assert d.controller.phase is Phase.STOPPED
    assert d.controller.further == ["fingertips_frozen: all codes"]
    assert {type(c) for c in d.commands} == {StopArm}


def test_safe_state_is_not_asked_for_again_while_the_request_is_on_its_way() -> None:
    d = Driver().lift()
    d.step(trouble="x")
    d.commands.clear()
    for _ in range(50):
        d.climb(pending=True)
    assert d.commands == []


def test_closed_hand_does_not_go_down_onto_the_next_object() -> None:
    d = Driver(home=(0.3, 0.2, 0.4))
    d.height_m = 0.05
    d.step(gripper=gripper(TICK, positions=(255, 55, 55)))
    assert d.controller.phase is Phase.FAULT
    assert not any(isinstance(c, MoveArm) for c in d.commands)


def test_arm_that_never_comes_to_the_top_is_a_fault_and_no_hold_without_end() -> None:
    d = Driver(phase_timeout_s=1.0).slip()
    d.height_m = HEIGHT - 0.0015
    for _ in range(200):
        d.step()
    assert d.controller.phase is Phase.FAULT


def test_gripper_that_comes_back_is_still_told_to_close() -> None:
    d = Driver().lift()
    d.step(trouble="link_lost: gripper", gripper_lost=True)
    for _ in range(8):
        d.step(gripper_lost=True)
    assert not any(isinstance(c, CloseFast) for c in d.commands)
    for _ in range(20):
        d.step()
    assert sum(isinstance(c, CloseFast) for c in d.commands) == 1
    assert d.controller.finished


def test_lost_contact_in_the_lift_is_answered_by_closing() -> None:
    d = Driver().lift()
    for _ in range(5):
        d.climb(measured_n=(0.0, 0.0, 0.0))
    assert d.controller.phase is Phase.COMPENSATE
    assert isinstance(d.commands[0], CloseFast)


def test_closure_that_meets_nothing_is_a_lost_object_and_nothing_is_lowered() -> None:
    d = Driver().slip()
    empty = d.hand(positions=(255, 55, 55), requested=(255, 55, 55), detections=RESTING)
    for _ in range(20):
        empty = msgspec.structs.replace(empty, t_ns=d.t_ns + TICK)
        d.climb(gripper=empty, measured_n=(0.0, 0.0, 0.0))
    assert d.controller.phase is Phase.LOST
    assert isinstance(d.commands[-1], StopArm)
    assert not any(isinstance(c, MoveArm) for c in d.commands)


def test_contact_lost_on_the_way_down_stops_the_arm() -> None:
    d = Driver(hold_s=0.1).lift()
    d.height_m = HEIGHT
    d.until(Phase.LOWER)
    d.commands.clear()
    for _ in range(8):
        d.step(measured_n=(0.0, 0.0, 0.0), arm=arm(d.t_ns + TICK, 0.1, moving=True))
    assert d.controller.phase is Phase.LOST
    assert isinstance(d.commands[0], StopArm)


def test_force_that_stays_above_the_limit_while_the_arm_moves_is_a_fault() -> None:
    d = Driver(hold_s=0.1).lift()
    d.height_m = HEIGHT
    d.until(Phase.LOWER)
    for _ in range(5):
        d.step(overloaded=True, arm=arm(d.t_ns + TICK, 0.1, moving=True))
    assert d.controller.phase is Phase.FAULT
    assert "force" in d.controller.fault_cause


def test_fingers_that_feel_nothing_are_noticed_before_the_arm_lifts() -> None:
    d = Driver()
    d.until(Phase.GRASP, measured_n=(0.0, 0.0, 0.0))
    for _ in range(80):
        d.step(measured_n=(0.0, 0.0, 0.0))
    assert d.controller.phase is Phase.FAULT
    assert "feels nothing" in d.controller.fault_cause
    assert not any(isinstance(c, MoveArm) for c in d.commands)


def test_close_that_could_do_nothing_is_not_sent() -> None:
    d = Driver().slip()
    for _ in range(40):
        d.climb(0.0)
    assert d.controller.phase is Phase.LIFT
    d.commands.clear()
    for _ in range(10):
        d.climb(0.9)
    assert d.controller.phase is Phase.COMPENSATE
    assert d.commands == []
    assert d.controller.closings == 1


def test_alarms_that_come_and_go_at_the_cap_cannot_prolong_the_hold_for_ever() -> None:
    d = Driver(hold_s=0.5, alarm_hold_s=1.0).slip()
    d.height_m = HEIGHT
    began = d.t_ns
    while d.controller.phase is not Phase.LOWER and d.t_ns - began < 10_000_000_000:
        d.step(0.9 if d.t_ns // TICK % 6 < 3 else 0.0)
    assert d.t_ns - began < 2_500_000_000
    assert d.controller.closings == 1


def test_next_run_begins_from_the_home_of_the_first_with_the_fingers_as_they_are() -> None:
    d = Driver(home=(0.3, 0.2, 0.4))
    d.height_m = 0.05
    assert d.step().phase is Phase.HOME
    assert [type(c) for c in d.commands] == [MoveArm]
    assert d.commands[0].position_m == pytest.approx((0.3, 0.2, 0.4))  # type: ignore[attr-defined]
    d.step()
    assert len(d.commands) == 1
    d.height_m = 0.0
    assert d.step().phase is Phase.APPROACH
    assert isinstance(d.commands[1], MoveFingers)
    d.until(Phase.GRASP)


def test_gripper_that_already_holds_something_is_not_opened() -> None:
    d = Driver()
    d.step(gripper=gripper(TICK, detections=LATCHED))
    assert d.controller.phase is Phase.FAULT
    assert d.controller.fault_cause == "the gripper already holds something"
    assert d.commands == [StopArm(1.0)]


def test_phase_that_lasts_too_long_is_a_fault() -> None:
    d = Driver(phase_timeout_s=1.0)
    d.until(Phase.GRASP)
    for _ in range(110):
        d.step(gripper=d.hand(detections=MOVING))
    assert d.controller.phase is Phase.FAULT


def test_every_transition_is_logged_with_time_and_cause() -> None:
    d = Driver().slip()
    log = d.controller.machine.log
    assert [c.phase for c in log] == [
        "approach", "rest", "grasp", "oppose", "relax", "listen", "lift", "compensate",
    ]  # fmt: skip
    assert all(c.cause for c in log)
    assert log[-1].t_ns == d.t_ns


def test_every_edge_of_the_table_can_be_walked_and_no_other() -> None:
    for trigger in Trigger:
        for phase in Phase:
            machine = PhaseMachine(phase)
            expected = [
                dest for t, sources, dest in TRANSITIONS if t is trigger and phase in sources
            ]
            if expected:
                machine.fire(trigger, 0, "test")
                assert machine.phase is expected[0]
            else:
                with pytest.raises(MachineError):
                    machine.fire(trigger, 0, "test")


def test_state_diagram_names_every_trigger() -> None:
    text = mermaid()
    assert all(trigger.value in text for trigger in Trigger)
