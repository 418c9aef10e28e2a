"""Another client writes the hand's registers. The driver writes all its registers again and reports
the other client to its caller."""

import pytest

from drivers.errors import DeviceFault
from drivers.robotiq.protocol import CommandRegisters
from tests.unit.drivers.robotiq.gripping import ALL, FAST, QUICK, RIGID, THUMB, gripped
from tests.unit.drivers.robotiq.hand import command

LIMIT_N, OVERSHOOT_N = 10.0, 1.0
OPENED = command(0)  # all fingers by finger A's bytes
CLOSED = command(255, force=255)
SLOW = 0.03


def reported_change(made, another: CommandRegisters) -> str:
    """Change reported by the fault within three exchanges of another client's write."""
    made.model.write(0, another.to_registers(), made.now_ns)
    with pytest.raises(DeviceFault, match=r"another client changed the gripper's registers") as it:
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
def test_another_clients_write_is_reported_with_its_values_and_overwritten(
    rig, springs, another: CommandRegisters, said: str
) -> None:
    made = gripped(rig, springs)
    made.step(60)
    own, firsts, peak_n = made.written[-1], [], max(made.peak_n)
    write = made.transport.write
    made.transport.write = lambda first, *rest: (firsts.append(first), write(first, *rest))
    assert reported_change(made, another) == said
    made.settle()
    assert firsts[0] == 0 and made.written[-1] == own
    assert made.state.fresh
    assert max(made.peak_n) < peak_n + OVERSHOOT_N


@pytest.mark.parametrize("late_ms", range(0, 20, 4))
def test_holding_fingers_stay_when_another_client_writes_just_before_a_close(
    rig, springs, late_ms: int
) -> None:
    made = rig(springs=springs([RIGID] * 3, [0.03] * 3))
    made.driver.move_to((30, 30, 30), FAST, LIMIT_N)
    made.settle()
    made.advance(late_ms)
    made.model.write(0, (OPENED.to_registers()[0],), made.now_ns)  # rICF alone
    made.driver.close_to_limit(LIMIT_N, THUMB, (255, 0, 0), SLOW)
    with pytest.raises(DeviceFault, match="another client"):
        made.step(4)
    made.settle()
    assert made.peak_n[0] > LIMIT_N - OVERSHOOT_N
    assert made.peak_n[0] < LIMIT_N + OVERSHOOT_N
    assert max(made.peak_n[1:]) <= 0.0, "B and C touched nothing"


def test_repeated_writes_of_another_client_are_overwritten_each_time(rig, springs) -> None:
    made = gripped(rig, springs)
    for _ in range(5):
        reported_change(made, OPENED)
        made.step(3)
        assert made.state.fresh and made.state.requested == (255, 255, 255)


def test_driver_without_a_command_ignores_another_client(rig) -> None:
    made = rig()
    made.step(60)
    made.model.write(0, CLOSED.to_registers(), made.now_ns)
    made.step(300)
    assert made.state.positions == (240, 240, 240) and made.written == []


def test_a_command_that_is_not_taken_up_is_not_taken_for_another_client(rig) -> None:
    made = rig()
    made.driver.move_to((60, 60, 60), FAST, LIMIT_N)
    made.settle()
    made.model.ignores_writes = True
    made.driver.close_to_limit(LIMIT_N, ALL, (200, 200, 200), FAST)
    made.step(50)
    assert not made.state.fresh


def test_quick_commands_taken_up_late_are_not_taken_for_another_client(
    rig,
) -> None:
    made = rig()
    for counts in range(40, 120, 4):
        made.driver.move_to((counts, counts + 1, counts + 2), FAST, LIMIT_N)
        made.step()
    made.settle()
    assert made.state.positions == (116, 117, 118)


def test_no_motion_is_commanded_after_another_client_changed_the_mode(rig) -> None:
    """Otherwise it would move unexpectedly once its mode has changed."""
    made = rig(hand=QUICK)
    made.driver.move_to((60, 60, 60), FAST, LIMIT_N)
    made.settle()
    written = len(made.written)
    made.model.write(0, command(0, mode=1).to_registers(), made.now_ns)
    with pytest.raises(DeviceFault, match=r"another client changed .* rMOD 1, expected 0"):
        made.step(500)
    assert len(made.written) == written


@pytest.mark.parametrize("late_ms", range(0, 60, 12))
def test_another_clients_force_and_speed_are_overwritten_while_a_finger_closes(
    rig, springs, late_ms: int
) -> None:
    made = rig(springs=springs([RIGID] * 3, [0.03] * 3))
    made.driver.move_to((30, 30, 30), FAST, LIMIT_N)
    made.settle()
    made.driver.close_to_limit(LIMIT_N, THUMB, (255, 0, 0), SLOW)
    made.step(2)
    made.advance(late_ms)
    made.model.write(2, (0xFFFF,), made.now_ns)  # speed and force of finger A
    made.settle()
    assert made.peak_n[0] > LIMIT_N - OVERSHOOT_N
    assert made.peak_n[0] < LIMIT_N + 2 * OVERSHOOT_N
