"""What times a link's requests."""

from collections.abc import Sequence

import pytest

from drivers.errors import LinkLost
from drivers.robotiq.link.modbus import Durations, TimedTransport
from tests.unit.drivers.robotiq.link_cell import BEGIN_NS, MS, Cell


def test_the_latest_4096_durations_are_kept_oldest_first() -> None:
    durations = Durations()
    for ns in range(4100):
        durations.add(ns)
    assert durations.latest_ns == tuple(range(4, 4100))


class Line:
    """Registers whose requests take 5 ms, or fail."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self.fails = False
        self.written: list[object] = []

    def write(self, first_register: int, registers: Sequence[int], now_ns: int) -> None:
        self.cell.passes(5 * MS)
        if self.fails:
            raise LinkLost("gone", "look")
        self.written.append((first_register, tuple(registers), now_ns))

    def read(self, first_register: int, count: int, now_ns: int) -> Sequence[int]:
        self.write(first_register, (count,), now_ns)
        return [7] * count


def test_requests_are_timed_and_one_that_fails_leaves_no_duration() -> None:
    cell = Cell()
    line = Line(cell)
    timed = TimedTransport(line, cell.clock)
    assert timed.read(1, 3, 11) == [7, 7, 7]
    assert timed.acknowledged_ns is None
    timed.write(2, [8, 9], 12)
    assert timed.acknowledged_ns == BEGIN_NS + 10 * MS
    assert line.written == [(1, (3,), 11), (2, (8, 9), 12)]
    line.fails = True
    for request in (lambda: timed.write(2, [8], 13), lambda: timed.read(1, 3, 14)):
        with pytest.raises(LinkLost):
            request()
    assert (timed.writes.latest_ns, timed.reads.latest_ns) == ((5 * MS,), (5 * MS,))
    assert timed.acknowledged_ns == BEGIN_NS + 10 * MS
