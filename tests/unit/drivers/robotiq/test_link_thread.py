"""The gripper's thread on a clock that stands until it is told to go on."""

import logging
import threading
from functools import partial
from typing import Any

import pytest

from drivers.errors import DeviceFault, LinkLost
from drivers.robotiq.link.thread import ThreadedGripper
from tests.unit.drivers.robotiq.link_cell import (
    BEGIN_NS,
    FOR_EVER_S,
    MS,
    NEVER_S,
    Cell,
    Made,
    idle,
    pumping,
    settled,
    until,
)


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


def breaks(bug: type[BaseException] = ZeroDivisionError) -> None:
    raise bug("a bug")


@pytest.mark.parametrize("bug", [ZeroDivisionError, SystemExit])
def test_a_bug_of_the_core_is_told_once_and_the_hand_can_still_be_told(
    bug: type[BaseException], made: Made
) -> None:
    cell, gripper = made(idle, lambda cell: breaks(bug))
    gripper.hold()
    with pytest.raises(bug):
        raised(gripper)
    gripper.pump(0)
    gripper.hold()
    before = len(cell.pumped_ns)
    until(lambda: len(cell.pumped_ns) > before)
    assert cell.verbs == [("hold",)] * 2


def raised(gripper: ThreadedGripper) -> None:
    """Until the thread has come so far."""
    pause = threading.Event()
    for _ in range(2000):
        gripper.pump(0)
        pause.wait(0.005)


def test_a_bug_that_comes_back_ends_the_thread_and_is_told_by_every_call(made: Made) -> None:
    _, gripper = made(idle, *[lambda cell: breaks()] * 3)
    gripper.hold()
    for _ in range(6):
        with pytest.raises(ZeroDivisionError):
            raised(gripper)
    with pytest.raises(LinkLost, match="nothing reaches the gripper"):
        gripper.hold()


def test_who_starts_a_thread_that_a_bug_ends_is_not_kept_waiting() -> None:
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


SECOND_NS = 1_000_000_000
CLOSING = ("close_fast", 10.0, (True, False, False), (255, 255, 255), 0.02)


def closes(core: Any) -> Any:
    return core.close_fast(*CLOSING[1:])


def exchanges(cell: Cell, gripper: ThreadedGripper) -> None:
    """Two more, the second of which began after now."""
    settled(gripper, gripper.statistics.pumps + 2)


def test_without_a_poll_for_a_second_the_thread_gives_the_fallback_command_once_and_logs_it(
    made: Made, caplog: pytest.LogCaptureFixture
) -> None:
    cell, gripper = made(period_s=0.001)
    gripper.set_fallback(closes, "close A, at most 10 N")
    cell.passes(SECOND_NS - 1)
    exchanges(cell, gripper)
    assert cell.verbs == []
    cell.passes(1)
    until(lambda: bool(caplog.records))
    assert cell.verbs == [CLOSING]
    cell.passes(SECOND_NS)
    exchanges(cell, gripper)
    assert cell.verbs == [CLOSING]
    said = "grasp: no control step for 1 s; the gripper acts by itself: close A, at most 10 N"
    assert caplog.record_tuples == [("drivers.robotiq.link.thread", logging.WARNING, said)]


@pytest.mark.parametrize("polls", ["pump", "hold"])
def test_hand_that_is_polled_or_commanded_gets_no_fallback_command(polls: str, made: Made) -> None:
    cell, gripper = made(period_s=0.001)
    gripper.set_fallback(closes, "close")
    for _ in range(3):
        cell.passes(SECOND_NS // 2)
        gripper.pump(0) if polls == "pump" else gripper.hold()
        exchanges(cell, gripper)
    assert CLOSING not in cell.verbs


def test_without_a_fallback_command_nothing_is_done_however_long_nobody_polls(made: Made) -> None:
    cell, gripper = made(period_s=0.001)
    gripper.set_fallback(closes, "close")
    gripper.set_fallback(None)
    cell.passes(100 * SECOND_NS)
    exchanges(cell, gripper)
    assert cell.verbs == []


def test_fallback_command_is_given_again_once_a_lost_link_is_back(
    made: Made, caplog: pytest.LogCaptureFixture
) -> None:
    cell, gripper = made(period_s=0.001)
    gripper.set_fallback(closes, "close")
    cell.acts = [lambda: unplugged("gone")] * 3
    until(lambda: not cell.acts)
    cell.passes(SECOND_NS)
    until(lambda: len(cell.verbs) == 1)
    exchanges(cell, gripper)
    cell.acts = [lambda: unplugged("gone again")]
    until(lambda: len(cell.verbs) == 2)
    assert cell.verbs == [CLOSING] * 2


def test_fallback_command_that_is_refused_is_logged_as_such(
    made: Made, caplog: pytest.LogCaptureFixture
) -> None:
    cell, gripper = made(period_s=0.001)
    gripper.set_fallback(closes, "close")
    cell.refuses = True
    cell.passes(SECOND_NS)
    until(lambda: bool(caplog.records))
    assert caplog.messages[0].endswith("cannot close: not so")


def unplugged(message: str) -> None:
    raise LinkLost(message, "look")


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
