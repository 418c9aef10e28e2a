"""One step as a pure unit: what it tells the controller, the detector and the guard, and what it
lets out. The parts beside it are small fakes that write down what they are told."""

from collections.abc import Callable, Sequence
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from detector.auxiliary_outputs import Motion
from drivers.errors import Refused
from drivers.interfaces import ArmState, Counts3, GripperState, TactileFrame, Vector3
from grasp.commands import (
    CloseFast,
    Command,
    GripperCommand,
    HoldFingers,
    MoveArm,
    OpenFingers,
    StopArm,
)
from grasp.contact_estimator import Stiffness
from grasp.controller import Decision, GraspController
from grasp.fault import lines
from grasp.guard import ForceGuard, GuardSettings
from grasp.monitors.checks import CHECKS, Monitors
from grasp.monitors.settings import MonitorSettings
from grasp.observation import Observation, StepInput
from grasp.slip_monitor import DISARMED
from grasp.states import SAFE_STATES, State
from grasp.step import GraspStep
from tests.unit.grasp.builders import LOST, STOP, arm, frame, gripper
from tests.unit.grasp.controller_driver import HEIGHT, TICK, Driver

ANY_CLOSE = ((True, True, True), (255, 255, 255), 0.1)
CLOSE = CloseFast(8.0, *ANY_CLOSE)
LET = OpenFingers(0.05)
RISE = MoveArm((0.3, 0.2, 0.6), 0.1, 0.5)
SURE = np.array([0.9, 0.1, 0.2])


def told(of: TactileFrame | None, t_ns: int = TICK, **changes: Any) -> StepInput:
    states = {"gripper": gripper(t_ns), "arm": arm(t_ns), **changes}
    return StepInput(t_ns=t_ns, frame=of, rest_taken=True, **states)


class Ears:
    """A detector that gives the same answer always, or does what it is given to do."""

    def __init__(self, answer: Callable[[], Any] = lambda: SURE) -> None:
        self.answer = answer
        self.inputs: list[NDArray[np.int16] | str] = []

    def reset(self) -> None:
        self.inputs.append("reset")

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        self.inputs.append(counts)
        return cast(NDArray[np.float64], self.answer())


class Told:
    """A controller that decides the same always."""

    def __init__(self, phase: State = State.LIFT, *commands: Command, **says: bool) -> None:
        self.state = phase
        flags = {"reset_detector": False, "first_grasp": False, **says}
        self.decision = Decision(
            state=phase, slip=DISARMED, commands=commands, finished=False, **flags
        )
        self.seen: list[Observation] = []

    @property
    def in_safe_state(self) -> bool:
        return self.state in SAFE_STATES

    finished = False

    def abort_commands(self) -> tuple[Command, ...]:
        return self.decision.commands

    def step(self, seen: Observation) -> Decision:
        self.seen.append(seen)
        return self.decision


class Gate:
    """A guard of one count a newton that answers every command with another."""

    def __init__(self) -> None:
        self.first_grasps: list[tuple[Counts3, Vector3]] = []
        self.asked: list[tuple[GripperCommand, Vector3]] = []

    def measured_n(self, sums: Vector3) -> Vector3:
        a, b, c = sums
        return (-a, -b, -c)

    def overloaded(self, measured_n: Vector3) -> bool:
        return max(measured_n) > 10.0

    def set_first_grasp(self, positions: Counts3, measured_n: Vector3) -> None:
        self.first_grasps.append((positions, measured_n))

    thumb_limit_counts = 61

    def safe_travel(self, state: GripperState, measured_n: Vector3) -> Counts3:
        return (state.positions[0] + 3, 60, round(measured_n[0]))

    def admit(
        self, command: GripperCommand, state: GripperState, measured_n: Vector3
    ) -> GripperCommand:
        self.asked.append((command, measured_n))
        return LET


class Bench:
    def __init__(self, controller: Told | None = None, ears: Ears | None = None) -> None:
        self.controller = controller or Told()
        self.ears = ears or Ears()
        self.gate = Gate()
        self.step = GraspStep(
            self.ears,
            cast(GraspController, self.controller),
            cast(ForceGuard, self.gate),
        )

    def decide(self, of: TactileFrame | None, **changes: Any) -> Observation:
        return self.step.decide(told(of, **changes)).observation


