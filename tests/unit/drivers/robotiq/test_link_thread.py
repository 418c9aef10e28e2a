"""The gripper's thread on a clock that stands until it is told to go on, and what times a link."""

import _thread
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import msgspec
import pytest

from drivers.errors import DeviceFault, LinkLost, Refused
from drivers.interfaces import Applied
from drivers.robotiq.link.thread import ThreadedGripper
from drivers.robotiq.link.timing import Durations, TimedTransport

MS = 1_000_000
NEVER_S = 600.0
FOR_EVER_S = 3600.0  # for what is to come by itself
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
        self.verbs: list[tuple[object, ...]] = []
        self.acts: list[Callable[[], None]] = []  # one a pump
        self.refuses = False
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
        def act(*asked: object) -> str:
            self.verbs.append((name, *asked))
            if self.refuses:
                raise Refused("not so", "otherwise")
            return f"applied {name}"

        return act

    def passes(self, ns: int) -> None:
        self.now_ns += ns

    def acknowledges(self) -> None:
        """Whatever was written, 3 ms after it was begun."""
        self.now_ns += 3 * MS
        self.acknowledged_ns = self.now_ns

    def wait(self) -> None:
        until(lambda: self._pumped.acquire(timeout=0.005))


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
        gripper.start(within_s=FOR_EVER_S)
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
    for _ in range(2000):
        if true():
            return
        assert pumping(), "the thread has ended"
        pause.wait(0.005)
    raise AssertionError("never")


def pumping() -> int:
    """How many threads there are that pump a gripper."""
    return [thread.name for thread in threading.enumerate()].count("gripper")


def idle(cell: Cell) -> None:
    """A pump that takes no time and writes nothing."""


def test_first_exchange_is_at_once_and_no_other_follows_before_its_period(made: Made) -> None:
    cell, gripper = made()
    assert cell.pumped_ns == [BEGIN_NS]
    assert (gripper.statistics.missed, gripper.statistics.woken) == (0, 0)
    assert gripper.statistics.pumps == 1
    assert gripper.acknowledged


def test_program_may_end_while_an_exchange_hangs_and_the_hand_s_mode_is_the_core_s(
    made: Made,
) -> None:
    cell, gripper = made()
    assert [t.daemon for t in threading.enumerate() if t.name == "gripper"] == [True]
    setattr(cell, "mode", 3)  # noqa: B010 - what else it is asked for is a verb
    assert gripper.mode == 3


def test_one_thread_pumps_however_often_it_is_started(made: Made) -> None:
    cell, gripper = made()
    gripper.start()
    assert (pumping(), cell.pumped_ns) == (1, [BEGIN_NS])


def test_thread_ends_and_the_connection_is_let_go_of_by_closing_and_where_a_block_ends() -> None:
    closed = list[str]()
    for how in ("close", "with"):
        cell: Any = Cell()
        gripper = ThreadedGripper(cell, NEVER_S, close=partial(closed.append, how))
        if how == "close":
            gripper.start(within_s=FOR_EVER_S)
            gripper.close(within_s=FOR_EVER_S)
        else:
            with gripper as entered:
                assert entered is gripper
        assert (pumping(), len(cell.pumped_ns)) == (0, 1)
    assert closed == ["close", "with"]


def test_an_exchange_that_hangs_is_waited_for_for_so_long_and_told(made: Made) -> None:
    goes_on = threading.Event()
    cell, gripper = made(idle, lambda cell: goes_on.wait())
    gripper.hold()
    cell.wait()
    with pytest.raises(LinkLost, match=r"did not end within 0\.01 s"):
        gripper.stop(within_s=0.01)
    goes_on.set()
    gripper.stop(within_s=FOR_EVER_S)


