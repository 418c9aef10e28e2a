"""Viewer processes: messages that they get and lose; the run never waits for them."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from grasp.cli import view
from grasp.run.viewer_process import ViewerProcess

GLIMPSE = view.TickView(
    1.25, "lift", "nominal", False, True, (1.0, 0.5, 0.5), [0.1, 0.0, 0.0], (60, 61, 62), 0.3
)


def test_lines_are_printed_by_another_process_until_the_run_ends(tmp_path: Path) -> None:
    output = tmp_path / "screen"
    with output.open("wb") as screen, ViewerProcess(view, screen.fileno()) as viewer:
        viewer.show_waiting(view.Begin(panel=False))
        viewer.show(GLIMPSE)
        viewer.show_waiting(view.LogLine("one run is over"))
    first, second = output.read_text().splitlines()
    assert "lift" in first and "A  1.0" in first
    assert second == "one run is over"
    assert viewer.lost == 0


@pytest.fixture
def viewer() -> Iterator[ViewerProcess]:
    with open(os.devnull, "wb") as screen, ViewerProcess(view, screen.fileno()) as made:
        yield made


def show_until_lost(viewer: ViewerProcess) -> None:
    """A pipe holds a few hundred messages; a sender that waited for a reader would hang here."""
    deadline = time.monotonic() + 20.0
    while viewer.lost == 0 and time.monotonic() < deadline:
        viewer.show(GLIMPSE)


def test_blocked_viewer_loses_only_messages(viewer: ViewerProcess) -> None:
    os.kill(viewer.pid, signal.SIGSTOP)
    show_until_lost(viewer)
    assert viewer.lost > 0
    os.kill(viewer.pid, signal.SIGKILL)