def test_detector_gets_the_counts_and_the_controller_its_output() -> None:
    b = Bench()
    seen = b.decide(frame(-1))
    assert [np.unique(h).tolist() for h in b.ears.inputs] == [[-1]]
    assert seen.probabilities.tolist() == SURE.tolist()
    assert seen is b.controller.seen[0]
    assert (seen.measured_n, seen.overloaded, seen.faults) == ((6.0, 6.0, 6.0), False, ())
    assert seen.responsive_n == seen.measured_n
    assert (seen.safe_travel_counts, seen.thumb_limit_counts) == ((58, 60, 6), 61)


@pytest.mark.parametrize("phase", [State.START, State.HOME, State.SHAPE])
def test_counts_relative_to_an_earlier_tare_are_ignored(phase: State) -> None:
    b = Bench(Told(phase))
    assert b.decide(frame(-9)).measured_n == (0.0, 0.0, 0.0)
    b.controller.state = State.FAULT  # before this run took its own
    seen = b.decide(frame(-9))
    assert (seen.measured_n, seen.responsive_n, b.ears.inputs) == ((0.0,) * 3, (0.0,) * 3, [])
    assert not seen.overloaded


@pytest.mark.parametrize("end", [State.FAULT, State.STOPPED, State.LOST])
def test_force_is_still_estimated_in_the_safe_state_after_a_tare(end: State) -> None:
    b = Bench(Told(State.TARE))
    b.decide(frame(-9))
    b.controller.state = end
    assert b.decide(frame(-1)).measured_n == (6.0, 6.0, 6.0)


def test_saturated_taxels_count_in_measured_but_not_in_responsive_force() -> None:
    seen = Bench().decide(railed(frame(-1)))
    assert (seen.measured_n, seen.responsive_n) == ((6.0, 6.0, 6.0), (4.0, 6.0, 6.0))


def railed(of: TactileFrame) -> TactileFrame:
    raw = of.raw.copy()
    raw[0, 2:4] = 0
    return msgspec.structs.replace(of, raw=raw)


class Stubborn(Ears):
    """Cannot forget before it is asked so often."""

    def __init__(self, refusals: int) -> None:
        super().__init__()
        self.refusals = refusals

    def reset(self) -> None:
        self.refusals -= 1
        if self.refusals >= 0:
            raise ZeroDivisionError("nothing to forget")


def test_a_detector_whose_reset_fails_is_a_fault_and_unused_until_a_reset_succeeds() -> None:
    b = Bench(ears=Stubborn(2))
    failed = "detector_failed: ZeroDivisionError: nothing to forget"
    for of in (frame(-1, stale=True), frame(-1), frame(-1, stale=True)):
        seen = b.decide(of)
        assert (seen.probabilities.tolist(), lines(seen.faults)) == ([0.0] * 3, failed)
        assert seen.measured_n == (6.0, 6.0, 6.0)
    assert b.ears.inputs == []
    assert b.decide(frame(-1, stale=True)).faults == ()
    assert b.decide(frame(-1)).probabilities.tolist() == SURE.tolist()


def test_a_failed_reset_by_the_controller_is_a_fault_of_the_next_step() -> None:
    b = Bench(Told(State.TARE, reset_detector=True), Stubborn(1))
    assert b.decide(frame(-1)).faults == ()
    assert lines(b.decide(frame(-1)).faults).startswith("detector_failed: ZeroDivisionError")
    assert b.decide(frame(-1)).faults == ()


@pytest.mark.parametrize(
    ("phase", "changes"),
    [(State.FAULT, {}), (State.STOPPED, {}), (State.LOST, {}), (State.LIFT, {"stop": STOP}),
     (State.LIFT, {"errors": LOST}), (State.LIFT, {"late_ns": 10**9})],
)  # fmt: skip
@pytest.mark.parametrize("stale", [False, True])
def test_no_detector_is_called_in_a_safe_state_nor_in_the_step_that_enters_it(
    phase: State, changes: dict[str, Any], stale: bool
) -> None:
    b = Bench(Told(State.TARE))
    b.decide(frame(-1))
    b.ears.inputs.clear()
    b.controller.state = phase
    observation = b.decide(frame(-2, stale=stale), t_ns=2 * TICK, **changes)
    assert b.ears.inputs == []
    assert observation.probabilities.tolist() == [0.0] * 3
    assert observation.measured_n == (12.0,) * 3


