"""Verbs of the gripper's thread while the hand is silent, on a clock that stands."""

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
    idle,
    until,
)

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
        (lambda: gripper.close_fast(9.0, (True, False, True), (255, 255, 6), 0.03),
         Applied((255, 8, 9), 0.03, 9.0, note=NOT_YET)),
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
    latest = ("close_fast", 9.0, (True, False, True), (255, 255, 6), 0.03)
    assert cell.verbs == [latest]
    assert gripper.acknowledgements_ns[0][0] == BEGIN_NS + 4 * MS, "from when it was given"


def test_refusal_of_a_verb_that_was_put_off_is_raised_by_the_next_poll(
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


def test_activation_alone_waits_for_a_silent_hand(silent: Callable[..., Silence]) -> None:
    hand = silent()
    waiting = threading.Thread(target=hand.gripper.activate)
    waiting.start()
    waiting.join(0.05)
    assert (waiting.is_alive(), hand.cell.verbs) == (True, [])
    hand.ends()
    waiting.join()
    assert hand.cell.verbs == [("activate", False)]
