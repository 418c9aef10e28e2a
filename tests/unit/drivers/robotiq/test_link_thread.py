"""The gripper thread, on a clock that the test advances."""

import logging
import threading
from typing import Any

import pytest

from drivers.errors import LinkLost
from drivers.robotiq.link import ThreadedGripper, next_tick_ns
from tests.unit.drivers.robotiq.link_cell import (
    BEGIN_NS,
    MS,
    Cell,
    Made,
    no_write,
    until,
    wait_for_polls,
)


def breaks(bug: type[BaseException] = ZeroDivisionError) -> None:
    raise bug("a bug")


def raised(gripper: ThreadedGripper) -> None:
    """Poll until the thread's exception is raised."""
    pause = threading.Event()
    for _ in range(2000):
        gripper.poll(0)
        pause.wait(0.005)


def test_repeated_exceptions_end_the_thread_and_are_raised_by_every_call(made: Made) -> None:
    _, gripper = made(no_write, *[lambda cell: breaks()] * 3)
    gripper.hold()
    for _ in range(6):
        with pytest.raises(ZeroDivisionError):
            raised(gripper)
    with pytest.raises(LinkLost, match="no command reaches the gripper"):
        gripper.hold()


def test_verb_is_acknowledged_by_the_reply_and_timed_from_its_call(
    made: Made,
) -> None:
    cell, gripper = made(no_write, Cell.acknowledges)
    cell.passes(500 * MS)
    gripper.hold()
    cell.wait()
    wait_for_polls(gripper, 2)
    assert cell.verbs == [("hold",)]
    called_ns = BEGIN_NS + 500 * MS
    assert gripper.acknowledgements_ns == ((called_ns, called_ns + 3 * MS),)
    assert gripper.acknowledged


SECOND_NS = 1_000_000_000
CLOSING = ("close_to_limit", 10.0, (True, False, False), (255, 255, 255), 0.02)


def closes(core: Any) -> Any:
    return core.close_to_limit(*CLOSING[1:])


def exchanges(cell: Cell, gripper: ThreadedGripper) -> None:
    """Wait for two more exchanges; the second begins after now."""
    wait_for_polls(gripper, gripper.polls + 2)


def test_the_fallback_command_is_sent_once_after_a_second_without_a_poll(
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
    assert caplog.record_tuples == [("drivers.robotiq.link", logging.WARNING, said)]


@pytest.mark.parametrize("polls", ["poll", "hold"])
def test_hand_that_is_polled_or_commanded_gets_no_fallback_command(polls: str, made: Made) -> None:
    cell, gripper = made(period_s=0.001)
    gripper.set_fallback(closes, "close")
    for _ in range(3):
        cell.passes(SECOND_NS // 2)
        gripper.poll(0) if polls == "poll" else gripper.hold()
        exchanges(cell, gripper)
    assert CLOSING not in cell.verbs


def test_fallback_command_is_sent_again_after_a_lost_link_has_returned(
    made: Made, caplog: pytest.LogCaptureFixture
) -> None:
    cell, gripper = made(period_s=0.001)
    gripper.set_fallback(closes, "close")
    cell.actions = [lambda: unplugged("gone")] * 3
    until(lambda: not cell.actions)
    cell.passes(SECOND_NS)
    until(lambda: len(cell.verbs) == 1)
    exchanges(cell, gripper)
    cell.actions = [lambda: unplugged("gone again")]
    until(lambda: len(cell.verbs) == 2)
    assert cell.verbs == [CLOSING] * 2


def unplugged(message: str) -> None:
    raise LinkLost(message, "look")


def test_periods_that_passed_are_skipped_and_the_grid_is_kept(made: Made) -> None:
    cell, gripper = made(lambda cell: cell.passes(35 * MS), period_s=0.01)
    cell.wait()
    wait_for_polls(gripper, 2)
    assert cell.polled_ns[:2] == [BEGIN_NS, BEGIN_NS + 35 * MS]


@pytest.mark.parametrize(
    ("polled_ms", "now_ms", "tick_ms"),
    [(None, 4, 10), (None, 9, 20), (4, 4, 11), (4, 5, 11), (4, 7, 21), (4, 1007, 1021)],
)
def test_status_is_read_shortly_before_the_next_poll_is_expected(
    polled_ms: int | None, now_ms: int, tick_ms: int
) -> None:
    polled_ns = None if polled_ms is None else polled_ms * MS
    assert next_tick_ns(0, polled_ns, 10 * MS, now_ms * MS) == tick_ms * MS


def test_verbs_are_passed_to_the_core_unchanged(made: Made) -> None:
    cell, gripper = made()
    results: list[object] = [
        gripper.activate(dropping=True), gripper.activate(), gripper.open(0.1),
        gripper.move_to((1, 2, 3), 0.05, 7.0),
        gripper.close_to_limit(9.0, (True, False, True), (4, 5, 6), 0.03), gripper.hold(),
    ]  # fmt: skip
    verbs = ("activate", "activate", "open", "move_to", "close_to_limit", "hold")
    assert results == [f"applied {verb}" for verb in verbs]
    assert cell.verbs == [
        ("activate", True), ("activate", False), ("open", 0.1), ("move_to", (1, 2, 3), 0.05, 7.0),
        ("close_to_limit", 9.0, (True, False, True), (4, 5, 6), 0.03), ("hold",),
    ]  # fmt: skip
    assert (gripper.least_force_n, gripper.m_per_count) == (10.0, 0.00077)
