"""The loop's own affairs: commands before watchers, lateness, trouble told once."""

from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from drivers.errors import DeviceFault, GraspError, LinkLost
from drivers.interfaces import Arm, ArmState, Gripper, TactileFrame, TactileSensor
from grasp.clock import Clock
from grasp.commands import CloseFast, GripperCommand, StopArm
from grasp.loop import ControlLoop, Tick
from grasp.loop_settings import LoopSettings
from grasp.phases import Phase
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import Rig
from scenarios.trial.execution import make_step
from tests.unit.scenarios.conftest import config


class RealClock:
    """A simulated rig's time, said to be a wall clock's: it passes, whoever computes."""

    virtual = False

    def __init__(self, inner: Clock) -> None:
        self._inner = inner

    @property
    def now_ns(self) -> int:
        return self._inner.now_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        self._inner.sleep_until_ns(t_ns)


def loop_of(rig: Rig, take: Callable[[Tick], None], real: bool) -> ControlLoop:
    clock = RealClock(rig.clock) if real else rig.clock
    return ControlLoop(rig.devices, clock, make_step(config()), config().loop, take)


def sent_when_watched(real: bool) -> list[tuple[int, int]]:
    """For each gripper command: time of the step that decided, of the tick that showed it sent."""
    shown: list[tuple[int, int]] = []

    def take(tick: Tick) -> None:
        shown.extend(
            (issued.decided_ns, tick.t_ns)
            for issued in tick.issued
            if isinstance(issued.admitted, GripperCommand)
        )

    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        loop = loop_of(rig, take, real)
        for _ in range(200):
            loop.tick()
    return shown


def test_on_a_real_clock_commands_leave_before_anyone_watches_the_step_that_decided_them() -> None:
    shown = sent_when_watched(real=True)
    assert len(shown) >= 2
    assert all(decided_ns == seen_ns for decided_ns, seen_ns in shown)


def test_in_virtual_time_a_decision_takes_its_delay_and_is_seen_a_period_later() -> None:
    shown = sent_when_watched(real=False)
    assert len(shown) >= 2
    assert all(seen_ns - decided_ns == 10_000_000 for decided_ns, seen_ns in shown)


class Unanswered:
    """A gripper whose last write is never acknowledged."""

    acknowledged = False

    def __init__(self, gripper: Gripper) -> None:
        self._gripper = gripper

    def __getattr__(self, name: str) -> Any:
        return getattr(self._gripper, name)


@pytest.mark.parametrize("spared_s", [0.001, 0.004])
def test_watchers_wait_for_the_acknowledgement_but_not_into_what_is_spared_of_the_period(
    spared_s: float,
) -> None:
    settings = config("hand.activation_s=0.5", f"loop.spared_s={spared_s}")
    with open_rig(settings, 0, paced=False) as rig:
        clock = RealClock(rig.clock)
        waited_ns: list[int] = []
        devices = msgspec.structs.replace(rig.devices, gripper=Unanswered(rig.devices.gripper))
        loop = ControlLoop(
            devices, clock, make_step(settings), settings.loop,
            lambda tick: waited_ns.append(clock.now_ns - tick.t_ns),
        )  # fmt: skip
        for _ in range(3):
            loop.tick()
        left_ns = 10_000_000 - max(waited_ns)  # in the step that moved the fingers
        assert left_ns == pytest.approx(spared_s * 1e9, abs=100_000)
        assert min(waited_ns) == 0
        assert loop.timing.missed_periods == 0


def test_periods_slept_through_are_counted_and_not_made_up_for() -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        stalls = [35_000_000, 0]

        def take(tick: Tick) -> None:
            if stalls:
                rig.clock.sleep_until_ns(rig.clock.now_ns + stalls.pop())

        loop = loop_of(rig, take, real=False)
        before = loop.tick().t_ns
        loop.tick()
        late = loop.tick()
        assert loop.timing.missed_periods == 2
        assert late.t_ns - before >= 40_000_000