def test_by_custom_an_exchange_that_hangs_is_waited_for_for_five_seconds(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    goes_on = threading.Event()
    cell, gripper = made(idle, lambda cell: goes_on.wait())
    gripper.hold()
    cell.wait()
    with monkeypatch.context() as impatient:
        impatient.setattr(threading.Thread, "join", lambda thread, within_s: None)
        with pytest.raises(LinkLost, match="did not end within 5 s"):
            gripper.stop()
    goes_on.set()


def test_who_starts_a_thread_that_a_bug_ends_is_not_kept_waiting() -> None:
    def breaks() -> None:
        raise ZeroDivisionError("a bug")

    cell: Any = Cell()
    cell.acts = [breaks]
    gripper = ThreadedGripper(cell, NEVER_S)
    gripper.start(within_s=FOR_EVER_S)
    with pytest.raises(ZeroDivisionError):
        gripper.pump(0)
    gripper.close()


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


def test_reply_within_the_nanosecond_in_which_it_was_asked_is_one(made: Made) -> None:
    def at_once(cell: Cell) -> None:
        cell.acknowledged_ns = cell.now_ns

    cell, gripper = made(idle, at_once)
    gripper.hold()
    cell.wait()
    settled(gripper, 2)
    assert gripper.acknowledgements_ns == ((BEGIN_NS, BEGIN_NS),)


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


def test_verb_that_is_held_back_brings_one_pump_forward_and_no_more(made: Made) -> None:
    cell, gripper = made(idle, Cell.acknowledges, write_interval_s=NEVER_S)
    for pumps in (2, 3):
        cell.passes(500 * MS)
        gripper.hold()
        cell.wait()
        settled(gripper, pumps)
    threading.Event().wait(0.05)
    assert (gripper.statistics.pumps, gripper.acknowledged) == (3, False)


@pytest.mark.parametrize(("asked", "interval_ms"), [({"write_interval_s": 0.02}, 20), ({}, 10)])
def test_verb_that_was_held_back_and_needs_no_write_is_not_waited_for_longer(
    made: Made, asked: dict[str, float], interval_ms: int
) -> None:
    cell, gripper = made(idle, Cell.acknowledges, **asked)
    cell.passes(500 * MS)
    gripper.hold()
    cell.wait()
    settled(gripper, 2)
    cell.now_ns = cell.pumped_ns[-1] + interval_ms * MS
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


def test_a_link_that_was_found_again_and_is_lost_once_more_is_told_of_both_times(
    made: Made,
) -> None:
    def lost(cell: Cell) -> None:
        raise LinkLost(f"{len(cell.pumped_ns)}", "look")

    def hot(cell: Cell) -> None:
        raise DeviceFault(f"{len(cell.pumped_ns)}", "wait")

    acts = [lost, lost, idle, lost, hot, lost]
    cell, gripper = made(*acts)
    for pumps in range(2, len(acts) + 1):
        gripper.hold()
        cell.wait()
        settled(gripper, pumps)
    for said in "1456":
        with pytest.raises((LinkLost, DeviceFault), match=said):
            gripper.pump(0)
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
    answers: list[object] = [
        gripper.activate(dropping=True), gripper.activate(), gripper.open(0.1),
        gripper.move_to((1, 2, 3), 0.05, 7.0),
        gripper.close_fast(9.0, (True, False, True), (4, 5, 6), 0.03), gripper.hold(),
    ]  # fmt: skip
    verbs = ("activate", "activate", "open", "move_to", "close_fast", "hold")
    assert answers == [f"applied {verb}" for verb in verbs]
    assert cell.verbs == [
        ("activate", True), ("activate", False), ("open", 0.1), ("move_to", (1, 2, 3), 0.05, 7.0),
        ("close_fast", 9.0, (True, False, True), (4, 5, 6), 0.03), ("hold",),
    ]  # fmt: skip
    assert (gripper.least_force_n, gripper.m_per_count) == (10.0, 0.00077)


# Verbs while the hand is silent

NOT_YET = "the hand has not answered yet: told to it as soon as it has"


class State(msgspec.Struct, frozen=True):
    """As much of the gripper's as its thread reads."""

    fresh: bool = True
    positions: tuple[int, int, int] = (7, 8, 9)


class Silence:
    """A second exchange that is over when it is told to be; its hand speaks of the verb then."""

    def __init__(self, made: Made, ends: Callable[[Cell], None] = idle) -> None:
        self._over = threading.Event()
        self._ends = ends
        self.cell, self.gripper = made(idle, self._lasts, idle)
        self.cell.state = State()
        self.gripper.hold()  # with which the exchange begins
        self.cell.wait()
        self.cell.verbs.clear()

    def _lasts(self, cell: Cell) -> None:
        self._over.wait()
        self._ends(cell)

    def ends(self) -> None:
        self._over.set()


@pytest.fixture
def silent(made: Made) -> Iterator[Callable[..., Silence]]:
    silences: list[Silence] = []

    def make(*ends: Callable[[Cell], None]) -> Silence:
        silences.append(Silence(made, *ends))
        return silences[-1]

    yield make
    for silence in silences:
        silence.ends()


def test_verbs_to_a_silent_hand_return_what_was_asked_and_are_done_when_its_exchange_is_over(
    silent: Callable[..., Silence],
) -> None:
    hand = silent()
    cell, gripper = hand.cell, hand.gripper
    asked: tuple[tuple[Callable[[], Applied], Applied], ...] = (
        (lambda: gripper.open(0.1), Applied((0, 0, 0), 0.1, 10.0, note=NOT_YET)),
        (lambda: gripper.move_to((1, 2, 3), 0.05, 7.0),
         Applied((1, 2, 3), 0.05, 7.0, note=NOT_YET)),
        (gripper.hold, Applied((7, 8, 9), 0.0, 10.0, note=NOT_YET)),
        (lambda: gripper.close_fast(9.0, (True, False, True), (4, 5, 6), 0.03),
         Applied((4, 5, 6), 0.03, 9.0, note=NOT_YET)),
    )  # fmt: skip
    for verb, applied in asked:
        cell.passes(MS)
        assert verb() == applied
        assert not gripper.acknowledged
        seen: Any = gripper.state
        assert seen == State(fresh=False), "it speaks of no verb that was put off"
    assert cell.verbs == []
    cell.state = State(fresh=False)
    cell.writes_from_ns = cell.now_ns
    hand.ends()
    until(lambda: gripper.acknowledged)
    assert cell.verbs == [("close_fast", 9.0, (True, False, True), (4, 5, 6), 0.03)], "the latest"
    assert gripper.acknowledgements_ns[0][0] == BEGIN_NS + 4 * MS, "from when it was given"


def test_verb_that_was_put_off_is_done_before_the_next_write_and_not_again(
    silent: Callable[..., Silence],
) -> None:
    hand = silent()
    hand.gripper.hold()
    hand.ends()
    settled(hand.gripper, 3)
    assert hand.gripper.acknowledged
    assert hand.cell.verbs == [("hold",)]
    hand.gripper.open(0.1)
    settled(hand.gripper, 4)
    assert hand.cell.verbs == [("hold",), ("open", 0.1)]


def test_refusal_of_a_verb_that_was_put_off_is_raised_by_the_next_pump(
    silent: Callable[..., Silence],
) -> None:
    hand = silent()
    hand.cell.refuses = True
    hand.gripper.hold()
    hand.gripper.pump(0)
    hand.ends()
    until(lambda: hand.gripper.acknowledged)
    with pytest.raises(Refused, match="not so"):
        hand.gripper.pump(0)
    hand.gripper.pump(0)
    assert len(hand.cell.verbs) == 1


def test_loss_that_ends_the_silence_is_told_before_the_verb_is_done(
    silent: Callable[..., Silence],
) -> None:
    def lost(cell: Cell) -> None:
        raise LinkLost("gone", "look")

    hand = silent(lost)
    hand.cell.refuses = True
    hand.gripper.hold()
    hand.ends()
    until(lambda: hand.gripper.acknowledged)
    for told in (LinkLost, Refused):
        with pytest.raises(told):
            hand.gripper.pump(0)


def test_activation_alone_waits_for_a_silent_hand(silent: Callable[..., Silence]) -> None:
    hand = silent()
    waiting = threading.Thread(target=hand.gripper.activate)
    waiting.start()
    waiting.join(0.05)
    assert (waiting.is_alive(), hand.cell.verbs) == (True, [])
    hand.ends()
    waiting.join()
    assert hand.cell.verbs == [("activate", False)]


class Lock:
    """As ``threading.Lock``; while it is taken nobody has it who would not wait for ever."""

    taken = False
    patience_s = 0.0  # of whoever did not get it

    def __init__(self) -> None:
        lock = _thread.allocate_lock()
        self.release, self.locked = lock.release, lock.locked
        self.__lock = lock

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        if timeout > 0 and Lock.taken:
            Lock.patience_s = timeout
            return False
        return self.__lock.acquire(blocking, timeout)

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


@pytest.fixture
def late(made: Made, monkeypatch: pytest.MonkeyPatch) -> tuple[Cell, ThreadedGripper]:
    """A gripper whose thread ended while a verb was being put off, a hold."""
    with monkeypatch.context() as patched:
        patched.setattr(threading, "Lock", Lock)
        cell, gripper = made()
    gripper.stop()
    with monkeypatch.context() as patched:
        patched.setattr(Lock, "taken", True)
        asked = gripper.hold()
    assert (asked.targets_counts, asked.note) == ((0, 0, 0), NOT_YET), "no position is known yet"
    return cell, gripper


VERBS: list[tuple[str, Callable[[ThreadedGripper], object]]] = [
    ("activate", lambda gripper: gripper.activate()),
    ("open", lambda gripper: gripper.open(0.1)),
]


@pytest.mark.parametrize(("name", "verb"), VERBS)
def test_verb_that_was_put_off_gives_way_to_the_next(
    late: tuple[Cell, ThreadedGripper], name: str, verb: Callable[[ThreadedGripper], object]
) -> None:
    cell, gripper = late
    assert not gripper.acknowledged
    cell.state = State()
    verb(gripper)
    assert gripper.state is not None
    assert gripper.state.fresh, "nothing is put off any more"
    assert [done for done, *_ in cell.verbs] == [name]


def test_verb_that_was_put_off_is_not_done_by_a_thread_that_is_started_later(
    late: tuple[Cell, ThreadedGripper],
) -> None:
    cell, gripper = late
    gripper.start(within_s=FOR_EVER_S)
    settled(gripper, 2)
    assert cell.verbs == []
    assert gripper.acknowledged


def test_verb_that_is_put_off_as_an_exchange_ends_wakes_the_thread_and_is_written_by_the_next(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = list[int]()
    with monkeypatch.context() as patched:
        patched.setattr(threading, "Lock", Lock)
        _, gripper = made(idle, lambda cell: known.append(len(cell.verbs)))
    with monkeypatch.context() as patched:
        patched.setattr(Lock, "taken", True)
        assert gripper.hold().note == NOT_YET
    until(lambda: gripper.acknowledged)
    assert known == [1], "it was done before the exchange"
    assert Lock.patience_s == 0.002


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
