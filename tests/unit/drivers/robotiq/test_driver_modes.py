"""Driver core with a hand that another client has put into a mode other than basic."""

import pytest

from drivers.errors import Refused
from drivers.robotiq.protocol import AxisCommand, CommandRegisters, StatusRegisters
from tests.unit.drivers.robotiq.conftest import Rig
from tests.unit.drivers.robotiq.gripping import ALL, FAST, QUICK
from tests.unit.drivers.robotiq.hand import command

SCISSOR = 3
SPREAD = 23  # scissor position that belongs to no mode


def in_mode(made: Rig, mode: int, at: int = 0) -> Rig:
    """Another client sets the mode and then closes the fingers, with B and C slightly apart."""
    made.model.write(0, CommandRegisters(activate=True, mode=mode).to_registers(), made.now_ns)
    made.step(400)
    if at:
        scissor = {"individual_scissor": True, "scissor": AxisCommand(SPREAD, 255, 0)}
        closed = command(at, at, at, mode=mode, **scissor)
        made.model.write(0, closed.to_registers(), made.now_ns)
        made.step(400)
        assert made.state.positions == (at, at, at)
    return made


def scissor_position(made: Rig) -> int:
    return StatusRegisters.from_registers(made.model.read(made.now_ns)).scissor.position


def test_the_mode_of_an_active_hand_is_kept(rig) -> None:
    for mode in [1, 2]:
        made = in_mode(rig(), mode)
        assert made.driver.mode == mode, mode
        made.driver.move_to((50, 50, 50), FAST, 10.0)
        made.step(20)
        assert made.written[-1].mode == mode, mode
        assert made.state.active, "no mode change was provoked"


def test_nothing_closes_in_scissor_mode(rig) -> None:
    made = in_mode(rig(), SCISSOR, at=120)
    for verb in (
        lambda: made.driver.move_to((120, 121, 120), FAST, 10.0),
        lambda: made.driver.close_to_limit(10.0, ALL, (130, 130, 130), FAST),
    ):
        with pytest.raises(
            Refused, match="scissor mode, in which it may only be opened"
        ) as refused:
            verb()
        assert "`grasp gripper activate`" in refused.value.remedy
    assert made.frames == []


def test_opening_in_scissor_mode_keeps_the_mode_and_releases_b_and_c(rig) -> None:
    """A mode change would open it too, at an unknown force and speed."""
    made = in_mode(rig(), SCISSOR, at=120)
    made.driver.open(FAST)
    made.step(3)
    assert not made.state.is_open
    made.settle()
    assert made.state.is_open
    assert scissor_position(made) == 0
    assert {(each.mode, each.individual_scissor) for each in made.written} == {(SCISSOR, True)}
    assert {axis.force for each in made.written for axis in (*each.fingers, each.scissor)} == {0}


def test_hold_in_scissor_mode_keeps_the_scissor_position(rig) -> None:
    """Without a target of its own, the scissor would move to finger A's position."""
    for at in [0, 120]:
        made = in_mode(rig(), SCISSOR, at)
        before = scissor_position(made), made.state.positions
        made.driver.hold()
        made.step(300)
        assert (scissor_position(made), made.state.positions) == before, at
        assert made.driver.acknowledged, at
        assert {each.scissor.speed for each in made.written} == {0}, at


def test_activation_of_an_open_hand_in_another_mode_sets_basic_mode(rig) -> None:
    for mode in [1, 2, SCISSOR]:
        made = in_mode(rig(hand=QUICK), mode)
        assert made.driver.activate().effective, mode
        made.step(3)
        assert not made.state.active, "the mode is being changed"
        made.settle()
        assert (made.driver.mode, made.state.active, made.state.positions) == (
            0,
            True,
            (6, 6, 6),
        ), mode
        assert scissor_position(made) == 137, mode
        assert made.frames == ["01" + "00" * 15], "no reset, which would open and close it fully"
        made.driver.move_to((50, 50, 50), FAST, 10.0)
        made.settle()
        assert made.state.positions == (50, 50, 50), mode


def test_activation_does_not_change_the_mode_of_a_hand_that_is_not_open(rig) -> None:
    for mode in [1, 2, SCISSOR]:
        made = in_mode(rig(), mode, at=60)
        with pytest.raises(Refused, match="would drop"):
            made.driver.activate()
        assert made.frames == [], mode


def test_activation_does_not_change_the_mode_while_b_and_c_hold_an_object(rig) -> None:
    """B and C can hold an object with open fingers in scissor mode."""
    made = in_mode(rig(), SCISSOR)
    contact = 2 << 6  # gDTS: contact while closing
    made.model.misreport(lambda words: (words[0] & ~0xC0 | contact, *words[1:]))
    made.step(3)
    assert made.state.is_open
    with pytest.raises(Refused, match="would drop"):
        made.driver.activate()
    assert made.driver.activate(dropping=True).effective
