"""A campaign that is struck at a moment drawn by a seed: parent, worker, all workers or the whole
group, by every signal that ends a process; or whose disk is full. Whatever happened, `--resume`
makes the rows of a campaign that nothing happened to, and no process is left.

CAMPAIGN_KILLS=100 runs that many; without it, one of each signal.
"""

import contextlib
import os
import random
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader

from tests.wire.scenarios.campaigns import (
    PATIENCE_S,
    finished,
    rows,
    started,
    until,
    workers_of,
)

SEED = 1700
# what they do by default is nothing, or to stop; SIGRTMIN and SIGRTMAX stand for those between
HARMLESS = {signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH}
STOPS = {signal.SIGSTOP, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU}
SIGNALS = tuple(sorted(set(signal.Signals) - HARMLESS - STOPS))
KILLS = int(os.environ.get("CAMPAIGN_KILLS", str(len(SIGNALS))))
HEARD = {signal.SIGTERM, signal.SIGINT, signal.SIGHUP}  # the command has a say
UNHEARD = {signal.SIGPIPE, signal.SIGXFSZ}  # Python ignores these, and a write fails instead
VICTIMS = ("parent", "worker", "workers", "group")
CODES = {0, 1, 2, 3, 4, 5}  # of an end of its own
ENDED = CODES | {code for n in SIGNALS for code in (-n, 128 + n)}
PAGE = 4_096  # of an SQLite file


class Strike(msgspec.Struct, frozen=True):
    """``share``: of the time that the whole campaign takes, when the signal comes; half of it, and
    so on, where a campaign has ended by then."""

    number: int
    victim: str
    signal: int
    share: float

    def __str__(self) -> str:
        name = signal.Signals(self.signal).name
        return f"{self.number}: {name} to the {self.victim} at {self.share:.2f}"


def strike(number: int) -> Strike:
    draw = random.Random(SEED + number)
    victim, share = draw.choice(VICTIMS), draw.uniform(0.0, 1.0)
    return Strike(number, victim, SIGNALS[number % len(SIGNALS)], share)


def campaign(folder: Path, recordings: str = "none") -> Path:
    path = folder / "small.toml"
    path.write_text(
        'name = "small"\nobjects = ["can", "ball"]\nrepetitions = 2\n'
        f'recordings = "{recordings}"\n'
        'settings = ["controller.hold_s=0.2", "controller.lift_height_m=0.05"]\n'
    )
    return path


def words(folder: Path, jobs: int = 2, recordings: str = "none") -> tuple[str, ...]:
    return str(campaign(folder, recordings)), "--out", str(folder / "a.sqlite"), "--jobs", str(jobs)


class Whole(msgspec.Struct, frozen=True):
    """A campaign that nothing happened to, how long it took, s, and how many bytes
    its file and all files have."""

    rows: list[dict[str, object]]
    seconds: float
    size: int
    size_of_all: int
    recordings: str = "none"


@pytest.fixture(autouse=True)
def _heard() -> Iterator[None]:
    """A shell's background job ignores these, and so would all that it begins."""
    defaults = {signal.SIGINT: signal.default_int_handler, signal.SIGQUIT: signal.SIG_DFL}
    before = {number: signal.signal(number, default) for number, default in defaults.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def of_nothing(folder: Path, recordings: str) -> Whole:
    start_s = time.monotonic()
    code, _, err = finished(*words(folder, recordings=recordings))
    assert code == 0, err
    took_s, out = time.monotonic() - start_s, folder / "a.sqlite"
    left = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return Whole(rows(out), took_s, out.stat().st_size, left, recordings)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    return of_nothing(tmp_path_factory.mktemp("whole"), "none")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    return of_nothing(tmp_path_factory.mktemp("recorded"), "all")


def hit(process: subprocess.Popen[str], struck: Strike) -> bool:
    """Whether any that the signal is meant for was there to take it."""
    there = workers_of(process.pid)
    pids = {"parent": [process.pid], "worker": there[-1:], "workers": there,
            "group": [process.pid, *there]}[struck.victim]  # fmt: skip
    taken = 0
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, struck.signal)
            taken += 1
    return taken > 0