def guarded_step(driver: Driver) -> GraspStep:
    return GraspStep(Ears(), driver.controller, ForceGuard(GuardSettings(), 2.0, Stiffness(1.25)))


def test_fallback_of_a_hand_that_may_hold_an_object_closes_as_the_guard_admits() -> None:
    step = guarded_step(Driver().lift())
    fallback = step.fallback(gripper())
    assert isinstance(fallback, CloseFast)
    assert (fallback.force_cap_n, fallback.closing) == (10.0, (True, False, False))
    assert step.last_close is None, "it has not been sent"
    step.decide(told(frame(-420)))  # 15.75 N measured
    assert step.fallback(gripper()) == HoldFingers()


@pytest.mark.parametrize("phase", [State.SHAPE, State.BRACE, State.CLOSE, State.SETTLE])
def test_fallback_with_the_object_on_the_table_holds(phase: State) -> None:
    driver = Driver()
    driver.until(phase)
    assert guarded_step(driver).fallback(gripper()) == HoldFingers()


def test_no_fallback_before_and_after_a_run() -> None:
    driver = Driver(keep=True, hold_s=0.1)
    assert guarded_step(driver).fallback(gripper()) is None
    driver.lift()
    driver.height_m = HEIGHT
    driver.until(State.KEPT)
    assert guarded_step(driver).fallback(gripper()) is None


def test_stale_frame_resets_the_detector_and_is_no_sample() -> None:
    b = Bench()
    seen = b.decide(frame(-1, stale=True))
    assert b.ears.inputs == ["reset"]
    assert seen.probabilities.tolist() == [0.0] * 3
    assert seen.frame is not None and seen.frame.stale


def test_before_the_first_frame_there_is_no_slip_no_force_and_no_fault() -> None:
    b = Bench(Told(State.START))
    seen = b.decide(None)
    assert b.ears.inputs == []
    assert seen.probabilities.tolist() == [0.0] * 3
    assert (seen.frame, seen.measured_n, seen.faults) == (None, (0.0,) * 3, ())
    assert seen.responsive_n == (0.0,) * 3


def test_detector_is_reset_after_its_sample_when_the_decision_says_so() -> None:
    b = Bench(Told(reset_detector=True))
    b.decide(frame(-1))
    assert len(b.ears.inputs) == 2
    assert b.ears.inputs[1] == "reset"
    assert b.gate.first_grasps == []


def test_first_grasp_of_the_guard_has_the_force_just_measured() -> None:
    b = Bench(Told(first_grasp=True))
    b.decide(frame(-1))
    b.decide(frame(-2))
    assert b.gate.first_grasps == [((55, 55, 55), (6.0,) * 3), ((55, 55, 55), (12.0,) * 3)]
    assert not any(isinstance(heard, str) for heard in b.ears.inputs)


def test_first_grasp_of_the_guard_has_the_actual_positions() -> None:
    b = Bench(Told(first_grasp=True))
    b.decide(frame(-1), gripper=gripper(positions=(51, 55, 54), requested=(55, 55, 55)))
    assert b.gate.first_grasps == [((51, 55, 54), (6.0,) * 3)]


def test_first_grasp_is_at_most_one_count_beyond_the_commanded_positions() -> None:
    b = Bench(Told(first_grasp=True))
    b.decide(frame(-1), gripper=gripper(positions=(60, 56, 57), requested=(55, 55, 55)))
    assert b.gate.first_grasps == [((55, 56, 55), (6.0,) * 3)]


def test_implausible_codes_do_not_change_the_measured_force() -> None:
    b = Bench()
    b.decide(frame(-1))
    dead = frame(-2)
    raw = dead.raw.copy()
    raw[1] = 0
    seen = b.decide(msgspec.structs.replace(dead, raw=raw), t_ns=2 * TICK)
    assert seen.measured_n == (6.0,) * 3