def test_submitted_commands_pass_the_guard_as_any_other() -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        issued = []
        loop = loop_of(rig, lambda tick: issued.extend(tick.issued), real=False)
        loop.tick()
        loop.submit(CloseFast(60.0, (True, True, True), (255, 255, 255), 0.11))
        loop.tick()
        admitted = next(i.admitted for i in issued if isinstance(i.admitted, CloseFast))
        assert admitted.force_cap_n == 10.0
        assert admitted.closing == (True, False, False)


def test_what_waits_to_be_sent_is_forgotten_when_the_run_is_stopped() -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        issued = []
        loop = loop_of(rig, lambda tick: issued.extend(tick.issued), real=False)
        loop.tick()
        loop.submit(CloseFast(10.0, (True, True, True), (255, 255, 255), 0.05))
        assert loop.stop("a person")
        assert issued
        assert not any(isinstance(i.asked, CloseFast) for i in issued)


class Noting:
    """An arm that writes down when it is asked and told."""

    def __init__(self, arm: Arm, clock: Clock) -> None:
        self._arm, self._clock = arm, clock
        self.asked_ns = 0
        self.stopped_ns: list[tuple[int, int]] = []  # and when it was asked last

    @property
    def state(self) -> ArmState | None:
        return self._arm.state

    def pump(self, now_ns: int) -> None:
        self.asked_ns = now_ns
        self._arm.pump(now_ns)

    def stop(self, deceleration_mps2: float) -> None:
        self.stopped_ns.append((self._clock.now_ns, self.asked_ns))
        self._arm.stop(deceleration_mps2)


@pytest.mark.parametrize("late_ns", [0, 5_000_000, 3_000_000_000])
def test_arm_acts_on_a_command_when_it_is_sent_however_long_ago_it_was_asked(late_ns: int) -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        arm = Noting(rig.devices.arm, rig.clock)
        devices = msgspec.structs.replace(rig.devices, arm=arm)
        loop = ControlLoop(devices, rig.clock, make_step(config()), config().loop)
        loop.tick()
        loop.submit(StopArm(1.0))
        rig.clock.sleep_until_ns(rig.clock.now_ns + late_ns)
        loop.tick()
    ((sent_ns, asked_ns),) = arm.stopped_ns
    assert sent_ns - asked_ns <= 1_000_000


# Ends


class Runaway(Noting):
    """An arm that is seen to move on until it has been told to stop so often, if ever."""

    def __init__(self, arm: Arm, clock: Clock, stops: int | None = None) -> None:
        super().__init__(arm, clock)
        self._stops = stops

    @property
    def state(self) -> ArmState | None:
        state = self._arm.state
        moving = self._stops is None or len(self.stopped_ns) < self._stops
        return None if state is None else msgspec.structs.replace(state, moving=moving)


def running(rig: Rig, arm: Arm, *settings: str) -> ControlLoop:
    """A loop with that arm, after its first steps."""
    asked = config("hand.activation_s=0.5", *settings)
    devices = msgspec.structs.replace(rig.devices, arm=arm)
    loop = ControlLoop(devices, rig.clock, make_step(asked), asked.loop)
    for _ in range(3):
        loop.tick()
    return loop


@pytest.mark.parametrize("stops", [1, 4])
def test_an_abort_asks_the_arm_to_stop_until_it_stands_and_tells_how_it_is_left(stops: int) -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        arm = Runaway(rig.devices.arm, rig.clock, stops)
        loop = running(rig, arm)
        began_ns = rig.clock.now_ns
        left = loop.abort()
        assert len(arm.stopped_ns) == stops
        assert left is not None
        assert not left.arm.moving
        assert left.arm.t_ns > began_ns
        assert left.t_ns == rig.clock.now_ns


def test_an_abort_ends_where_the_arm_never_stands() -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        arm = Runaway(rig.devices.arm, rig.clock)
        loop = running(rig, arm, "loop.abort_s=0.5", "loop.abort_repeat_s=0.125")
        left = loop.abort()
        assert left is not None
        assert left.arm.moving
        assert len(arm.stopped_ns) == 4


