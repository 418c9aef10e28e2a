"""Verbs of the gripper thread while the hand does not reply, on a stopped clock."""

import threading
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest

from drivers.errors import Refused
from drivers.interfaces import Applied
from tests.unit.drivers.robotiq.link_cell import (
    BEGIN_NS,
    MS,
    Cell,
    Made,
    no_write,
    until,
)

DEFERRED_NOTE = "the hand has not replied yet: the command is sent as soon as it has"


class State(msgspec.Struct, frozen=True):
    """The fields of a gripper state that the thread reads."""

    fresh: bool = True
    positions: tuple[int, int, int] = (7, 8, 9)


class Silence:
    """A gripper thread whose second exchange lasts until ``ends`` is called."""

    def __init__(self, made: Made, ends: Callable[[Cell], None] = no_write) -> None:
        self._over = threading.Event()
        self._ends = ends
        self.cell, self.gripper = made(no_write, self._lasts, no_write)
        self.cell.state = State()
        self.gripper.hold()  # starts the exchange
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


def test_verbs_to_a_silent_hand_return_the_request_and_run_after_the_exchange(
    silent: Callable[..., Silence],
) -> None:
    hand = silent()
    cell, gripper = hand.cell, hand.gripper
    asked: tuple[tuple[Callable[[], Applied], Applied], ...] = (
        (lambda: gripper.open(0.1), Applied((0, 0, 0), 0.1, 10.0, note=DEFERRED_NOTE)),
        (lambda: gripper.move_to((1, 2, 3), 0.05, 7.0),
         Applied((1, 2, 3), 0.05, 7.0, note=DEFERRED_NOTE)),
        (gripper.hold, Applied((7, 8, 9), 0.0, 10.0, note=DEFERRED_NOTE)),
        (lambda: gripper.close_to_limit(9.0, (True, False, True), (255, 255, 6), 0.03),
         Applied((255, 8, 9), 0.03, 9.0, note=DEFERRED_NOTE)),
    )  # fmt: skip
    for verb, applied in asked:
        cell.passes(MS)
        assert verb() == applied
        assert not gripper.acknowledged
        state: Any = gripper.state
        assert state == State(fresh=False), "it does not reflect the deferred verb"
    assert cell.verbs == []
    cell.state = State(fresh=False)
    cell.writes_from_ns = cell.now_ns
    hand.ends()
    until(lambda: gripper.acknowledged)
    latest = ("close_to_limit", 9.0, (True, False, True), (255, 255, 6), 0.03)
    assert cell.verbs == [latest]
    assert gripper.acknowledgements_ns[0][0] == BEGIN_NS + 4 * MS, "from the time of its call"


def test_refusal_of_a_deferred_verb_is_raised_by_the_next_poll(
    silent: Callable[..., Silence],
) -> None:
    hand = silent()
    hand.cell.refuses = True
    hand.gripper.hold()
    hand.gripper.poll(0)
    hand.ends()
    until(lambda: hand.gripper.acknowledged)
    with pytest.raises(Refused, match="not so"):
        hand.gripper.poll(0)
    hand.gripper.poll(0)
    assert len(hand.cell.verbs) == 1


def test_only_activation_waits_for_a_silent_hand(silent: Callable[..., Silence]) -> None:
    hand = silent()
    waiting = threading.Thread(target=hand.gripper.activate)
    waiting.start()
    waiting.join(0.05)
    assert (waiting.is_alive(), hand.cell.verbs) == (True, [])
    hand.ends()
    waiting.join()
    assert hand.cell.verbs == [("activate", False)]
