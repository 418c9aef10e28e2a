"""An hour of lifts at 100 Hz on the emulated cell, with a fault now and then, watched by a page.

    python scripts/soak.py run [--minutes 60] [--out runs/soak.json]    run it, then tell
    python scripts/soak.py tell [--out runs/soak.json]                  what came of it

One process makes all lifts, recorded each; every fourth, by a seed, is struck in a phase by a
fault of the cell. Another process follows the live page, and a third does nothing but keep the same
period beside them: what that misses, the machine has missed. Once a lift, memory, descriptors,
threads and processes are counted, at the same place of it. `run` and `tell` exit with 1 if any of
them has grown after the first ten minutes, something was left behind, or a lift failed by itself
though that third process missed nothing.
"""

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any
from unittest import mock
from urllib.parse import urlsplit

import msgspec
import numpy as np

from drivers.errors import GraspError
from grasp.clock import Deadlines, WallClock
from grasp.phases import Phase
from grasp.realtime import RealTimeSettings, real_time
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.report.live.trials import LiveTrials
from scenarios.rigs.opening import open_rig
from scenarios.trial import series
from scenarios.trial.series import Bench

OUT = Path("runs") / "soak.json"
SEED = 20261122
BETWEEN = 4  # lifts, on average, between two faults
COUNTED_TICKS = 300  # into a lift
SETTLED_S = 600.0  # what is made once has been made by then
MOST_GROWTH_MB_H = 8.0  # of resident memory; a leak of a lift's frames would be ten times that
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
VIEWER = (
    "import sys\nfrom websockets.sync.client import connect\n"
    "with connect(sys.argv[1], origin=sys.argv[2]) as page:\n"
    "    for message in page: pass\n"
)


class Count(msgspec.Struct, frozen=True):
    """What this process holds, `t_s` after the beginning; memory in MB."""

    t_s: float
    resident_mb: float
    descriptors: int
    threads: int
    children: int
    children_mb: float


class Lift(msgspec.Struct, frozen=True):
    """One that was made. ``struck``: fault and phase, empty for none."""

    seed: int
    object: str
    struck: str
    outcome: str
    message: str
    periods: int
    missed: int


class Soak(msgspec.Struct, frozen=True):
    """All of it. ``idle``: periods of the loop that does nothing, and those it missed."""

    minutes: float
    real_time: bool
    lifts: list[Lift]
    counts: list[Count]
    idle: tuple[int, int]
    left: list[str]  # behind, at the end
    lost_rows: int  # that the page was not told


def count(start_s: float) -> Count:
    """Now."""
    children = [int(pid) for pid in _children(os.getpid())]
    return Count(
        time.monotonic() - start_s, _resident_mb(os.getpid()), len(os.listdir("/proc/self/fd")),
        len(os.listdir("/proc/self/task")), len(children), sum(map(_resident_mb, children)),
    )  # fmt: skip


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
        self._start_s, self._live = start_s, live

    def watch(self, tick: Any, truth: Any, controller: Any) -> None:
        self._live.watch(tick, truth, controller)
        self.periods += 1
        if self.periods == COUNTED_TICKS:
            self.counts.append(count(self._start_s))
        if self.due is not None and tick.decision.phase is self.due[0]:
            phase, request = self.due
            self.due, self.struck = None, f"{request['name']} in {phase.value}"
            self.cell.control.ask("fault", **request)

    @contextmanager
    def open(self, *asked: Any) -> Iterator[Any]:
        with open_rig(*asked) as rig:
            self.cell = getattr(rig.world, "__self__", None)
            yield rig