def test_an_abort_before_the_first_step_has_nothing_to_tell() -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        loop = loop_of(rig, lambda tick: None, real=False)
        assert loop.abort() is None


def test_a_bug_of_ours_leads_to_the_safe_state_of_a_fault_with_its_cause() -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        arm = Noting(rig.devices.arm, rig.clock)
        step = make_step(config())
        devices = msgspec.structs.replace(rig.devices, arm=arm)
        loop = ControlLoop(devices, rig.clock, step, config().loop)
        loop.tick()
        loop.submit(CloseFast(10.0, (True, True, True), (255, 255, 255), 0.05))
        loop.fail("KeyError: 'here'")
        assert step.controller.finished
        assert step.controller.phase is Phase.FAULT
        assert step.controller.fault_cause == "KeyError: 'here'"
        assert arm.stopped_ns


def test_a_safe_state_that_is_never_seen_is_pursued_for_as_long_as_a_stop_may_last() -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        patient = config("hand.activation_s=0.5", "controller.safe_state_s=10")
        arm = Runaway(rig.devices.arm, rig.clock)
        devices = msgspec.structs.replace(rig.devices, arm=arm)
        loop = ControlLoop(devices, rig.clock, make_step(patient), LoopSettings(stop_s=2.0))
        loop.tick()
        began_ns = rig.clock.now_ns
        loop.fail("a bug")
        assert rig.clock.now_ns - began_ns == pytest.approx(2e9, abs=20_000_000)


def test_who_stops_what_has_been_stopped_is_told_that_there_was_nothing_to_stop() -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        loop = loop_of(rig, lambda tick: None, real=False)
        loop.tick()
        assert loop.stop("a person")
        assert not loop.stop("a person")


def test_who_stops_is_told_where_a_fault_comes_before_it() -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        loop = loop_of(rig, lambda tick: None, real=False)
        loop.tick()
        loop.note("arm", DeviceFault("the arm made a protective stop", "look"))
        assert not loop.stop("a person")


# Devices


class Failing:
    """A gripper that cannot be asked, but whose last state is known."""

    def __init__(self, gripper: Gripper, error: GraspError) -> None:
        self._gripper, self._error = gripper, error

    def pump(self, now_ns: int) -> None:
        raise self._error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._gripper, name)


@pytest.mark.parametrize(
    ("error", "lost"), [(LinkLost("no answer", "look"), True), (DeviceFault("hot", "wait"), False)]
)
def test_a_gripper_that_fails_from_the_first_step_on_is_lost_only_if_its_link_is(
    error: GraspError, lost: bool
) -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        gripper = Failing(rig.devices.gripper, error)
        devices = msgspec.structs.replace(rig.devices, gripper=gripper)
        loop = ControlLoop(devices, rig.clock, make_step(config()), config().loop)
        assert loop.tick().observation.gripper_lost is lost
        assert loop.errors == {"gripper": error}


class Repeating:
    """A board whose frame stays the same for one period."""

    def __init__(self, board: TactileSensor) -> None:
        self._board = board

    @property
    def frame(self) -> TactileFrame | None:
        frame = self._board.frame
        return None if frame is None else msgspec.structs.replace(frame, missed=1)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._board, name)


def test_a_period_without_a_new_frame_is_counted() -> None:
    with open_rig(config("hand.activation_s=0.5"), 0, paced=False) as rig:
        loop = loop_of(rig, lambda tick: None, real=False)
        for _ in range(200):
            loop.tick()
        assert loop.timing.repeated_frames == 0
        devices = msgspec.structs.replace(rig.devices, tactile=Repeating(rig.devices.tactile))
        after = ControlLoop(devices, rig.clock, make_step(config()), config().loop)
        for _ in range(5):
            after.tick()
        assert after.timing.repeated_frames == 5
