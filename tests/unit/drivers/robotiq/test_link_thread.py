"""The gripper's thread on a clock that stands until it is told to go on, and what times a link."""

import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest

from drivers.errors import DeviceFault, LinkLost
from drivers.robotiq.link.thread import ThreadedGripper
from drivers.robotiq.link.timing import Durations, TimedTransport

MS = 1_000_000
NEVER_S = 600.0
BEGIN_NS = 10**12


class Cell:
    """A core, its transport's stopwatch and the clock of both: nothing passes by itself."""

    least_force_n = 10.0
    m_per_count = 0.00077

    def __init__(self) -> None:
        self.now_ns = BEGIN_NS
        self.acknowledged_ns: int | None = None
        self.state: Any = None
        self.pumped_ns: list[int] = []
        self.verbs: list[object] = []
        self.acts: list[Callable[[], None]] = []  # one a pump
        self.writes_from_ns = 1 << 62
        self._pumped = threading.Semaphore(0)

    def clock(self) -> int:
        return self.now_ns

    def pump(self, now_ns: int) -> None:
        self.pumped_ns.append(now_ns)
        self._pumped.release()
        if self.acts:
            self.acts.pop(0)()
        if now_ns >= self.writes_from_ns:
            self.acknowledges()

    def __getattr__(self, name: str) -> Any:
        return lambda *asked: self.verbs.append((name, *asked))

    def passes(self, ns: int) -> None:
        self.now_ns += ns

    def acknowledges(self) -> None:
        """Whatever was written, 3 ms after it was begun."""
        self.now_ns += 3 * MS
        self.acknowledged_ns = self.now_ns

    def wait(self, pumps: int = 1) -> None:
        for _ in range(pumps):
            assert self._pumped.acquire(timeout=60)


Made = Callable[..., tuple[Cell, ThreadedGripper]]


@pytest.fixture
def made() -> Iterator[Made]:
    opened: list[ThreadedGripper] = []

    def make(
        *acts: Callable[[Cell], None], period_s: float = NEVER_S, **more: Any
    ) -> tuple[Cell, ThreadedGripper]:
        cell: Any = Cell()
        cell.acts = [lambda act=act: act(cell) for act in acts]
        gripper = ThreadedGripper(cell, period_s, timed=cell, clock=cell.clock, **more)
        opened.append(gripper)
        gripper.start()
        cell.wait()
        settled(gripper, 1)
        return cell, gripper

    yield make
    for gripper in opened:
        gripper.close()


def settled(gripper: ThreadedGripper, pumps: int) -> None:
    """After so many exchanges, with what follows from them."""
    until(lambda: gripper.statistics.pumps >= pumps)


def until(true: Callable[[], bool]) -> None:
    pause = threading.Event()
    for _ in range(6000):
        if true():
            return
        pause.wait(0.005)
    raise AssertionError("never")


def idle(cell: Cell) -> None:
    """A pump that takes no time and writes nothing."""


def test_first_exchange_is_at_once_and_no_other_follows_before_its_period(made: Made) -> None:
    cell, gripper = made()
    assert cell.pumped_ns == [BEGIN_NS]
    assert (gripper.statistics.missed, gripper.statistics.woken) == (0, 0)
    assert gripper.acknowledged


def test_one_thread_pumps_however_often_it_is_started(made: Made) -> None:
    cell, gripper = made()
    gripper.start()
    names = [thread.name for thread in threading.enumerate()]
    assert (names.count("gripper"), cell.pumped_ns) == (1, [BEGIN_NS])


def test_one_that_was_stopped_goes_on_when_it_is_started_and_has_exchanged_then(made: Made) -> None:
    pause, told = threading.Event(), list[str]()

    def slowly(cell: Cell) -> None:
        pause.wait(0.1)
        told.append("exchanged")

    cell, gripper = made(idle, slowly)
    gripper.stop()
    gripper.start()
    assert (told, len(cell.pumped_ns)) == (["exchanged"], 2)


def test_verb_waits_for_the_reply_to_its_write_and_is_timed_from_when_it_was_given(
    made: Made,
) -> None:
    cell, gripper = made(idle, Cell.acknowledges)
    cell.passes(500 * MS)
    gripper.hold()
    cell.wait()
    settled(gripper, 2)
    assert cell.verbs == [("hold",)]
    assert gripper.statistics.woken == 1
    called_ns = BEGIN_NS + 500 * MS
    assert gripper.acknowledgements_ns == ((called_ns, called_ns + 3 * MS),)
    assert gripper.acknowledged
    assert gripper.statistics.pumps_ns == (0, 3 * MS)


