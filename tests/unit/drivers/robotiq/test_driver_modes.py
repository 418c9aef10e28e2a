"""The driver core and a hand that somebody else has put into another mode than basic."""

import pytest

from drivers.errors import Refused
from drivers.robotiq.protocol import AxisCommand, CommandRegisters, StatusRegisters
from tests.unit.drivers.robotiq.conftest import Rig
from tests.unit.drivers.robotiq.gripping import ALL, FAST, QUICK
from tests.unit.drivers.robotiq.hand import command

SCISSOR = 3
SPREAD = 23  # where the test leaves the scissor, no mode's own place


def left_in(made: Rig, mode: int, at: int = 0) -> Rig:
    """Another master has set the mode, then closed the fingers there, B and C a little apart."""
    made.model.write(0, CommandRegisters(activate=True, mode=mode).to_registers(), made.now_ns)
    made.step(400)
    if at:
        scissor = {"individual_scissor": True, "scissor": AxisCommand(SPREAD, 255, 0)}
        closed = command(at, at, at, mode=mode, **scissor)
        made.model.write(0, closed.to_registers(), made.now_ns)
        made.step(400)
        assert made.state.positions == (at, at, at)
    return made


def scissor_of(made: Rig) -> int:
    return StatusRegisters.from_registers(made.model.read(made.now_ns)).scissor.position


def test_the_mode_of_an_adopted_hand_is_kept(rig) -> None:
    for mode in [1, 2]:
        made = left_in(rig(), mode)
        assert made.driver.mode == mode, mode
        made.driver.move_to((50, 50, 50), FAST, 10.0)
        made.step(20)
        assert made.written[-1].mode == mode, mode
        assert made.state.active, "no mode change was provoked"


def test_nothing_closes_in_scissor_mode(rig) -> None:
    made = left_in(rig(), SCISSOR, at=120)
    for verb in (
        lambda: made.driver.move_to((120, 121, 120), FAST, 10.0),
        lambda: made.driver.close_fast(10.0, ALL, (130, 130, 130), FAST),
    ):
        with pytest.raises(Refused, match="scissor mode, in which it is only opened") as told:
            verb()
        assert "`grasp gripper activate`" in told.value.remedy
    assert made.frames == []


def test_hand_in_scissor_mode_opens_in_that_mode_and_lets_go_of_what_b_and_c_hold(rig) -> None:
    """A change of the mode would open it too, at a force and a speed that nobody sets."""
    made = left_in(rig(), SCISSOR, at=120)
    made.driver.open(FAST)
    made.step(3)
    assert not made.state.is_open
    made.settle()
    assert made.state.is_open
    assert scissor_of(made) == 0
    assert {(told.mode, told.individual_scissor) for told in made.written} == {(SCISSOR, True)}
    assert {axis.force for told in made.written for axis in (*told.fingers, told.scissor)} == {0}


def test_what_stands_in_scissor_mode_keeps_its_scissor_too(rig) -> None:
    """Its one position would drive the scissor: to where finger A is."""
    for at in [0, 120]:
        made = left_in(rig(), SCISSOR, at)
        stood = scissor_of(made), made.state.positions
        made.driver.hold()
        made.step(300)
        assert (scissor_of(made), made.state.positions) == stood, at
        assert made.driver.acknowledged, at
        assert {told.scissor.speed for told in made.written} == {0}, at


def test_activation_of_an_open_hand_in_another_mode_sets_the_basic_one(rig) -> None:
    for mode in [1, 2, SCISSOR]:
        made = left_in(rig(hand=QUICK), mode)
        assert made.driver.activate().effective, mode
        made.step(3)
        assert not made.state.active, "the mode is being changed"
        made.settle()
        assert (made.driver.mode, made.state.active, made.state.positions) == (
            0,
            True,
            (6, 6, 6),
        ), mode
        assert scissor_of(made) == 137, mode
        assert made.frames == ["01" + "00" * 15], "no reset, which would open and close it fully"
        made.driver.move_to((50, 50, 50), FAST, 10.0)
        made.settle()
        assert made.state.positions == (50, 50, 50), mode


def test_activation_changes_no_mode_of_a_hand_that_is_not_open(rig) -> None:
    for mode in [1, 2, SCISSOR]:
        made = left_in(rig(), mode, at=60)
        with pytest.raises(Refused, match="would drop"):
            made.driver.activate()
        assert made.frames == [], mode


def test_activation_changes_no_mode_where_b_and_c_have_met_something(rig) -> None:
    """In scissor mode they hold with open fingers."""
    made = left_in(rig(), SCISSOR)
    held = 2 << 6  # gDTS: contact while closing
    made.model.misreport(lambda words: (words[0] & ~0xC0 | held, *words[1:]))
    made.step(3)
    assert made.state.is_open
    with pytest.raises(Refused, match="would drop"):
        made.driver.activate()
    assert made.driver.activate(dropping=True).effective
