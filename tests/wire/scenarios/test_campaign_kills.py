"""A campaign that is struck at a moment drawn by a seed: parent, worker, all workers or the whole
group, by every signal that ends a process; beside it a second writer, a disk that is full, a folder
that takes nothing, from the beginning or from some moment on. Whatever happened, `--resume` makes
the rows of a campaign that nothing happened to, and no process is left.

CAMPAIGN_KILLS=100 runs that many; one of each signal is in the slow tests.
"""

import contextlib
import os
import random
import re
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader

from tests.wire.scenarios.campaigns import (
    GRASP,
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
NAMESPACE = ("unshare", "--user", "--map-root-user", "--mount")
# a root without the capability to pass over them; whoever is not root is bound by modes anyway
BOUND_BY_MODES = (
    sys.executable, "-c",
    "import ctypes, os, sys; PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1;"
    "ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0);"
    "os.execv(sys.argv[1], sys.argv[1:])",
)  # fmt: skip


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


@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
def test_each_of_the_signals_ends_a_process_that_does_nothing_about_it(
    number: signal.Signals,
) -> None:
    with subprocess.Popen(["sleep", "60"]) as process:
        process.send_signal(number)
        assert process.wait(PATIENCE_S) == -number


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", range(max(1, KILLS // 20)))
def test_of_two_writers_one_is_refused_and_the_other_is_whole(
    number: int, whole: Whole, tmp_path: Path
) -> None:
    first = started(*words(tmp_path))
    time.sleep(random.Random(SEED + number).uniform(0.0, 0.5) * whole.seconds)
    second = started(*words(tmp_path))
    ended = [process.communicate(timeout=PATIENCE_S)[1] for process in (first, second)]
    codes = sorted((first.returncode, second.returncode))
    assert codes == [0, 2], ended
    assert not any("Traceback" in err for err in ended)
    assert rows(tmp_path / "a.sqlite") == whole.rows
    resumed(tmp_path, whole, "two writers")


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", range(max(1, KILLS // 10)))
def test_a_file_system_that_is_full_loses_no_row_that_was_told(
    number: int, recorded: Whole, tmp_path: Path
) -> None:
    """One of its own, in a namespace that a user may make: it is full, then it has room."""
    small, mounts = tmp_path / "small", (*NAMESPACE, "mount", "-t", "tmpfs")
    small.mkdir()
    if subprocess.run([*mounts, "none", str(small)], check=False, capture_output=True).returncode:
        pytest.skip("this system lets nobody mount a file system")
    room = random.Random(SEED + number).randrange(2 * PAGE, recorded.size_of_all, PAGE)
    command = " ".join(map(shlex.quote, [*GRASP, "campaign", "run", *words(small, 2, "all")]))
    script = f"""
        mount -t tmpfs -o size={room} none {small} && cp {tmp_path}/small.toml {small} || exit 99
        {command}; echo code $?; df {small}; ls -A {small} {small}/a.recordings
        mount -o remount,size=64m {small}
        {command} $(test -e {small}/a.sqlite && echo --resume); echo code $?
        cp -r {small}/. {tmp_path}/after
    """
    shutil.copy(small / "small.toml", tmp_path)
    told = subprocess.run(
        [*NAMESPACE, "sh", "-c", script], capture_output=True, text=True, timeout=2 * PATIENCE_S,
        check=True,
    )  # fmt: skip
    first, second = re.findall(r"^code (\d+)$", told.stdout, re.M)
    assert int(first) in CODES - {0} and "Traceback" not in told.stderr, (
        room,
        told.stdout,
        told.stderr,
    )
    assert second == "0", (room, told.stdout, told.stderr)
    assert rows(tmp_path / "after" / "a.sqlite") == recorded.rows
    resumed(tmp_path / "after", recorded, f"a file system of {room} bytes")


def ended_read_only(folder: Path, made: int) -> tuple[int, str]:
    """Exit code and words of a campaign whose folder takes nothing once that many rows are made. By
    one worker: of two the last rows come together."""
    out = folder / "a.sqlite"
    process = started(*words(folder, jobs=1), before=BOUND_BY_MODES)
    until(lambda: process.poll() is not None or (out.exists() and len(rows(out)) >= made))
    folder.chmod(0o555)
    _, err = process.communicate(timeout=PATIENCE_S)
    folder.chmod(0o755)
    until(lambda: not workers_of(process.pid))
    return process.returncode, err


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("made", range(3))
def test_a_folder_that_takes_nothing_any_more_loses_no_row_that_was_told(
    made: int, whole: Whole, tmp_path: Path
) -> None:
    out = tmp_path / "a.sqlite"
    code, err = ended_read_only(tmp_path, made)
    assert "Traceback" not in err
    assert code in CODES and (code == 0 or str(out) in err), (code, err)
    resumed(tmp_path, whole, f"a folder that took {made} rows")


@pytest.mark.slow
def test_a_folder_that_takes_nothing_is_told_before_anything_runs(tmp_path: Path) -> None:
    code, out, err = finished(str(campaign(tmp_path)), "--out", "/sys/a.sqlite", "--jobs", "2")
    assert code in CODES - {0} and out == ""
    assert "/sys/a.sqlite" in err and "Traceback" not in err