def test_verb_that_nothing_needs_to_be_written_for_is_not_waited_for(made: Made) -> None:
    cell, gripper = made()
    cell.passes(500 * MS)
    gripper.hold()
    cell.wait()
    settled(gripper, 2)
    assert gripper.acknowledged
    assert gripper.acknowledgements_ns == ()


def test_verbs_within_the_interval_after_a_write_wait_until_it_is_over(made: Made) -> None:
    cell, gripper = made(idle, Cell.acknowledges, write_interval_s=0.02)
    cell.passes(500 * MS)
    gripper.hold()
    cell.wait()
    settled(gripper, 2)
    written_ns = cell.pumped_ns[-1]
    cell.now_ns = called_ns = written_ns + 4 * MS
    gripper.open(0.1)
    cell.now_ns = written_ns + 9 * MS
    gripper.hold()
    cell.wait()
    settled(gripper, 3)
    cell.now_ns = written_ns + 20 * MS - 1
    pumps = gripper.statistics.pumps
    settled(gripper, pumps + 2)
    assert not gripper.acknowledged, "the core has held it back"
    cell.writes_from_ns = cell.now_ns = written_ns + 20 * MS
    until(lambda: gripper.acknowledged)
    assert gripper.acknowledgements_ns[1:] == ((called_ns, written_ns + 23 * MS),)


def test_verb_that_was_held_back_and_needs_no_write_is_not_waited_for_longer(made: Made) -> None:
    cell, gripper = made(idle, Cell.acknowledges, write_interval_s=0.02)
    cell.passes(500 * MS)
    gripper.hold()
    cell.wait()
    settled(gripper, 2)
    cell.now_ns = cell.pumped_ns[-1] + 20 * MS
    gripper.hold()
    cell.wait()
    settled(gripper, 3)
    assert gripper.acknowledged
    assert len(gripper.acknowledgements_ns) == 1


def test_verbs_on_a_lost_link_are_not_waited_for(made: Made) -> None:
    def lost(cell: Cell) -> None:
        raise LinkLost("gone", "look")

    cell, gripper = made(Cell.acknowledges, lost)
    gripper.hold()  # within the interval of the first write
    cell.wait()
    settled(gripper, 2)
    assert gripper.acknowledged
    with pytest.raises(LinkLost):
        gripper.pump(0)


def test_periods_that_passed_are_missed_and_the_grid_is_kept(made: Made) -> None:
    cell, gripper = made(lambda cell: cell.passes(35 * MS), period_s=0.01)
    cell.wait()
    settled(gripper, 2)
    assert cell.pumped_ns[:2] == [BEGIN_NS, BEGIN_NS + 35 * MS]
    assert gripper.statistics.missed == 2, "those that were due after 10 and 20 ms"
    assert gripper.statistics.pumps_ns[0] == 35 * MS
    assert gripper.statistics.woken == 0


def test_errors_beyond_eight_that_nobody_asked_for_are_not_kept(made: Made) -> None:
    def fails(cell: Cell) -> None:
        raise DeviceFault(f"{len(cell.pumped_ns)}", "")

    cell, gripper = made(*[fails] * 20)
    for _ in range(11):
        before = gripper.statistics.pumps
        gripper.hold()
        cell.wait()
        settled(gripper, before + 1)
    said = []
    for _ in range(8):
        with pytest.raises(DeviceFault) as told:
            gripper.pump(0)
        said.append(told.value.message)
    gripper.pump(0)
    assert said == [str(n) for n in range(1, 9)]


def test_verbs_go_to_the_core_as_they_are(made: Made) -> None:
    cell, gripper = made()
    gripper.activate(dropping=True)
    gripper.activate()
    gripper.open(0.1)
    gripper.move_to((1, 2, 3), 0.05, 7.0)
    gripper.close_fast(9.0, (True, False, True), (4, 5, 6), 0.03)
    gripper.hold()
    assert cell.verbs == [
        ("activate", True), ("activate", False), ("open", 0.1), ("move_to", (1, 2, 3), 0.05, 7.0),
        ("close_fast", 9.0, (True, False, True), (4, 5, 6), 0.03), ("hold",),
    ]  # fmt: skip
    assert (gripper.least_force_n, gripper.m_per_count) == (10.0, 0.00077)


# Timing


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
