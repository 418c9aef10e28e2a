"""A rig waits for a hand that is ready, whatever it said before."""

from collections.abc import Callable
from typing import cast

import pytest

from drivers.errors import DeviceFault, Refused
from drivers.interfaces import Gripper
from drivers.robotiq.driver import DriverSettings, RobotiqDriver
from drivers.robotiq.model.gripper import HandSettings
from drivers.robotiq.protocol import BASIC, SCISSOR, CommandRegisters
from grasp.clock import Clock, VirtualClock
from scenarios.rigs.rig import activate, mode_of, take_over
from tests.calibrations import PAPER
from tests.unit.drivers.robotiq.conftest import MS, Rig

Begin = Callable[[Gripper, Clock], None]


def made(active: bool) -> tuple[Rig, VirtualClock]:
    rig = Rig(HandSettings(activation_s=3.0), PAPER, active=active)

    def advance(t_ns: int) -> None:
        while rig.now_ns < t_ns:
            rig.advance(1)

    return rig, VirtualClock(advance)


@pytest.mark.parametrize(
    ("begin", "at", "code"),
    [(activate, 6, 0x05), (activate, 60, 0x0A), (take_over, 6, 0x06), (take_over, 60, 0x0B)],
)
def test_hand_that_is_active_and_reports_a_fault_keeps_its_grip_and_the_verb_is_told(
    begin: Begin, at: int, code: int
) -> None:
    """Also one that holds by position: it reports no contact."""
    rig, clock = made(active=True)
    rig.driver.move_to((at, at, at), 0.1, 15.0)
    for _ in range(300):
        clock.sleep_until_ns(clock.now_ns + 10 * MS)
        rig.driver.poll(clock.now_ns)
    rig.model.inject_fault(code)
    clock.sleep_until_ns(clock.now_ns + 100 * MS)
    rig.driver = RobotiqDriver(  # of another run
        rig.transport,
        DriverSettings(),
        PAPER,
        log=rig._log,  # noqa: SLF001
    )
    told = len(rig.frames)
    with pytest.raises(DeviceFault, match="was left as it is") as caught:
        begin(rig.driver, clock)
    assert "`grasp gripper activate`" in caught.value.remedy
    if at != 6:
        with pytest.raises(Refused, match="drop"):
            rig.driver.activate()
    for _ in range(300):
        clock.sleep_until_ns(clock.now_ns + 10 * MS)
        rig.driver.poll(clock.now_ns)
    assert rig.frames[told:] == []
    assert rig.state.positions == (at, at, at)


@pytest.mark.parametrize(("code", "begin"), [(0x0D, activate), (0x0E, take_over), (0x0F, activate)])
def test_fault_that_needs_activation_is_told_with_the_verb_and_nothing_is_moved(
    code: int, begin: Begin
) -> None:
    rig, clock = made(active=True)
    rig.model.inject_fault(code)
    clock.sleep_until_ns(clock.now_ns + 100 * MS)
    told = len(rig.frames)
    with pytest.raises(DeviceFault, match="gripper fault") as caught:
        begin(rig.driver, clock)
    assert "`grasp gripper activate`" in caught.value.remedy
    assert rig.frames[told:] == []


def test_hand_that_is_not_active_and_stands_closed_is_activated_only_by_leave_to_drop() -> None:
    """As after a power cut: a run would open it without a question, and what it holds falls."""
    rig, clock = made(active=True)
    rig.driver.move_to((60, 60, 60), 0.1, 15.0)
    for _ in range(300):
        clock.sleep_until_ns(clock.now_ns + 10 * MS)
        rig.driver.poll(clock.now_ns)
    assert rig.state.positions == (60, 60, 60)
    rig.model.power_cycle()
    clock.sleep_until_ns(clock.now_ns + 1_000 * MS)
    rig.driver = RobotiqDriver(rig.transport, DriverSettings(), PAPER)  # of another run
    rig.driver.poll(clock.now_ns)
    assert not rig.state.active
    at = rig.state.positions
    for begin in (activate, take_over):
        with pytest.raises(Refused, match="not active and stands closed"):
            begin(rig.driver, clock)
    clock.sleep_until_ns(clock.now_ns + 1_000 * MS)
    assert rig.state.positions == at
    activate(rig.driver, clock, dropping=True)
    assert rig.state.is_open


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_real_hand_in_scissor_mode_is_not_taken_over_and_one_in_pinch_or_wide_is(mode: int) -> None:
    """Before anything else moves: its driver would refuse the first closing alone."""
    rig, clock = made(active=True)
    rig.model.write(0, CommandRegisters(activate=True, mode=mode).to_registers(), rig.now_ns)
    clock.sleep_until_ns(4_000 * MS)
    if mode != SCISSOR:
        take_over(rig.driver, clock)
    else:
        with pytest.raises(Refused, match="in scissor mode") as caught:
            take_over(rig.driver, clock)
        assert "`grasp gripper activate`" in caught.value.remedy
    assert (rig.frames, mode_of(rig.driver)) == ([], mode)
    assert mode_of(cast(Gripper, object())) == BASIC  # of another package


def test_real_hand_is_taken_over_as_it_is_or_not_at_all() -> None:
    """Activation opens and closes it fully, whoever's hand is in it: nothing is written to it."""
    rig, clock = made(active=True)
    told = len(rig.frames)
    take_over(rig.driver, clock)
    assert clock.now_ns < 500 * MS
    assert len(rig.frames) == told
    rig, asleep = made(active=False)
    told = len(rig.frames)
    with pytest.raises(Refused, match="the hand is not active: nothing was moved") as caught:
        take_over(rig.driver, asleep)
    assert caught.value.remedy == "empty it, then `grasp gripper activate`"
    asleep.sleep_until_ns(asleep.now_ns + 4_000 * MS)
    assert not rig.state.active
    assert len(rig.frames) == told
