"""Another client writes the hand's registers, which no driver can prevent. The driver writes its
own image again, whole, and reports the other client to its caller."""

import pytest

from drivers.errors import DeviceFault
from drivers.robotiq.protocol import CommandRegisters
from tests.unit.drivers.robotiq.gripping import ALL, FAST, QUICK, RIGID, THUMB, gripped
from tests.unit.drivers.robotiq.hand import command

LIMIT_N, OVERSHOOT_N = 10.0, 1.0
OPENED = command(0)  # all fingers by finger A's bytes
CLOSED = command(255, force=255)
SLOW = 0.03


def told(made, another: CommandRegisters) -> str:
    """What is raised within three exchanges of another client's write."""
    made.model.write(0, another.to_registers(), made.now_ns)
    with pytest.raises(DeviceFault, match="another client changed the gripper's registers") as it:
        made.step(3)
    return it.value.message.partition(": ")[2]


@pytest.mark.parametrize(
    ("another", "said"),
    [
        (OPENED, "targets (0, 0, 0), expected (255, 255, 255)"),
        (CLOSED, "targets (255, 0, 0), expected (255, 255, 255)"),
        (command(0, 255, 255), "targets (0, 255, 255), expected (255, 255, 255)"),
        (command(255, 255, 255, go_to=False), "rGTO 0, expected 1"),
        (command(255, 255, 255, force=255), "a finger moves without a command"),
    ],
)
def test_what_another_client_writes_is_told_with_its_values_and_written_over_whole(
    rig, springs, another: CommandRegisters, said: str
) -> None:
    made = gripped(rig, springs)
    made.step(60)
    ours, firsts, most_n = made.written[-1], [], max(made.peak_n)
    write = made.transport.write
    made.transport.write = lambda first, *rest: (firsts.append(first), write(first, *rest))
    assert told(made, another) == said
    made.settle()
    assert firsts[0] == 0 and made.written[-1] == ours
    assert made.state.fresh
    assert max(made.peak_n) < most_n + OVERSHOOT_N


@pytest.mark.parametrize("late_ms", range(0, 20, 4))
def test_fingers_that_are_to_hold_stay_though_another_client_wrote_just_before_a_close(
    rig, springs, late_ms: int
) -> None:
    made = rig(springs=springs([RIGID] * 3, [0.03] * 3))
    made.driver.move_to((30, 30, 30), FAST, LIMIT_N)
    made.settle()
    made.advance(late_ms)
    made.model.write(0, (OPENED.to_registers()[0],), made.now_ns)  # rICF alone
    made.driver.close_fast(LIMIT_N, THUMB, (255, 0, 0), SLOW)
    with pytest.raises(DeviceFault, match="another client"):
        made.step(4)
    made.settle()
    assert made.peak_n[0] > LIMIT_N - OVERSHOOT_N
    assert made.peak_n[0] < LIMIT_N + OVERSHOOT_N
    assert max(made.peak_n[1:]) <= 0.0, "B and C touched nothing"


def test_a_client_that_writes_again_and_again_is_written_over_each_time(rig, springs) -> None:
    made = gripped(rig, springs)
    for _ in range(5):
        told(made, OPENED)
        made.step(3)
        assert made.state.fresh and made.state.requested == (255, 255, 255)


def test_nothing_is_said_nor_written_by_who_has_told_the_hand_nothing(rig) -> None:
    made = rig()
    made.step(60)
    made.model.write(0, CLOSED.to_registers(), made.now_ns)
    made.step(300)
    assert made.state.positions == (240, 240, 240) and made.written == []


def test_a_command_that_the_hand_does_not_take_up_is_no_other_client_s(rig) -> None:
    made = rig()
    made.driver.move_to((60, 60, 60), FAST, LIMIT_N)
    made.settle()
    made.model.swallows = True
    made.driver.close_fast(LIMIT_N, ALL, (200, 200, 200), FAST)
    made.step(50)
    assert not made.state.fresh


def test_commands_in_quick_succession_that_the_hand_takes_up_late_are_no_other_client_s(
    rig,
) -> None:
    made = rig()
    for counts in range(40, 120, 4):
        made.driver.move_to((counts, counts + 1, counts + 2), FAST, LIMIT_N)
        made.step()
    made.settle()
    assert made.state.positions == (116, 117, 118)


def test_a_hand_that_another_client_has_change_its_mode_is_not_told_to_move(rig) -> None:
    """It would be, once its mode has changed: with nobody there who expects that."""
    made = rig(hand=QUICK)
    made.driver.move_to((60, 60, 60), FAST, LIMIT_N)
    made.settle()
    written = len(made.written)
    made.model.write(0, command(0, mode=1).to_registers(), made.now_ns)
    with pytest.raises(DeviceFault, match="in mode 1, and was taken over in mode 0"):
        made.step(500)
    assert len(made.written) == written


@pytest.mark.parametrize("late_ms", range(0, 60, 12))
def test_force_and_speed_that_no_status_shows_are_written_over_while_a_finger_closes(
    rig, springs, late_ms: int
) -> None:
    made = rig(springs=springs([RIGID] * 3, [0.03] * 3))
    made.driver.move_to((30, 30, 30), FAST, LIMIT_N)
    made.settle()
    made.driver.close_fast(LIMIT_N, THUMB, (255, 0, 0), SLOW)
    made.step(2)
    made.advance(late_ms)
    made.model.write(2, (0xFFFF,), made.now_ns)  # speed and force of finger A
    made.settle()
    assert made.peak_n[0] > LIMIT_N - OVERSHOOT_N
    assert made.peak_n[0] < LIMIT_N + 2 * OVERSHOOT_N
