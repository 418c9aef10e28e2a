"""Activation and take-over of the hand by a rig."""

from collections.abc import Callable
from typing import cast

import pytest

from drivers.errors import DeviceFault, Refused
from drivers.interfaces import Gripper
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.model.gripper import HandSettings
from drivers.robotiq.protocol import BASIC, SCISSOR, CommandRegisters
from drivers.robotiq.settings import DriverSettings
from grasp.run.clock import Clock, VirtualClock
from scenarios.rigs.rig import activate, mode_of, take_over
from tests.calibrations import PAPER
from tests.unit.drivers.robotiq.conftest import MS, Rig

Begin = Callable[[Gripper, Clock], None]


def make_rig(active: bool) -> tuple[Rig, VirtualClock]:
    rig = Rig(HandSettings(activation_s=3.0), PAPER, active=active)

    def advance(t_ns: int) -> None:
        while rig.now_ns < t_ns:
            rig.advance(1)

    return rig, VirtualClock(advance)


@pytest.mark.parametrize(
    ("begin", "at", "code"),
    [(activate, 6, 0x05), (activate, 60, 0x0A), (take_over, 6, 0x06), (take_over, 60, 0x0B)],
)
def test_active_hand_with_a_fault_keeps_its_grip_and_the_error_names_the_command(
    begin: Begin, at: int, code: int
) -> None:
    """This includes a hand that holds by position and reports no contact."""
    rig, clock = make_rig(active=True)
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
    frames_before = len(rig.frames)
    with pytest.raises(DeviceFault, match="was left as it is") as caught:
        begin(rig.driver, clock)
    assert "`grasp gripper activate`" in caught.value.remedy
    if at != 6:
        with pytest.raises(Refused, match="drop"):
            rig.driver.activate()
    for _ in range(300):
        clock.sleep_until_ns(clock.now_ns + 10 * MS)
        rig.driver.poll(clock.now_ns)
    assert rig.frames[frames_before:] == []
    assert rig.state.positions == (at, at, at)


@pytest.mark.parametrize(("code", "begin"), [(0x0D, activate), (0x0E, take_over), (0x0F, activate)])
def test_fault_that_needs_activation_names_the_command_and_nothing_moves(
    code: int, begin: Begin
) -> None:
    rig, clock = make_rig(active=True)
    rig.model.inject_fault(code)
    clock.sleep_until_ns(clock.now_ns + 100 * MS)
    frames_before = len(rig.frames)
    with pytest.raises(DeviceFault, match="gripper fault") as caught:
        begin(rig.driver, clock)
    assert "`grasp gripper activate`" in caught.value.remedy
    assert rig.frames[frames_before:] == []


def test_inactive_closed_hand_is_activated_only_with_permission_to_drop() -> None:
    """After a power cut, activation would open the hand and drop what it holds."""
    rig, clock = make_rig(active=True)
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
    positions = rig.state.positions
    for begin in (activate, take_over):
        with pytest.raises(Refused, match="not active and is closed"):
            begin(rig.driver, clock)
    clock.sleep_until_ns(clock.now_ns + 1_000 * MS)
    assert rig.state.positions == positions
    activate(rig.driver, clock, dropping=True)
    assert rig.state.is_open


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_take_over_refuses_scissor_mode_and_accepts_pinch_and_wide_mode(mode: int) -> None:
    """The check comes first, because the driver would refuse only the first closing."""
    rig, clock = make_rig(active=True)
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


def test_take_over_of_a_real_hand_writes_nothing_and_refuses_an_inactive_one() -> None:
    """Activation opens and closes the hand fully, which may hurt somebody."""
    rig, clock = make_rig(active=True)
    frames_before = len(rig.frames)
    take_over(rig.driver, clock)
    assert clock.now_ns < 500 * MS
    assert len(rig.frames) == frames_before
    rig, clock = make_rig(active=False)
    frames_before = len(rig.frames)
    with pytest.raises(Refused, match="the hand is not active: nothing was moved") as caught:
        take_over(rig.driver, clock)
    assert caught.value.remedy == "empty it, then `grasp gripper activate`"
    clock.sleep_until_ns(clock.now_ns + 4_000 * MS)
    assert not rig.state.active
    assert len(rig.frames) == frames_before
