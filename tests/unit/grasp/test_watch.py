"""Onlookers: what they are handed, what they lose, and that nobody waits for them."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from grasp.cli import view
from grasp.watch import Onlooker

GLIMPSE = view.Glimpse(
    1.25, "lift", "nominal", False, True, (1.0, 0.5, 0.5), [0.1, 0.0, 0.0], (60, 61, 62), 0.3
)


def test_lines_are_drawn_by_another_process_until_the_run_ends(tmp_path: Path) -> None:
    drawn = tmp_path / "screen"
    with drawn.open("wb") as screen, Onlooker(view, screen.fileno()) as onlooker:
        onlooker.tell(view.Begin(panel=False))
        onlooker.show(GLIMPSE)
        onlooker.tell(view.Note("one run is over"))
    first, second = drawn.read_text().splitlines()
    assert "lift" in first and "A   1.0 N" in first
    assert second == "one run is over"
    assert onlooker.lost == 0


@pytest.fixture
def onlooker() -> Iterator[Onlooker]:
    with open(os.devnull, "wb") as screen, Onlooker(view, screen.fileno()) as made:
        yield made


def show_until_lost(onlooker: Onlooker) -> None:
    """A pipe holds a few hundred messages; whoever waited for a reader would hang here."""
    deadline = time.monotonic() + 20.0
    while onlooker.lost == 0 and time.monotonic() < deadline:
        onlooker.show(GLIMPSE)


def test_onlooker_that_stands_still_costs_pictures_and_nothing_else(onlooker: Onlooker) -> None:
    os.kill(onlooker.pid, signal.SIGSTOP)
    show_until_lost(onlooker)
    assert onlooker.lost > 0
    os.kill(onlooker.pid, signal.SIGKILL)
