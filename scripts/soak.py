"""An hour of lifts at 100 Hz on the emulated cell, with a fault now and then, watched by a page.

    python scripts/soak.py run [--minutes 60] [--out runs/soak.json]    run it, then tell
    python scripts/soak.py run --fault gripper_freeze [--fault ...]     each lift by one of these
    python scripts/soak.py tell [--out runs/soak.json]                  what came of it

One process makes all lifts, recorded each; every fourth, by a seed, is struck in a phase by a
fault of the cell. Another process follows the live page, and a third does nothing but keep the same
period beside them: what that misses, the machine has missed. Once a lift, memory, descriptors,
threads and processes are counted, at the same place of it.

After each lift the cell is asked what became of the object and what still moves, 1.5 s after one
that failed. `run` and `tell` exit with 1 if anything was as `soak_verdict.py` says it may not be.
The file has each lift as soon as it is over; Ctrl-C ends the run, and `tell` tells what there is.
"""

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any
from unittest import mock
from urllib.parse import urlsplit

import msgspec

from drivers.errors import BadFile, CouldNotRecord, GraspError
from drivers.ur.link import worker
from grasp import interruption
from grasp.cli.options import decimal
from grasp.clock import Deadlines, WallClock
from grasp.files import make_private_file, make_private_folder, partial_of, write_whole
from grasp.phases import Phase
from grasp.realtime import RealTimeSettings, real_time
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.lift.result import LiftResult
from scenarios.report.live import server
from scenarios.report.live.feed import LiveTrials
from scenarios.rigs import emulated_cell
from scenarios.rigs.emulated_cell import OPEN_M
from scenarios.rigs.opening import open_rig
from scenarios.studies.faults.verdict import LET_GO_M
from scenarios.trial import series
from scenarios.trial.result import FinishedRun
from scenarios.trial.series import Bench
from scenarios.world.truth import Truth
from scripts.soak_verdict import (
    NOT_OPENED,
    After,
    Count,
    Lift,
    Soak,
    by_itself,
    missed_of,
    tell,
)

OUT = Path("runs") / "soak.json"
ELSEWHERE = "free the disk, or name another file with --out"
MOST_MINUTES = 7 * 24 * 60
VERBS = {
    "run": "lifts for so many minutes, then what came of them",
    "tell": "what came of the lifts in a file",
}
SEED = 20261122
BETWEEN = 4  # lifts, on average, between two faults
COUNTED_TICKS = 300  # into a lift
LATER_S, LOOK_S = 1.5, 0.05  # after a lift that failed; between two looks at what moves
LOOKS, LOOKS_LATER = 4, 10  # after a lift that went well, and after one that failed
OBJECTS = ("can", "ball", "foam")
PHASES = (Phase.APPROACH, Phase.GRASP, Phase.LIFT, Phase.HOLD, Phase.LOWER, Phase.RELEASE)
FAULTS: tuple[dict[str, Any], ...] = (
    {"name": "gripper_drop", "times": 2},
    {"name": "gripper_delay", "times": 3, "seconds": 0.1},
    {"name": "gripper_garble", "times": 3},
    {"name": "gripper_freeze", "seconds": 1.0},
    {"name": "gripper_disconnect"},
    {"name": "gripper_fault", "code": 14},
    {"name": "usb_timeout", "times": 5},
    {"name": "unplug"},
    {"name": "protective_stop"},
    {"name": "arm_disconnect"},
    {"name": "arm_freeze", "seconds": 0.5},
)
# in place of a browser; it asks for 4 KiB at a time, as the page's server does, where websockets
# asks for 64, which fragments its heap by some MB an hour
VIEWER = (
    "import json, sys\nfrom websockets.sync.client import ClientConnection, connect\n"
    "ClientConnection.recv_bufsize, rows = 4096, 0\n"
    "with connect(sys.argv[1], origin=sys.argv[2], open_timeout=60.0) as page:\n"
    "    for message in page: rows += len(json.loads(message))\n"
    "print(rows)\n"
)  # until the page ends; who ends before has seen nothing
ROLES = {
    "cell": emulated_cell.__name__,
    "arm": worker.__name__,
    "page": server.__name__,
    "viewer": "websockets.sync.client",
    "idle": "soak.py\0idle",
}  # other processes, by what each was begun with


