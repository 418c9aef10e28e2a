"""GraspStep with fake detector, controller and guard, which record their inputs."""

from collections.abc import Callable, Sequence
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from detector.interface import Motion
from drivers.errors import Refused
from drivers.interfaces import ArmState, Counts3, GripperState, TactileFrame, Vector3
from grasp.control.commands import (
    CloseToLimit,
    Command,
    GripperCommand,
    HoldFingers,
    MoveArm,
    OpenFingers,
    StopArm,
)
from grasp.control.contact_estimator import Stiffness
from grasp.control.controller import GraspController
from grasp.control.fault import lines
from grasp.control.guard import ForceGuard, GuardSettings
from grasp.control.monitors.checks import CHECKS, Monitors
from grasp.control.monitors.settings import MonitorSettings
from grasp.control.observation import Observation
from grasp.control.slip_monitor import DISARMED
from grasp.control.states import SAFE_STATES, State
from grasp.control.step import GraspStep
from grasp.control.transition import Decision
from tests.unit.grasp.builders import LOST, STOP, arm, frame, gripper
from tests.unit.grasp.controller_driver import HEIGHT, TICK, Driver

ANY_CLOSE = ((True, True, True), (255, 255, 255), 0.1)
CLOSE = CloseToLimit(8.0, *ANY_CLOSE)
LET = OpenFingers(0.05)
RISE = MoveArm((0.3, 0.2, 0.6), 0.1, 0.5)
SURE = np.array([0.9, 0.1, 0.2])


def step_input(of: TactileFrame | None, t_ns: int = TICK, **changes: Any) -> Observation:
    states = {"gripper": gripper(t_ns), "arm": arm(t_ns), **changes}
    return Observation(t_ns=t_ns, frame=of, rest_taken=True, **states)


class FakeDetector:
    """A detector that returns a constant output, or calls the given function."""

    def __init__(self, output: Callable[[], Any] = lambda: SURE) -> None:
        self.output = output
        self.inputs: list[NDArray[np.int16] | str] = []

    def reset(self) -> None:
        self.inputs.append("reset")

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        self.inputs.append(counts)
        return cast(NDArray[np.float64], self.output())


class FakeController:
    """A controller with a constant decision."""

    def __init__(self, phase: State = State.LIFT, *commands: Command, **flags: bool) -> None:
        self.state = phase
        flags = {"reset_detector": False, "first_grasp": False, **flags}
        self.decision = Decision(
            state=phase, slip=DISARMED, commands=commands, finished=False, **flags
        )
        self.observations: list[Observation] = []

    @property
    def in_safe_state(self) -> bool:
        return self.state in SAFE_STATES

    finished = False

    def abort_commands(self) -> tuple[Command, ...]:
        return self.decision.commands

    def step(self, obs: Observation) -> Decision:
        self.observations.append(obs)
        return self.decision


class FakeGuard:
    """A guard with one count per newton that replaces every command by ``LET``."""

    def __init__(self) -> None:
        self.first_grasps: list[tuple[Counts3, Vector3]] = []
        self.requests: list[tuple[GripperCommand, Vector3]] = []

    def estimated_n(self, sums: Vector3) -> Vector3:
        a, b, c = sums
        return (-a, -b, -c)

    def overloaded(self, estimated_n: Vector3) -> bool:
        return max(estimated_n) > 10.0

    def set_first_grasp(self, positions: Counts3, estimated_n: Vector3) -> None:
        self.first_grasps.append((positions, estimated_n))

    thumb_end_counts, grip = 61, None

    def observe(self, obs: Observation, estimated_n: Vector3, responsive: bool) -> None:
        pass

    def safe_travel(self, state: GripperState, estimated_n: Vector3) -> Counts3:
        return (state.positions[0] + 3, 60, round(estimated_n[0]))

    def admit(
        self, command: GripperCommand, state: GripperState, estimated_n: Vector3
    ) -> GripperCommand:
        self.requests.append((command, estimated_n))
        return LET


class Bench:
    def __init__(
        self, controller: FakeController | None = None, detector: FakeDetector | None = None
    ) -> None:
        self.controller = controller or FakeController()
        self.detector = detector or FakeDetector()
        self.guard = FakeGuard()
        self.step = GraspStep(
            self.detector,
            cast(GraspController, self.controller),
            cast(ForceGuard, self.guard),
        )

    def decide(self, of: TactileFrame | None, **changes: Any) -> Observation:
        return self.step.decide(step_input(of, **changes)).observation