def begun_and_hit(folder: Path, whole: Whole, struck: Strike) -> subprocess.Popen[str]:
    """A campaign that took the signal. One that had ended by then, for the machine is quicker now,
    begins anew and is struck sooner; a worker cannot be struck before it is there."""
    wait_s = struck.share * whole.seconds
    while True:
        process = started(*words(folder, recordings=whole.recordings))
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(wait_s)
        while process.poll() is None:
            if hit(process, struck):
                return process
            time.sleep(0.01)
        _, err = process.communicate()
        assert process.returncode == 0, (str(struck), err)
        (folder / "a.sqlite").unlink()
        shutil.rmtree(folder / "a.recordings", ignore_errors=True)
        wait_s /= 2


def resumed(folder: Path, whole: Whole, note: str) -> None:
    """All that is lacking is made; nothing that was made is made again or lost."""
    out = folder / "a.sqlite"
    before = [row for row in rows(out) if row["status"] == "done"]
    known = {row["trial"]: row for row in whole.rows}
    assert before == [known[row["trial"]] for row in before], note
    more = ("--resume",) if out.exists() else ()
    code, _, err = finished(*words(folder, recordings=whole.recordings), *more)
    assert code == 0, (note, err)
    assert rows(out) == whole.rows, note
    kept = sorted(str(path.relative_to(folder)) for path in folder.glob("a.recordings/*"))
    assert kept == sorted(row["recording"] for row in rows(out) if row["recording"]), (note, kept)
    assert all(is_whole(folder / name) for name in kept), note
    left = {path.name for path in folder.iterdir()}
    assert left <= {"small.toml", "a.sqlite", "a.sqlite.lock", "a.recordings"}, (note, left)


def is_whole(recording: Path) -> bool:
    with recording.open("rb") as file:
        summary = make_reader(file).get_summary()  # at the end of a file
    return summary is not None and bool(summary.statistics and summary.statistics.message_count)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", range(KILLS))
def test_a_campaign_that_is_killed_goes_on_as_if_nothing_had_been(
    number: int, whole: Whole, recorded: Whole, tmp_path: Path
) -> None:
    struck = strike(number)
    whole = recorded if number % 2 else whole
    process = begun_and_hit(tmp_path, whole, struck)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode in ENDED, (str(struck), process.returncode, err)
    if struck.victim in ("parent", "group") and struck.signal not in HEARD | UNHEARD:
        assert process.returncode == -struck.signal, (str(struck), process.returncode)
    # joblib's tracker of what workers share misses what a worker that was killed had told it
    bugs = [text for text in err.split("Traceback (most")[1:] if "resource_tracker" not in text]
    assert not bugs, (str(struck), err)
    until(lambda: not workers_of(process.pid))
    resumed(tmp_path, whole, str(struck))
    print(struck, "ended with", process.returncode)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", range(max(1, KILLS // 10)))
def test_a_full_disk_loses_no_row_that_was_told_and_the_rest_is_made_later(
    number: int, whole: Whole, tmp_path: Path
) -> None:
    assert whole.size > 3 * PAGE
    # rows that came in another order may take a page less
    room = random.Random(SEED + number).randrange(0, whole.size - 2 * PAGE, 512)

    process = started(*words(tmp_path))
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (room, room))  # its workers' too
    _, err = process.communicate(timeout=PATIENCE_S)
    assert "Traceback" not in err, (room, err)
    assert process.returncode in CODES - {0}, (room, process.returncode, err)
    out = tmp_path / "a.sqlite"
    assert not out.exists() or out.stat().st_size <= room
    until(lambda: not workers_of(process.pid))
    resumed(tmp_path, whole, f"{room} bytes of room")