@contextmanager
def beside(command: Sequence[str]) -> Iterator[subprocess.Popen[str]]:
    """Another process of ours, which ends with this."""
    child = subprocess.Popen(
        [sys.executable, "-P", *command], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True,
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


def soak(minutes: float) -> Soak:
    """Lifts until the time is over; a fault ends a series, and another rig is opened."""
    start_s, draw, lifts = time.monotonic(), random.Random(SEED), list[Lift]()
    live = LiveTrials(config_of(OBJECTS[0]), "soak", 0)
    watcher = Watcher(start_s, live)
    at = urlsplit(live.feed.address)
    page = live.feed.address.replace("http", "ws", 1) + "live"
    folder = Path(tempfile.mkdtemp(prefix="soak-"))
    with (
        beside(("-c", VIEWER, page, f"http://{at.netloc}")),
        beside((__file__, "idle")) as idle,
        mock.patch.object(series, "open_rig", watcher.open),
    ):
        while time.monotonic() - start_s < minutes * 60.0:
            config = config_of(OBJECTS[len(lifts) % len(OBJECTS)])
            seeds = [draw.randrange(1 << 16) for _ in range(2 * BETWEEN)]
            lifts += _series(config, seeds, draw, watcher, folder)
            shutil.rmtree(folder)  # only how it is to record matters
            folder.mkdir()
        beats, missed, granted = idle.communicate("\n", timeout=10.0)[0].split()
    lost = live.feed.lost
    live.feed.close()
    shutil.rmtree(folder)
    return Soak(minutes, granted == "True", lifts, watcher.counts, (int(beats), int(missed)),
                _children(os.getpid()), lost)  # fmt: skip


def _series(
    config: LiftConfig, seeds: Sequence[int], draw: random.Random, watcher: Watcher, folder: Path
) -> Iterator[Lift]:
    def draw_next() -> None:
        watcher.periods, watcher.struck, watcher.due = 0, "", None
        fault, phase = draw.choice(FAULTS), draw.choice(PHASES)
        if draw.random() * BETWEEN < 1.0:
            watcher.due = phase, fault

    draw_next()
    going = lift.run_series(config, seeds, Bench(folder, watch=watcher.watch))
    try:
        for seed, finished in zip(seeds, going, strict=False):
            result, failure = finished.result, finished.failure
            outcome, missed = ("", 0) if result is None else (
                result.outcome, result.timing.missed_periods
            )  # fmt: skip
            message = "" if failure is None else failure.message
            name, struck = config.object.name, watcher.struck
            yield Lift(seed, name, struck, outcome, message, watcher.periods, missed)
            draw_next()
    except GraspError as error:  # where a rig could not be opened
        yield Lift(0, config.object.name, watcher.struck, "not opened", str(error), 0, 0)
    finally:
        going.close()


def idle() -> None:
    """A loop of the same period and priority that does nothing, until its input closes."""
    clock, period_ns = WallClock(), round(1e9 * config_of("can").loop.period_s)
    os.set_blocking(0, False)
    beats = 0
    with real_time(RealTimeSettings()) if hasattr(os, "SCHED_FIFO") else nullcontext() as granted:
        deadlines = Deadlines(clock.now_ns, period_ns)
        while not _told():
            clock.sleep_until_ns(deadlines.next_ns())
            deadlines.leave_out(clock.now_ns)
            beats += 1
    print(beats, deadlines.missed, granted)


def _told() -> bool:
    try:
        return os.read(0, 1) is not None
    except BlockingIOError:
        return False


def grown(counts: Sequence[Count]) -> dict[str, tuple[float, float, float]]:
    """Of each count, after the first ten minutes: least, most, and what a straight line through
    them says that it grows by in an hour."""
    late = [c for c in counts if c.t_s > SETTLED_S]
    if len(late) < 3:
        return {}
    hours = np.array([c.t_s for c in late]) / 3600.0
    found = {}
    for name in ("resident_mb", "descriptors", "threads", "children", "children_mb"):
        values = np.array([getattr(c, name) for c in late], dtype=float)
        slope = float(np.polyfit(hours, values, 1)[0])
        found[name] = float(values.min()), float(values.max()), slope
    return found


def wrong(told: Soak) -> list[str]:
    """What may not be."""
    found = [f"left behind: process {pid}" for pid in told.left]
    for name, (least, most, slope) in grown(told.counts).items():
        if name in ("descriptors", "threads", "children") and most != least:
            found.append(f"{name}: {least:g} to {most:g}")
        if name.endswith("mb") and slope > MOST_GROWTH_MB_H:
            found.append(f"{name} grows by {slope:.1f} MB an hour")
    if told.idle[1] == 0:  # the machine was there all the time
        found += [
            f"seed {made.seed}, {made.object}: {made.outcome}: {made.message}"
            for made in by_itself(told)
        ]
    return found


def by_itself(told: Soak) -> list[Lift]:
    """Lifts that failed though nothing had struck them."""
    failed = ("", "fault", "not opened")
    return [made for made in told.lifts if made.outcome in failed and not made.struck]


def tell(told: Soak) -> int:
    """Exit code."""
    struck = [made for made in told.lifts if made.struck]
    faults = sum(made.outcome == "fault" for made in struck)
    print(f"{told.minutes:g} min, {len(told.lifts)} lifts; {len(struck)} were struck, of which "
          f"{faults} ended in a fault; by itself failed {len(by_itself(told))}")  # fmt: skip
    periods, missed = (sum(getattr(m, name) for m in told.lifts) for name in ("periods", "missed"))
    print(f"periods {periods}, missed {missed}; idle {told.idle[0]}, missed {told.idle[1]}; "
          f"priority {'granted' if told.real_time else 'not granted'}; "
          f"rows that the page missed {told.lost_rows}")  # fmt: skip
    for name, (least, most, slope) in grown(told.counts).items():
        print(f"{name}: {least:.1f} to {most:.1f} after ten minutes, {slope:+.2f} an hour")
    for text in (found := wrong(told)):
        print(f"WRONG {text}")
    return 1 if found else 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("verb", choices=("run", "tell", "idle"))
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--out", type=Path, default=OUT)
    asked = parser.parse_args()
    if asked.verb == "idle":
        idle()
        return 0
    if asked.verb == "run":
        told = soak(asked.minutes)
        asked.out.parent.mkdir(parents=True, exist_ok=True)
        asked.out.write_bytes(msgspec.json.encode(told))
    return tell(msgspec.json.decode(asked.out.read_bytes(), type=Soak))


if __name__ == "__main__":
    sys.exit(main())