def test_detector_gets_the_counts_and_the_controller_its_output() -> None:
    b = Bench()
    obs = b.decide(frame(-1))
    assert [np.unique(h).tolist() for h in b.detector.inputs] == [[-1]]
    assert obs.probabilities.tolist() == SURE.tolist()
    assert obs is b.controller.observations[0]
    assert (obs.estimated_n, obs.overloaded, obs.faults) == ((6.0, 6.0, 6.0), False, ())
    assert obs.responsive_n == obs.estimated_n
    assert (obs.safe_travel_counts, obs.thumb_end_counts) == ((58, 60, 6), 61)


@pytest.mark.parametrize("phase", [State.START, State.HOME, State.SHAPE])
def test_counts_relative_to_an_earlier_tare_are_ignored(phase: State) -> None:
    b = Bench(FakeController(phase))
    assert b.decide(frame(-9)).estimated_n == (0.0, 0.0, 0.0)
    b.controller.state = State.FAULT  # before this run has taken rest counts
    obs = b.decide(frame(-9))
    assert (obs.estimated_n, obs.responsive_n, b.detector.inputs) == ((0.0,) * 3, (0.0,) * 3, [])
    assert not obs.overloaded


@pytest.mark.parametrize("end", [State.FAULT, State.STOPPED, State.LOST])
def test_force_is_still_estimated_in_the_safe_state_after_a_tare(end: State) -> None:
    b = Bench(FakeController(State.TARE))
    b.decide(frame(-9))
    b.controller.state = end
    assert b.decide(frame(-1)).estimated_n == (6.0, 6.0, 6.0)


def test_saturated_taxels_count_in_measured_but_not_in_responsive_force() -> None:
    obs = Bench().decide(railed(frame(-1)))
    assert (obs.estimated_n, obs.responsive_n) == ((6.0, 6.0, 6.0), (4.0, 6.0, 6.0))


def railed(of: TactileFrame) -> TactileFrame:
    raw = of.raw.copy()
    raw[0, 2:4] = 0
    return msgspec.structs.replace(of, raw=raw)


class UnresettableDetector(FakeDetector):
    """A detector whose first ``refusals`` resets fail."""

    def __init__(self, refusals: int) -> None:
        super().__init__()
        self.refusals = refusals

    def reset(self) -> None:
        self.refusals -= 1
        if self.refusals >= 0:
            raise ZeroDivisionError("no state")


def test_a_detector_whose_reset_fails_is_a_fault_and_unused_until_a_reset_succeeds() -> None:
    b = Bench(detector=UnresettableDetector(2))
    failed = "detector_failed: ZeroDivisionError: no state"
    for of in (frame(-1, stale=True), frame(-1), frame(-1, stale=True)):
        obs = b.decide(of)
        assert (obs.probabilities.tolist(), lines(obs.faults)) == ([0.0] * 3, failed)
        assert obs.estimated_n == (6.0, 6.0, 6.0)
    assert b.detector.inputs == []
    assert b.decide(frame(-1, stale=True)).faults == ()
    assert b.decide(frame(-1)).probabilities.tolist() == SURE.tolist()


def test_a_failed_reset_by_the_controller_is_a_fault_of_the_next_step() -> None:
    b = Bench(FakeController(State.TARE, reset_detector=True), UnresettableDetector(1))
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
    b = Bench(FakeController(State.TARE))
    b.decide(frame(-1))
    b.detector.inputs.clear()
    b.controller.state = phase
    observation = b.decide(frame(-2, stale=stale), t_ns=2 * TICK, **changes)
    assert b.detector.inputs == []
    assert observation.probabilities.tolist() == [0.0] * 3
    assert observation.estimated_n == (12.0,) * 3


def guarded_step(driver: Driver) -> GraspStep[GraspController]:
    return GraspStep(
        FakeDetector(), driver.controller, ForceGuard(GuardSettings(), 2.0, Stiffness(1.25))
    )


def fallback_of(step: GraspStep[GraspController], state: GripperState) -> GripperCommand | None:
    controller = step.controller
    return step.fallback(() if controller.finished else controller.abort_commands(), state)


