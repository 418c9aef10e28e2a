"""The driver core and a hand that somebody else has put into another mode than basic."""

import pytest

from drivers.errors import LinkLost, Refused
from drivers.interfaces import Detection
from drivers.robotiq.encoding import finger_states, pinches
from drivers.robotiq.protocol import (
    AxisCommand,
    AxisStatus,
    CommandRegisters,
    StatusRegisters,
    other_than_basic,
)
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


@pytest.mark.parametrize("mode", [1, 2])
def test_the_mode_of_an_adopted_hand_is_kept(rig, mode: int) -> None:
    made = left_in(rig(), mode)
    assert made.driver.mode == mode
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.step(20)
    assert made.written[-1].mode == mode
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


def test_hand_in_scissor_mode_is_not_open_before_b_and_c_are_apart(rig) -> None:
    """They are moved by two motors each."""
    made = left_in(rig(), SCISSOR)
    assert made.state.is_open
    made.driver.open(FAST)
    made.step(20)
    assert max(made.state.positions) < 20
    assert scissor_of(made) > 0
    a, b, c = (finger.detection for finger in made.state.fingers)
    assert (a, b, c) == (Detection.AT_TARGET, Detection.MOVING, Detection.MOVING)
    assert not made.state.is_open
    made.settle()
    assert made.state.is_open


@pytest.mark.parametrize("at", [0, 120])
def test_what_stands_in_scissor_mode_keeps_its_scissor_too(rig, at: int) -> None:
    """Its one position would drive the scissor: to where finger A is."""
    made = left_in(rig(), SCISSOR, at)
    stood = scissor_of(made), made.state.positions
    made.driver.hold()
    made.step(300)
    assert (scissor_of(made), made.state.positions) == stood
    assert made.driver.acknowledged
    assert {told.scissor.speed for told in made.written} == {0}


def test_one_finger_opens_in_scissor_mode_and_the_others_stay(rig) -> None:
    made = left_in(rig(), SCISSOR, at=120)
    made.driver.move_to((120, 100, 120), FAST, 10.0)
    made.settle()
    assert made.state.positions == (120, 100, 120)
    assert scissor_of(made) == SPREAD


def test_hand_that_opens_in_scissor_mode_stands_when_it_is_told_to(rig) -> None:
    made = left_in(rig(), SCISSOR, at=120)
    made.driver.open(FAST)
    made.step(8)
    made.driver.hold()
    made.settle()
    assert 20 < min(made.state.positions) < 120
    assert 0 < scissor_of(made) < SPREAD


def test_hand_that_was_deaf_in_scissor_mode_is_told_to_stay_as_it_is(rig) -> None:
    made = left_in(rig(), SCISSOR, at=120)
    made.driver.move_to((120, 119, 120), FAST, 10.0)
    made.settle()
    made.transport.down = True
    with pytest.raises(LinkLost):
        made.step()
    made.transport.down = False
    made.step(300)
    assert made.state.positions == (120, 119, 120)
    assert scissor_of(made) == SPREAD


@pytest.mark.parametrize("mode", [1, 2, SCISSOR])
def test_activation_of_an_open_hand_in_another_mode_sets_the_basic_one(rig, mode: int) -> None:
    made = left_in(rig(hand=QUICK), mode)
    assert made.driver.activate().effective
    made.step(3)
    assert not made.state.active, "the mode is being changed"
    made.settle()
    assert (made.driver.mode, made.state.active, made.state.positions) == (0, True, (6, 6, 6))
    assert scissor_of(made) == 137
    assert made.frames == ["01" + "00" * 15], "no reset, which would open and close it fully"
    made.driver.move_to((50, 50, 50), FAST, 10.0)
    made.settle()
    assert made.state.positions == (50, 50, 50)


@pytest.mark.parametrize("mode", [1, 2, SCISSOR])
def test_activation_changes_no_mode_of_a_hand_that_is_not_open(rig, mode: int) -> None:
    made = left_in(rig(), mode, at=60)
    with pytest.raises(Refused, match="would drop"):
        made.driver.activate()
    assert made.frames == []


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


def test_somebody_elses_scissor_that_moves_is_fingers_that_move() -> None:
    moving = StatusRegisters(
        active=True, mode=SCISSOR, go_to=True, initialization=3, a=AxisStatus(detection=3),
        b=AxisStatus(detection=3), c=AxisStatus(detection=3), scissor=AxisStatus(detection=0),
    )  # fmt: skip
    a, b, c = finger_states(moving)
    assert a.detection is Detection.AT_TARGET
    assert b.detection is c.detection is Detection.MOVING
    assert not pinches(moving)


@pytest.mark.parametrize(("mode", "name"), [(1, "pinch"), (2, "wide"), (3, "scissor")])
def test_what_is_to_be_known_of_a_mode_names_it_and_of_the_basic_one_there_is_nothing(
    mode: int, name: str
) -> None:
    assert other_than_basic(mode) == (
        f"in {name} mode: positions, forces and calibrations here are of basic mode"
    )
    assert other_than_basic(0) == ""