def test_last_close_is_the_admitted_closing() -> None:
    controller = cast(GraspController, Told(State.LIFT, CloseFast(60.0, *ANY_CLOSE)))
    step = GraspStep(Ears(), controller, ForceGuard(GuardSettings(), 2.0, Stiffness(1.25)))
    assert step.decide(told(frame(-1))).observation.last_close is None
    closed = step.decide(told(frame(-1), 2 * TICK)).observation.last_close
    assert closed is not None
    assert (closed.force_cap_n, closed.closing) == (10.0, (True, False, False))


def test_step_uses_the_given_checks() -> None:
    inactive = msgspec.structs.replace(gripper(), active=False)
    guard, controller = cast(ForceGuard, Gate()), cast(GraspController, Told())
    for checks, found in ((CHECKS, True), ({}, False)):
        step = GraspStep(Ears(), controller, guard, Monitors(MonitorSettings(), checks))
        assert bool(step.decide(told(frame(-1), gripper=inactive)).observation.faults) is found


def test_report_mode_records_an_implausible_value_and_stops_for_a_lost_link() -> None:
    controller, guard = cast(GraspController, Told(State.LIFT)), cast(ForceGuard, Gate())
    monitors = Monitors(MonitorSettings(mode="report"))
    step = GraspStep(Ears(), controller, guard, monitors)
    step.decide(told(frame(-1)))
    leapt = gripper(positions=(200, 55, 55))
    seen = step.decide(told(frame(-1), gripper=leapt, errors=LOST)).observation
    assert seen.faults == LOST
    assert [fault.code for fault in seen.reported] == ["gripper_impossible"]
    inactive = msgspec.structs.replace(leapt, active=False)
    seen = step.decide(told(frame(-1), gripper=inactive)).observation
    assert [fault.code for fault in seen.faults] == ["gripper_inactive"]


def test_monitors_get_the_admitted_commands_and_the_arm_state() -> None:
    heard: list[object] = []

    class Noting(Monitors):
        def sent(self, commands: Sequence[Command], arm: ArmState) -> None:
            heard.append((commands, arm))

    controller = cast(GraspController, Told(State.LIFT, CLOSE, RISE))
    step = GraspStep(Ears(), controller, cast(ForceGuard, Gate()), Noting(MonitorSettings()))
    given = told(frame(-1))
    step.decide(given)
    assert heard == [((LET, RISE), given.arm)]


def test_gripper_commands_are_admitted_by_the_force_just_measured() -> None:
    b = Bench(Told(State.LIFT, CLOSE, RISE))
    b.decide(frame(-1))
    result = b.step.decide(told(frame(-2), 2 * TICK))
    assert b.gate.asked == [(CLOSE, (6.0,) * 3), (CLOSE, (12.0,) * 3)]
    assert result.decision.commands == (CLOSE, RISE)
    assert result.admitted == (LET, RISE)
    assert result.observation.measured_n == (12.0,) * 3
    assert result.observation.overloaded


def test_guard_admits_by_the_state_of_the_gripper(monkeypatch: pytest.MonkeyPatch) -> None:
    b, states = Bench(Told(State.LIFT, CLOSE)), list[GripperState]()
    admit = b.gate.admit

    def noted(command: GripperCommand, state: GripperState, measured_n: Vector3) -> GripperCommand:
        states.append(state)
        return admit(command, state, measured_n)

    monkeypatch.setattr(b.gate, "admit", noted)
    given = told(frame(-1))
    b.step.decide(given)
    later = gripper(positions=(60, 61, 62))
    assert b.step.fallback(later) == LET
    assert states == [given.gripper, later]


def test_no_fallback_if_the_safe_state_does_not_command_the_hand() -> None:
    assert Bench().step.fallback(gripper()) is None


@pytest.mark.parametrize("command", [RISE, StopArm(2.0)])
def test_arm_commands_pass_unchanged(command: Command) -> None:
    b = Bench()
    assert b.step.admit(command, gripper()) is command
    assert b.gate.asked == []


def test_command_from_outside_a_step_is_admitted_by_the_force_measured_last() -> None:
    b = Bench()
    b.decide(frame(-2))
    assert b.step.admit(CLOSE, gripper()) == LET
    assert b.gate.asked == [(CLOSE, (12.0,) * 3)]