def test_fallback_of_a_hand_that_may_hold_an_object_closes_as_the_guard_admits() -> None:
    step = guarded_step(Driver().lift())
    fallback = fallback_of(step, gripper())
    assert isinstance(fallback, CloseToLimit)
    assert (fallback.force_limit_n, fallback.closing) == (10.0, (True, False, False))
    assert step.last_close is None, "it has not been sent"
    step.decide(step_input(frame(-420)))  # 15.75 N measured
    assert fallback_of(step, gripper()) == HoldFingers()


@pytest.mark.parametrize("phase", [State.SHAPE, State.BRACE, State.CLOSE, State.SETTLE])
def test_fallback_with_the_object_on_the_table_holds(phase: State) -> None:
    driver = Driver()
    driver.until(phase)
    assert fallback_of(guarded_step(driver), gripper()) == HoldFingers()


def test_no_fallback_before_and_after_a_run() -> None:
    driver = Driver(keep=True, hold_s=0.1)
    assert fallback_of(guarded_step(driver), gripper()) is None
    driver.lift()
    driver.height_m = HEIGHT
    driver.until(State.KEPT)
    assert fallback_of(guarded_step(driver), gripper()) is None


def test_stale_frame_resets_the_detector_and_is_no_sample() -> None:
    b = Bench()
    obs = b.decide(frame(-1, stale=True))
    assert b.detector.inputs == ["reset"]
    assert obs.probabilities.tolist() == [0.0] * 3
    assert obs.frame is not None and obs.frame.stale


def test_before_the_first_frame_there_is_no_slip_no_force_and_no_fault() -> None:
    b = Bench(FakeController(State.START))
    obs = b.decide(None)
    assert b.detector.inputs == []
    assert obs.probabilities.tolist() == [0.0] * 3
    assert (obs.frame, obs.estimated_n, obs.faults) == (None, (0.0,) * 3, ())
    assert obs.responsive_n == (0.0,) * 3


def test_detector_is_reset_after_its_sample_when_the_decision_says_so() -> None:
    b = Bench(FakeController(reset_detector=True))
    b.decide(frame(-1))
    assert len(b.detector.inputs) == 2
    assert b.detector.inputs[1] == "reset"
    assert b.guard.first_grasps == []


def test_first_grasp_of_the_guard_has_the_force_just_measured() -> None:
    b = Bench(FakeController(first_grasp=True))
    b.decide(frame(-1))
    b.decide(frame(-2))
    assert b.guard.first_grasps == [((55, 55, 55), (6.0,) * 3), ((55, 55, 55), (12.0,) * 3)]
    assert not any(isinstance(slip_likely, str) for slip_likely in b.detector.inputs)


def test_first_grasp_of_the_guard_has_the_actual_positions() -> None:
    b = Bench(FakeController(first_grasp=True))
    b.decide(frame(-1), gripper=gripper(positions=(51, 55, 54), requested=(55, 55, 55)))
    assert b.guard.first_grasps == [((51, 55, 54), (6.0,) * 3)]


def test_first_grasp_is_at_most_one_count_beyond_the_commanded_positions() -> None:
    b = Bench(FakeController(first_grasp=True))
    b.decide(frame(-1), gripper=gripper(positions=(60, 56, 57), requested=(55, 55, 55)))
    assert b.guard.first_grasps == [((55, 56, 55), (6.0,) * 3)]


def test_implausible_codes_do_not_change_the_measured_force() -> None:
    b = Bench()
    b.decide(frame(-1))
    dead = frame(-2)
    raw = dead.raw.copy()
    raw[1] = 0
    obs = b.decide(msgspec.structs.replace(dead, raw=raw), t_ns=2 * TICK)
    assert obs.estimated_n == (6.0,) * 3


def test_last_close_is_the_admitted_closing() -> None:
    controller = cast(GraspController, FakeController(State.LIFT, CloseToLimit(60.0, *ANY_CLOSE)))
    step = GraspStep(FakeDetector(), controller, ForceGuard(GuardSettings(), 2.0, Stiffness(1.25)))
    assert step.decide(step_input(frame(-1))).observation.last_close is None
    closed = step.decide(step_input(frame(-1), 2 * TICK)).observation.last_close
    assert closed is not None
    assert (closed.force_limit_n, closed.closing) == (10.0, (True, False, False))