class Fate:
    """What becomes of the object, by what the cell knows of it from look to look."""

    def __init__(self) -> None:
        self.let_go_m = self.slid_m = 0.0
        self._held_at_m = 0.0  # height at which the hand had the object last
        self._slip_m = 0.0

    def see(self, truth: Truth) -> None:
        if not truth.touched and self._held_at_m > LET_GO_M:
            self.let_go_m = max(self.let_go_m, self._held_at_m)
        if truth.touched and min(truth.height_m, self._held_at_m) > LET_GO_M:
            self.slid_m += abs(truth.slip_distance_m - self._slip_m)
        self._held_at_m = truth.height_m if truth.touched else 0.0
        self._slip_m = truth.slip_distance_m


def count(start_s: float) -> Count:
    """Now."""
    children = [int(pid) for pid in _children(os.getpid())]
    each_mb = dict[str, float]()
    for pid in children:
        role = _role(pid)
        each_mb[role] = each_mb.get(role, 0.0) + _resident_mb(pid)
    return Count(
        time.monotonic() - start_s, _resident_mb(os.getpid()), len(os.listdir("/proc/self/fd")),
        len(os.listdir("/proc/self/task")), len(children), sum(each_mb.values()), each_mb,
    )  # fmt: skip


def _role(pid: int) -> str:
    """What that process is."""
    begun = " ".join(_words(Path(f"/proc/{pid}/cmdline")))
    return next((role for role, mark in ROLES.items() if mark in begun), "other")


def _children(pid: int) -> list[str]:
    tasks = Path(f"/proc/{pid}/task")
    return [child for task in tasks.iterdir() for child in _words(task / "children")]


def _words(path: Path) -> list[str]:
    try:
        return path.read_text().split()
    except OSError:  # it has ended
        return []


def _resident_mb(pid: int) -> float:
    words = _words(Path(f"/proc/{pid}/statm"))
    return int(words[1]) * os.sysconf("SC_PAGESIZE") / 1e6 if words else 0.0


class Watcher:
    """Strikes and counts while a lift goes on."""

    def __init__(self, start_s: float, live: LiveTrials) -> None:
        self.counts: list[Count] = []
        self.periods = 0
        self.cell: Any = None  # of the rig that is open
        self.due: tuple[Phase, dict[str, Any]] | None = None
        self.struck = ""
        self.fate = Fate()
        self._start_s, self._live = start_s, live

    def begin(self, due: tuple[Phase, dict[str, Any]] | None) -> None:
        """Another lift, which is to be struck so."""
        self.periods, self.struck, self.due, self.fate = 0, "", due, Fate()

    def watch(self, tick: Any, truth: Any, controller: Any) -> None:
        self._live.watch(tick, truth, controller)
        self.periods += 1
        if truth is not None:
            self.fate.see(truth)
        if self.periods == COUNTED_TICKS:
            self.counts.append(count(self._start_s))
        if self.due is not None and tick.decision.phase is self.due[0]:
            phase, request = self.due
            self.due, self.struck = None, f"{request['name']} in {phase.value}"
            self.cell.control.ask("fault", **request)

    def after(self, failed: bool) -> After | None:
        """What the cell knows once the lift is over and its rig still open; None: it is gone."""
        if failed:
            time.sleep(LATER_S)
        moved = list[dict[str, Any]]()
        try:
            for _ in range(LOOKS_LATER if failed else LOOKS):
                time.sleep(LOOK_S)
                known = self.cell.control.ask("truth")
                truth = msgspec.convert(known["truth"], Truth)
                self.fate.see(truth)
                moved.append(self.cell.control.ask("motion"))
        except (GraspError, OSError):
            return None
        return After(
            max(look["arm_mps"] for look in moved), max(look["fingers_mps"] for look in moved),
            max(truth.normal_n), max(known["travel_m"]) < OPEN_M, truth.height_m,
            abs(truth.slip_speed_mps),
        )  # fmt: skip

    @contextmanager
    def open(self, *asked: Any) -> Iterator[Any]:
        with open_rig(*asked) as rig:
            self.cell = getattr(rig.world, "__self__", None)
            yield rig