def broken() -> None:
    raise ZeroDivisionError("no samples")


def refused() -> None:
    raise Refused("no samples; no answer", "give it samples")


FAILURES = [
    pytest.param(refused, "no samples; no answer", id="its own words"),
    pytest.param(broken, "ZeroDivisionError: no samples", id="raises"),
    pytest.param(lambda: np.array([0.9, np.nan, 0.1]), "no probabilities", id="no number"),
    pytest.param(lambda: np.array([0.9, 1.5, 0.1]), "no probabilities", id="above one"),
    pytest.param(lambda: np.zeros(6), "shape (6,)", id="wrong shape"),
    pytest.param(lambda: None, "shape NoneType", id="no answer"),
]


@pytest.mark.parametrize(("answer", "says"), FAILURES)
def test_failing_detector_gives_zeros_and_a_named_fault(
    answer: Callable[[], Any], says: str
) -> None:
    seen = Bench(ears=Ears(answer)).decide(frame(-1))
    assert seen.probabilities.tolist() == [0.0] * 3
    (fault,) = seen.faults
    assert fault.code == "detector_failed"
    assert says in fault.message


@pytest.mark.parametrize("phase", [State.OPEN, State.RETREAT, State.SET_DOWN])
@pytest.mark.parametrize(("answer", "says"), FAILURES)
def test_failing_detector_with_an_open_hand_gives_zeros_and_no_fault(
    answer: Callable[[], Any], says: str, phase: State
) -> None:
    b = Bench(Told(phase), Ears(answer))
    seen = b.decide(frame(-1))
    assert len(b.ears.inputs) == 1  # it was asked
    assert (seen.probabilities.tolist(), seen.faults) == ([0.0] * 3, ())


MOTION = Motion([0.01] * 3, [90] * 3, [0.2] * 3)


def motion_after(answer: NDArray[np.float64], tell: Callable[[], Motion | None]) -> Observation:
    """What is observed of a frame by a detector with heads."""
    gate, controller = cast(ForceGuard, Gate()), cast(GraspController, Told())
    step = GraspStep(Ears(lambda: answer), controller, gate, motion=tell)
    return step.decide(told(frame(-1))).observation


def test_kind_of_slip_is_read_only_when_slip_is_likely() -> None:
    assert motion_after(SURE, lambda: MOTION).motion == MOTION
    assert motion_after(np.array([0.5, 0.1, 0.2]), lambda: MOTION).motion is None
    assert Bench().decide(frame(-1)).motion is None  # of a detector that cannot tell


def test_controller_gets_all_inputs_of_the_step() -> None:
    changes: dict[str, Any] = {
        "pending": True, "errors": LOST, "gripper_lost": True, "set_down": True,
        "stop": STOP, "late_ns": 3, "took_ns": 4,
    }  # fmt: skip
    given = told(frame(-1), **changes)
    assert Bench().step.decide(given).observation.inputs is given


def fresh() -> GraspStep:
    return GraspStep(Ears(), Driver().controller, ForceGuard(GuardSettings(), 2.0, Stiffness(1.25)))


def test_equal_inputs_to_two_fresh_steps_give_equal_results() -> None:
    inputs = [told(None)]
    inputs += [told(frame(-k % 40, stale=k % 17 == 0), k * TICK) for k in range(2, 120)]
    inputs.append(told(frame(-60), 120 * TICK, stop=STOP))
    one, other = (
        [msgspec.json.encode(step.decide(i), enc_hook=np.ndarray.tolist) for i in inputs]
        for step in (fresh(), fresh())
    )
    assert one == other
    assert len(set(one)) == len(one)


@pytest.mark.parametrize(("mode", "newtons"), [("stop", 6.0), ("report", 600.0)])
def test_report_mode_does_not_change_the_force_estimate(mode: Any, newtons: float) -> None:
    monitors = Monitors(MonitorSettings(mode=mode))
    step = GraspStep(Ears(), cast(GraspController, Told()), cast(ForceGuard, Gate()), monitors)
    step.decide(told(frame(-1)))
    assert step.decide(told(frame(-100))).observation.measured_n == (newtons,) * 3  # all jump
