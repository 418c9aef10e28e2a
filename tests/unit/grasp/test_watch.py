"""Onlookers: what they are handed, what they lose, and that nobody waits for them."""

import math
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from grasp import watch
from grasp.cli import view
from grasp.cli.live import Display
from grasp.watch import Onlooker

GLIMPSE = view.Glimpse(
    1.25, "lift", "nominal", False, True, (1.0, 0.5, 0.5), [0.1, 0.0, 0.0], (60, 61, 62), 0.3
)


def test_every_message_survives_its_way_to_the_other_process() -> None:
    for message in (view.Begin(True), view.Busy("x"), view.Note("y"), GLIMPSE):
        line = msgspec.json.encode(message)
        assert len(line) < 4096  # written whole or not at all
        assert msgspec.json.decode(line, type=view.Message) == message


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


@pytest.mark.parametrize("panel", [False, True])
def test_arm_that_says_no_number_is_drawn_all_the_same(panel: bool, tmp_path: Path) -> None:
    drawn = tmp_path / "screen"
    with drawn.open("wb") as screen, Onlooker(view, screen.fileno()) as onlooker:
        onlooker.tell(view.Begin(panel))
        onlooker.tell(msgspec.structs.replace(GLIMPSE, arm_m=math.nan))
        onlooker.tell(view.Note("one run is over"))
    assert "one run is over" in drawn.read_text()


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


def test_onlooker_that_died_is_no_error(onlooker: Onlooker) -> None:
    os.kill(onlooker.pid, signal.SIGKILL)
    show_until_lost(onlooker)
    lost = onlooker.lost
    onlooker.tell(view.Note("nobody listens"))
    assert onlooker.lost == lost + 1


def test_a_line_between_two_runs_waits_a_second_at_most_for_its_reader(
    onlooker: Onlooker, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits_s = []
    monkeypatch.setattr(watch.select, "select", lambda *asked: waits_s.append(asked[-1]))
    onlooker.tell(view.Note("one run is over"))
    assert waits_s == [1.0]


def test_pictures_that_were_lost_are_told_when_the_run_is_over(
    onlooker: Onlooker, capsys: pytest.CaptureFixture[str]
) -> None:
    os.kill(onlooker.pid, signal.SIGKILL)
    with Display("emulated", quiet=False, onlooker=onlooker) as display:
        show_until_lost(onlooker)
        display.note("nobody listens")
        lost = onlooker.lost
        display.close()
    assert capsys.readouterr().err == f"{lost} pictures of the run were not drawn in time\n"


def test_where_every_picture_was_drawn_nothing_is_said(
    onlooker: Onlooker, capsys: pytest.CaptureFixture[str]
) -> None:
    with Display("emulated", quiet=False, onlooker=onlooker) as display:
        display.note("one run is over")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("panel", [False, True])
def test_a_view_takes_every_kind_of_message(
    panel: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = view.make(panel)
    for message in (view.Busy("setting up"), GLIMPSE, view.Note("done")):
        shown.take(message)
    shown.close()
    assert "lift" in capsys.readouterr().out