def test_step_uses_the_given_checks() -> None:
    inactive = msgspec.structs.replace(gripper(), active=False)
    guard, controller = cast(ForceGuard, FakeGuard()), cast(GraspController, FakeController())
    for checks, found in ((CHECKS, True), ({}, False)):
        step = GraspStep(FakeDetector(), controller, guard, Monitors(MonitorSettings(), checks))
        assert (
            bool(step.decide(step_input(frame(-1), gripper=inactive)).observation.faults) is found
        )


def test_report_mode_records_an_implausible_value_and_stops_for_a_lost_link() -> None:
    controller, guard = (
        cast(GraspController, FakeController(State.LIFT)),
        cast(ForceGuard, FakeGuard()),
    )
    monitors = Monitors(MonitorSettings(mode="report"))
    step = GraspStep(FakeDetector(), controller, guard, monitors)
    step.decide(step_input(frame(-1)))
    jumped = gripper(positions=(200, 55, 55))
    obs = step.decide(step_input(frame(-1), gripper=jumped, errors=LOST)).observation
    assert obs.faults == LOST
    assert [fault.code for fault in obs.reported] == ["gripper_impossible"]
    inactive = msgspec.structs.replace(jumped, active=False)
    obs = step.decide(step_input(frame(-1), gripper=inactive)).observation
    assert [fault.code for fault in obs.faults] == ["gripper_inactive"]


def test_monitors_get_the_admitted_commands_and_the_arm_state() -> None:
    slip_likely: list[object] = []

    class Noting(Monitors):
        def sent(self, commands: Sequence[Command], arm: ArmState) -> None:
            slip_likely.append((commands, arm))

    controller = cast(GraspController, FakeController(State.LIFT, CLOSE, RISE))
    step = GraspStep(
        FakeDetector(), controller, cast(ForceGuard, FakeGuard()), Noting(MonitorSettings())
    )
    given = step_input(frame(-1))
    step.decide(given)
    assert slip_likely == [((LET, RISE), given.arm)]


def test_gripper_commands_are_admitted_by_the_force_just_measured() -> None:
    b = Bench(FakeController(State.LIFT, CLOSE, RISE))
    b.decide(frame(-1))
    result = b.step.decide(step_input(frame(-2), 2 * TICK))
    assert b.guard.requests == [(CLOSE, (6.0,) * 3), (CLOSE, (12.0,) * 3)]
    assert result.decision.commands == (CLOSE, RISE)
    assert result.admitted == (LET, RISE)
    assert result.observation.estimated_n == (12.0,) * 3
    assert result.observation.overloaded


def test_guard_admits_by_the_state_of_the_gripper(monkeypatch: pytest.MonkeyPatch) -> None:
    b, states = Bench(FakeController(State.LIFT, CLOSE)), list[GripperState]()
    admit = b.guard.admit

    def noted(command: GripperCommand, state: GripperState, estimated_n: Vector3) -> GripperCommand:
        states.append(state)
        return admit(command, state, estimated_n)

    monkeypatch.setattr(b.guard, "admit", noted)
    given = step_input(frame(-1))
    b.step.decide(given)
    later = gripper(positions=(60, 61, 62))
    assert fallback_of(b.step, later) == LET
    assert states == [given.gripper, later]


def test_no_fallback_if_the_safe_state_does_not_command_the_hand() -> None:
    assert fallback_of(Bench().step, gripper()) is None


@pytest.mark.parametrize("command", [RISE, StopArm(2.0)])
def test_arm_commands_pass_unchanged(command: Command) -> None:
    b = Bench()
    assert b.step.admit(command, gripper()) is command
    assert b.guard.requests == []


def test_command_from_outside_a_step_is_admitted_by_the_force_measured_last() -> None:
    b = Bench()
    b.decide(frame(-2))
    assert b.step.admit(CLOSE, gripper()) == LET
    assert b.guard.requests == [(CLOSE, (12.0,) * 3)]


def broken() -> None:
    raise ZeroDivisionError("no samples")


def refused() -> None:
    raise Refused("no samples; no output", "give it samples")