@contextmanager
def beside(command: Sequence[str]) -> Iterator[subprocess.Popen[str]]:
    """Another process of ours, which ends with this; Ctrl-C is for this one alone."""
    child = subprocess.Popen(
        [sys.executable, "-P", *command], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    try:
        yield child
    finally:
        if child.poll() is None:
            child.kill()
        child.communicate()


def config_of(name: str) -> LiftConfig:
    """As a plain `grasp run lift --rig emulated --object NAME` has it, but for the time that the
    hand takes to activate."""
    return load_config(name, "emulated", None, None, ("hand.activation_s=0.5",)).for_lift()


Keep = Callable[[Soak], None]


class Draw:
    """Seeds of lifts, and by which fault, in which phase, the next is struck, if it is."""

    def __init__(self, only: Sequence[str]) -> None:
        """``only``: names of faults, one of which strikes every lift; none: any, now and then."""
        self._random = random.Random(SEED)
        self._faults = [fault for fault in FAULTS if not only or fault["name"] in only]
        self._between = 1 if only else BETWEEN

    def seeds(self) -> list[int]:
        return [self._random.randrange(1 << 16) for _ in range(2 * BETWEEN)]

    def due(self) -> tuple[Phase, dict[str, Any]] | None:
        fault, phase = self._random.choice(self._faults), self._random.choice(PHASES)
        return (phase, fault) if self._random.random() * self._between < 1.0 else None


def soak(minutes: float, only: Sequence[str], keep: Keep) -> Soak:
    """Lifts until the time is over, or a signal comes; a fault ends a series, and another rig is
    opened. ``only``: as of ``Draw``. ``keep``: what there is, after each lift."""
    start_s, draw = time.monotonic(), Draw(only)
    live = LiveTrials(config_of(OBJECTS[0]), "soak", 0)
    watcher = Watcher(start_s, live)
    made = Soak(minutes, False, [], watcher.counts, (0, 0), [], [], 0, None)
    at = urlsplit(live.feed.address)
    page = live.feed.address.replace("http", "ws", 1) + "live"
    with (
        closing(live.feed),
        tempfile.TemporaryDirectory(prefix="soak-") as folder,
        beside(("-c", VIEWER, page, f"http://{at.netloc}")) as viewer,
        beside((__file__, "idle")) as idle,
        mock.patch.object(series, "open_rig", watcher.open),
    ):
        going = _until(start_s + minutes * 60.0, draw, watcher, Path(folder) / "runs")
        with closing(going), suppress(KeyboardInterrupt):  # what came until then is told
            for lift_made in going:
                made.lifts.append(lift_made)
                keep(made)
        beats, missed, granted, *late_s = idle.communicate("\n", timeout=10.0)[0].split()
        lost, there = live.feed.lost, viewer.poll() is None
        live.feed.close()
        said = viewer.communicate(timeout=10.0)[0].strip()
    made = Soak(minutes, granted == "True", made.lifts, watcher.counts, (int(beats), int(missed)),
                [float(at_s) for at_s in late_s], _children(os.getpid()), lost,
                int(said) if there and said else None)  # fmt: skip
    keep(made)
    return made


def _until(end_s: float, draw: Draw, watcher: Watcher, folder: Path) -> Generator[Lift, None, None]:
    made = 0
    while time.monotonic() < end_s:
        config = config_of(OBJECTS[made % len(OBJECTS)])
        folder.mkdir()
        with closing(_series(config, draw, watcher, folder)) as going:
            for lift_made in going:
                yield lift_made
                made += 1
        shutil.rmtree(folder)  # only how it is to record matters


def _series(
    config: LiftConfig, draw: Draw, watcher: Watcher, folder: Path
) -> Generator[Lift, None, None]:
    seeds = draw.seeds()
    watcher.begin(draw.due())
    going, name, begun_s = (
        lift.run_series(config, seeds, Bench(folder, watch=watcher.watch)), config.object.name,
        time.monotonic(),
    )  # fmt: skip
    try:
        for seed, finished in zip(seeds, going, strict=False):
            if interruption.asked():  # within a lift it is the lift that ended so
                raise KeyboardInterrupt
            yield _made(seed, name, finished, watcher, begun_s)
            watcher.begin(draw.due())
            begun_s = time.monotonic()
    except GraspError as error:  # where a rig could not be opened
        yield Lift(0, name, watcher.struck, NOT_OPENED, error.kind, str(error), "", watcher.periods,
                   0, 0, None, watcher.fate.let_go_m, begun_s, time.monotonic())  # fmt: skip
    finally:
        going.close()


def _made(
    seed: int, name: str, finished: FinishedRun[LiftResult], watcher: Watcher, begun_s: float
) -> Lift:
    result, failure = finished.result, finished.failure
    outcome, missed, stalls, peak_n = "", 0, 0, None
    if result is not None:
        outcome, missed = result.outcome, result.timing.missed_periods
        stalls = result.timing.cell_stalls
        peak_n = max(result.peak_force_n.values()) if result.peak_force_n else None
    kind, message = ("", "") if failure is None else (failure.kind, failure.message)
    end = None if failure is None else failure.end
    ended_s, after = time.monotonic(), watcher.after(failure is not None)
    return Lift(
        seed, name, watcher.struck, outcome, kind, message, "" if end is None else end.hand,
        watcher.periods, missed, stalls, peak_n, watcher.fate.let_go_m, begun_s, ended_s,
        "" if end is None else end.arm, watcher.fate.slid_m, after,
    )  # fmt: skip


def idle() -> None:
    """A loop of the same period and priority that does nothing, until its input closes."""
    clock, period_ns = WallClock(), round(1e9 * config_of("can").loop.period_s)
    os.set_blocking(0, False)
    beats, late_s = 0, list[float]()
    with real_time(RealTimeSettings()) if hasattr(os, "SCHED_FIFO") else nullcontext() as granted:
        deadlines = Deadlines(clock.now_ns, period_ns)
        while not _told():
            clock.sleep_until_ns(deadlines.next_ns())
            before = deadlines.missed
            deadlines.leave_out(clock.now_ns)
            if deadlines.missed > before:
                late_s.append(time.monotonic())
            beats += 1
    print(beats, deadlines.missed, granted, *late_s)


def _told() -> bool:
    try:
        return os.read(0, 1) is not None
    except BlockingIOError:
        return False


class Kept:
    """The file, whole after each lift, and a line a minute."""

    def __init__(self, out: Path) -> None:
        """Raises CouldNotRecord where nothing can be written; what stands there stays as yet."""
        self._out, self._said, self._start_s = out, 0, time.monotonic()
        self.lifts = 0
        if out.is_dir():
            raise CouldNotRecord(f"{out}: is a folder", ELSEWHERE)
        probe = out.with_name(partial_of(out.name, str(os.getpid())))
        with self._written():
            make_private_folder(out.parent)
            make_private_file(probe)
            probe.unlink()

    def keep(self, made: Soak) -> None:
        with self._written():
            write_whole(self._out, msgspec.json.encode(made))
        self.lifts = len(made.lifts)
        minute = int((time.monotonic() - self._start_s) / 60.0)
        if minute > self._said:
            self._said = minute
            print(f"{minute} of {made.minutes:g} min: {progress(made)}", flush=True)

    @contextmanager
    def _written(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise CouldNotRecord(f"{self._out}: {error.strerror}", ELSEWHERE) from None


def progress(made: Soak) -> str:
    """Of the lifts until now."""
    struck = sum(bool(one.struck) for one in made.lifts)
    return (f"{len(made.lifts)} lifts, {struck} struck, {missed_of(made.lifts):.1%} of their "
            f"periods missed, {len(by_itself(made))} failed by themselves")  # fmt: skip


def run(minutes: float, only: Sequence[str], out: Path) -> int:
    """Exit code."""
    kept = Kept(out)
    with interruption.taken():
        try:
            told = soak(minutes, only, kept.keep)
        except KeyboardInterrupt:  # once more, or before there was anything
            told = None
        if interruption.asked() or told is None:
            print(f"soak: {kept.lifts} lifts kept in {out}", file=sys.stderr)
            return 128 + interruption.number()
    return tell(told)


def read(path: Path) -> Soak:
    """Raises BadFile."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Soak)
    except OSError as error:
        raise BadFile(path, f"{error.strerror}", "make it first: soak.py run") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BadFile(path, f"{error}", "name the file of a run with --out") from None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="{run,tell}")
    for verb, what in VERBS.items():
        words = verbs.add_parser(verb, help=what, description=what)
        words.add_argument(
            "--out", type=Path, default=OUT, help="file of the lifts (default: %(default)s)"
        )
        if verb == "run":
            words.add_argument(
                "--minutes", type=decimal(0.1, MOST_MINUTES), default=60.0,
                help="after which no other lift is begun (default: %(default)g)",
            )  # fmt: skip
            words.add_argument(
                "--fault", action="append", default=[], choices=[one["name"] for one in FAULTS],
                help="strike every lift, by this fault; may be given several times "
                "(default: any of all, every fourth lift)",
            )  # fmt: skip
    verbs.add_parser("idle")  # which `run` begins
    asked = parser.parse_args()
    try:
        if asked.verb == "idle":
            idle()
            return 0
        return (
            run(asked.minutes, asked.fault, asked.out)
            if asked.verb == "run"
            else tell(read(asked.out))
        )
    except GraspError as error:
        print(f"soak: {error} ({error.remedy})", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
