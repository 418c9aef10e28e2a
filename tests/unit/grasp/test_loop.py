"""The loop's own affairs: commands before watchers, lateness, trouble told once."""

from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from drivers.interfaces import Arm, ArmState, Gripper
from grasp.clock import Clock
from grasp.commands import CloseFast, GripperCommand, StopArm
from grasp.loop import ControlLoop, Tick
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