FAILURES = [
    pytest.param(refused, "no samples; no output", id="its message"),
    pytest.param(broken, "ZeroDivisionError: no samples", id="raises"),
    pytest.param(lambda: np.array([0.9, np.nan, 0.1]), "no probabilities", id="no number"),
    pytest.param(lambda: np.array([0.9, 1.5, 0.1]), "no probabilities", id="above one"),
    pytest.param(lambda: np.zeros(6), "shape (6,)", id="wrong shape"),
    pytest.param(lambda: None, "shape NoneType", id="no output"),
]


@pytest.mark.parametrize(("output", "expected"), FAILURES)
def test_failing_detector_gives_zeros_and_a_named_fault(
    output: Callable[[], Any], expected: str
) -> None:
    obs = Bench(detector=FakeDetector(output)).decide(frame(-1))
    assert obs.probabilities.tolist() == [0.0] * 3
    (fault,) = obs.faults
    assert fault.code == "detector_failed"
    assert expected in fault.message and "Refused" not in fault.message


@pytest.mark.parametrize("phase", [State.OPEN, State.RETREAT, State.SET_DOWN])
@pytest.mark.parametrize(("output", "expected"), FAILURES)
def test_failing_detector_with_an_open_hand_gives_zeros_and_no_fault(
    output: Callable[[], Any], expected: str, phase: State
) -> None:
    b = Bench(FakeController(phase), FakeDetector(output))
    obs = b.decide(frame(-1))
    assert len(b.detector.inputs) == 1  # it was asked
    assert (obs.probabilities.tolist(), obs.faults) == ([0.0] * 3, ())


MOTION = Motion([0.01] * 3, [90] * 3, [0.2] * 3)


def motion_after(output: NDArray[np.float64], motion: Callable[[], Motion | None]) -> Observation:
    """Kind of slip observed in a frame by a detector with auxiliary outputs."""
    guard, controller = cast(ForceGuard, FakeGuard()), cast(GraspController, FakeController())
    step = GraspStep(FakeDetector(lambda: output), controller, guard, motion=motion)
    return step.decide(step_input(frame(-1))).observation


def test_a_bug_in_the_kind_of_slip_ends_no_run_and_is_counted() -> None:
    guard, controller = cast(ForceGuard, FakeGuard()), cast(GraspController, FakeController())
    step = GraspStep(FakeDetector(lambda: SURE), controller, guard, motion=lambda: {}[1])
    observation = step.decide(step_input(frame(-1))).observation
    assert [observation.motion(), observation.motion()] == [None, None]
    assert step.hidden == {"KeyError: 1": 1}  # it is read once


def test_kind_of_slip_is_read_only_when_slip_is_likely() -> None:
    assert motion_after(SURE, lambda: MOTION).motion() == MOTION
    assert motion_after(np.array([0.5, 0.1, 0.2]), lambda: MOTION).motion() is None
    assert Bench().decide(frame(-1)).motion() is None  # of a detector without auxiliary outputs


def fresh() -> GraspStep[GraspController]:
    return GraspStep(
        FakeDetector(), Driver().controller, ForceGuard(GuardSettings(), 2.0, Stiffness(1.25))
    )


def plain(value: Any) -> Any:
    return value() if callable(value) else value.tolist()


def test_equal_inputs_to_two_fresh_steps_give_equal_results() -> None:
    inputs = [step_input(None)]
    inputs += [step_input(frame(-k % 40, stale=k % 17 == 0), k * TICK) for k in range(2, 120)]
    inputs.append(step_input(frame(-60), 120 * TICK, stop=STOP))
    one, other = (
        [msgspec.json.encode(step.decide(i), enc_hook=plain) for i in inputs]
        for step in (fresh(), fresh())
    )
    assert one == other
    assert len(set(one)) == len(one)


@pytest.mark.parametrize(("mode", "newtons"), [("stop", 6.0), ("report", 600.0)])
def test_report_mode_does_not_change_the_force_estimate(mode: Any, newtons: float) -> None:
    monitors = Monitors(MonitorSettings(mode=mode))
    step = GraspStep(
        FakeDetector(),
        cast(GraspController, FakeController()),
        cast(ForceGuard, FakeGuard()),
        monitors,
    )
    step.decide(step_input(frame(-1)))
    assert (
        step.decide(step_input(frame(-100))).observation.estimated_n == (newtons,) * 3
    )  # all jump
