"""Campaigns whose parent, worker or process group gets a fatal signal at a random time, or whose
disk is full. `--resume` then completes the rows of an undisturbed campaign, and no process is left.

CAMPAIGN_KILLS=100 runs that many; without it, one of each signal and victim.
"""

import contextlib
import os
import random
import resource
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.wire.scenarios.campaigns import finished, rows, started, workers_of
from tests.wire.waiting import PATIENCE_S, until

SEED = 1700
SIGNALS = (signal.SIGTERM, signal.SIGKILL, signal.SIGHUP, signal.SIGSEGV)
VICTIMS = ("parent", "worker", "group")
KILLS = int(os.environ.get("CAMPAIGN_KILLS", str(len(SIGNALS) * len(VICTIMS))))
CODES = {0, 1, 2, 3, 4, 5}  # exit codes of the program
ENDED = CODES | {code for n in SIGNALS for code in (-n, 128 + n)}
PAGE = 4_096  # of an SQLite file


def arguments(folder: Path, recordings: str = "all") -> tuple[str, ...]:
    path = folder / "small.toml"
    path.write_text(
        'name = "small"\nobjects = ["can", "ball"]\nrepetitions = 2\n'
        f'recordings = "{recordings}"\n'
        'settings = ["controller.hold_s=0.2", "controller.lift_height_m=0.05"]\n'
    )
    return str(path), "--out", str(folder / "a.sqlite"), "--jobs", "2"


class Whole(NamedTuple):
    """An undisturbed campaign: its rows, duration, and size of its file."""

    rows: list[dict[str, object]]
    seconds: float
    size: int
    recordings: str


def undisturbed(folder: Path, recordings: str) -> Whole:
    folder.mkdir()
    start_s, out = time.monotonic(), folder / "a.sqlite"
    code, _, err = finished(*arguments(folder, recordings))
    assert code == 0, err
    return Whole(rows(out), time.monotonic() - start_s, out.stat().st_size, recordings)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    return undisturbed(tmp_path_factory.mktemp("whole") / "all", "all")


def hit(process: subprocess.Popen[str], victim: str, number: int) -> bool:
    """Send the signal; whether any process got it."""
    workers = workers_of(process.pid)
    group = [process.pid, *workers]
    pids = {"parent": [process.pid], "worker": workers[-1:], "group": group}[victim]
    sent = 0
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)
            sent += 1
    return sent > 0


def start_and_hit(folder: Path, wait_s: float, victim: str, number: int) -> subprocess.Popen[str]:
    """Start a campaign and send it the signal. A campaign that ended before is started again and
    gets the signal sooner; a worker gets it only once it runs."""
    while True:
        process = started(*arguments(folder))
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(wait_s)
        while process.poll() is None:
            if hit(process, victim, number):
                return process
            time.sleep(0.01)
        _, err = process.communicate()
        assert process.returncode == 0, err
        (folder / "a.sqlite").unlink()
        shutil.rmtree(folder / "a.recordings", ignore_errors=True)
        wait_s /= 2


def resumed(folder: Path, whole: Whole, note: str) -> None:
    """Resume, and check that only missing trials ran and nothing was lost."""
    out = folder / "a.sqlite"
    before = [row for row in rows(out) if row["status"] == "done"]
    known = {row["trial"]: row for row in whole.rows}
    assert before == [known[row["trial"]] for row in before], note
    more = ("--resume",) if out.exists() else ()
    code, _, err = finished(*arguments(folder, whole.recordings), *more)
    assert code == 0, (note, err)
    assert rows(out) == whole.rows, note
    kept = sorted(str(path.relative_to(folder)) for path in folder.glob("a.recordings/*"))
    listed = sorted(str(row["recording"]) for row in rows(out) if row["recording"])
    assert kept == listed, note
    left = {path.name for path in folder.iterdir()}
    assert left <= {"small.toml", "a.sqlite", "a.sqlite.lock", "a.recordings"}, (note, left)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("turn", range(KILLS))
def test_killed_campaign_is_completed_by_resume(turn: int, recorded: Whole, tmp_path: Path) -> None:
    number, victim = SIGNALS[turn % len(SIGNALS)], VICTIMS[turn % len(VICTIMS)]
    wait_s = random.Random(SEED + turn).uniform(0.0, recorded.seconds)
    note = f"{number.name} to the {victim} after {wait_s:.2f} s"
    process = start_and_hit(tmp_path, wait_s, victim, number)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode in ENDED, (note, process.returncode, err)
    # joblib's resource tracker reports the resources of killed workers
    bugs = [text for text in err.split("Traceback (most")[1:] if "resource_tracker" not in text]
    assert not bugs, (note, err)
    until(lambda: not workers_of(process.pid))
    resumed(tmp_path, recorded, note)


@pytest.mark.timeout(600)
def test_full_disk_loses_no_reported_row_and_the_rest_is_resumed(
    tmp_path: Path,
) -> None:
    whole = undisturbed(tmp_path / "whole", "none")
    folder = tmp_path / "full"
    folder.mkdir()
    limit = whole.size - 2 * PAGE  # rows in another order may need a page less
    process = started(*arguments(folder, "none"))
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (limit, limit))  # also of its workers
    _, err = process.communicate(timeout=PATIENCE_S)
    assert "Traceback" not in err, (limit, err)
    assert process.returncode in CODES - {0}, (limit, process.returncode, err)
    until(lambda: not workers_of(process.pid))
    resumed(folder, whole, f"file size limit {limit} bytes")
