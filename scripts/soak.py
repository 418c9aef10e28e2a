"""An hour of lifts at 100 Hz on the emulated cell, with a fault now and then, watched by a page.

    python scripts/soak.py run [--minutes 60] [--out runs/soak.json]    run it, then tell
    python scripts/soak.py tell [--out runs/soak.json]                  what came of it

One process makes all lifts, recorded each; every fourth, by a seed, is struck in a phase by a
fault of the cell. Another process follows the live page, and a third does nothing but keep the same
period beside them: what that misses, the machine has missed. Once a lift, memory, descriptors,
threads and processes are counted, at the same place of it.

`run` and `tell` exit with 1 if any of them has grown after the first ten minutes, something was
left behind, the page was not told a row, or the loop missed more than is stated beside that third
process; and for each lift, struck or not, in which a true force passed limit and overshoot, the
object was lost in the air, or the run ended as it should not. A struck one may end in a fault
that names the device; one that was not, in none, unless it was late while that third process
missed a period.
"""

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
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
from grasp.doubt import STOOD_STILL
from grasp.phases import Phase
from grasp.realtime import RealTimeSettings, real_time
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.lift.result import LiftResult
from scenarios.lift.scoring import LiftOutcome
from scenarios.report.live.trials import LiveTrials
from scenarios.rigs.opening import open_rig
from scenarios.studies.faults.declared import CANNOT_BE_TOLD
from scenarios.studies.faults.verdict import BLAMED, LET_GO_M, MOST_N
from scenarios.trial import series
from scenarios.trial.execution import STALE
from scenarios.trial.result import FinishedRun
from scenarios.trial.series import Bench

OUT = Path("runs") / "soak.json"
SEED = 20261122
BETWEEN = 4  # lifts, on average, between two faults
COUNTED_TICKS = 300  # into a lift
SETTLED_S = 600.0  # what is made once has been made by then
MOST_GROWTH_MB_H = 8.0  # of resident memory; a leak of a lift's frames would be ten times that
# of its periods that a loop may miss beyond the idle one's share: it is watched and counted, and
# one whose device was struck waits for it
MOST_MISSED, MOST_MISSED_STRUCK = 0.01, 0.1
LOST = frozenset({LiftOutcome.DROPPED, LiftOutcome.EXPELLED, LiftOutcome.OVER_FORCE})
NOT_OPENED = "not opened"
NEVER = frozenset({"", NOT_OPENED, LiftOutcome.INTERNAL_ERROR, LiftOutcome.INTERRUPTED})
DEVICES = {
    "gripper": "gripper",
    "usb": "fingertips",
    "unplug": "fingertips",
    "arm": "arm",
    "protective": "arm",
}  # that a fault strikes, by its first word
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
    """One that was made. ``struck``: fault and phase, empty for none. ``peak_n``: true, of any
    finger, None where nothing was judged. ``let_go_m``: height at which the hand lost the object,
    0 for none. ``told``: how the hand was left. Times since the machine's clock began."""

    seed: int
    object: str
    struck: str
    outcome: str
    kind: str
    message: str
    told: str
    periods: int
    missed: int
    cell_stalls: int
    peak_n: float | None
    let_go_m: float
    begun_s: float
    ended_s: float

    def __str__(self) -> str:
        struck = f", {self.struck}" if self.struck else ""
        return f"seed {self.seed}, {self.object}{struck}"


class Soak(msgspec.Struct, frozen=True):
    """All of it. ``idle``: periods of the loop that does nothing, and those it missed;
    ``idle_late_s``: when it did, by the clock of ``Lift.begun_s``."""

    minutes: float
    real_time: bool
    lifts: list[Lift]
    counts: list[Count]
    idle: tuple[int, int]
    idle_late_s: list[float]
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
        self.let_go_m = 0.0
        self._held_at_m = 0.0  # height at which the hand had the object last
        self._start_s, self._live = start_s, live

    def begin(self, due: tuple[Phase, dict[str, Any]] | None) -> None:
        """Another lift, which is to be struck so."""
        self.periods, self.struck, self.due = 0, "", due
        self.let_go_m = self._held_at_m = 0.0

    def watch(self, tick: Any, truth: Any, controller: Any) -> None:
        self._live.watch(tick, truth, controller)
        self.periods += 1
        if truth is not None:
            if not truth.touched and self._held_at_m > LET_GO_M:
                self.let_go_m = max(self.let_go_m, self._held_at_m)
            self._held_at_m = truth.height_m if truth.touched else 0.0
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
        beats, missed, granted, *late_s = idle.communicate("\n", timeout=10.0)[0].split()
    lost = live.feed.lost
    live.feed.close()
    shutil.rmtree(folder)
    return Soak(minutes, granted == "True", lifts, watcher.counts, (int(beats), int(missed)),
                [float(at_s) for at_s in late_s], _children(os.getpid()), lost)  # fmt: skip


def _series(
    config: LiftConfig, seeds: Sequence[int], draw: random.Random, watcher: Watcher, folder: Path
) -> Iterator[Lift]:
    def draw_next() -> None:
        fault, phase = draw.choice(FAULTS), draw.choice(PHASES)
        watcher.begin((phase, fault) if draw.random() * BETWEEN < 1.0 else None)

    draw_next()
    going, name, begun_s = (
        lift.run_series(config, seeds, Bench(folder, watch=watcher.watch)), config.object.name,
        time.monotonic(),
    )  # fmt: skip
    try:
        for seed, finished in zip(seeds, going, strict=False):
            yield _made(seed, name, finished, watcher, begun_s)
            draw_next()
            begun_s = time.monotonic()
    except GraspError as error:  # where a rig could not be opened
        yield Lift(0, name, watcher.struck, NOT_OPENED, error.kind, str(error), "", watcher.periods,
                   0, 0, None, watcher.let_go_m, begun_s, time.monotonic())  # fmt: skip
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
    return Lift(
        seed, name, watcher.struck, outcome, kind, message, "" if end is None else end.hand,
        watcher.periods, missed, stalls, peak_n, watcher.let_go_m, begun_s, time.monotonic(),
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
    if told.lost_rows:
        found.append(f"the page was not told {told.lost_rows} rows")
    for struck, most in ((False, MOST_MISSED), (True, MOST_MISSED_STRUCK)):
        share, idle_share = missed_share(told, struck), told.idle[1] / max(1, sum(told.idle))
        if share > idle_share + most:
            which = "struck" if struck else "not struck"
            found.append(f"lifts that were {which} missed {share:.1%} of their periods, "
                         f"the idle loop {idle_share:.2%}")  # fmt: skip
    return found + [f"{made}: {text}" for made in told.lifts for text in wrong_in(made, told)]


def missed_share(told: Soak, struck: bool) -> float:
    """Of all periods that were due in lifts that were struck, or in those that were not."""
    lifts = [made for made in told.lifts if bool(made.struck) is struck]
    missed = sum(made.missed for made in lifts)
    return missed / max(1, missed + sum(made.periods for made in lifts))


def wrong_in(made: Lift, told: Soak) -> list[str]:
    """What may not be in one lift, struck or not."""
    found = []
    if made.outcome in NEVER | LOST:
        found.append(f"{made.outcome or 'no verdict'}: {made.message}")
    if made.peak_n is not None and made.peak_n > MOST_N:
        found.append(f"a true force of {made.peak_n:.1f} N")
    if made.let_go_m > LET_GO_M and not could_not_hold(made):
        found.append(f"let go at {made.let_go_m * 1e3:.0f} mm")
    if made.outcome == LiftOutcome.FAULT:
        if not made.struck and not excused(made, told):
            found.append(f"failed by itself: {made.message}")
        if made.struck and not names_the_struck(made):
            found.append(f"blames another: {made.message}")
    return found


def could_not_hold(made: Lift) -> bool:
    """Whether the fault took the only thing that could have held, and the last line says so."""
    told = made.outcome == LiftOutcome.FAULT and re.search(CANNOT_BE_TOLD, made.told) is not None
    return device_of(made) == "gripper" and told


def device_of(made: Lift) -> str:
    """That was struck; empty for none."""
    return DEVICES[re.split("[_ ]", made.struck)[0]] if made.struck else ""


def names_the_struck(made: Lift) -> bool:
    """Whether the cause speaks of the device that was struck, or of none, or of lateness."""
    named = {device for device, words in BLAMED.items() if re.search(words, made.message)}
    return not named or device_of(made) in named or "loop" in named


def excused(made: Lift, told: Soak) -> bool:
    """Whether it was late, and the machine was not there for the idle loop meanwhile either."""
    late = (
        made.kind == STALE
        or re.search(rf"{STOOD_STILL}|detector_late", made.message) is not None
        or (made.kind == "link_lost" and made.cell_stalls > 0)
    )
    away = any(made.begun_s <= at_s <= made.ended_s for at_s in told.idle_late_s)
    return made.outcome == LiftOutcome.FAULT and late and away


def by_itself(told: Soak) -> list[Lift]:
    """Lifts that failed though nothing had struck them, for whatever reason."""
    failed = NEVER | {LiftOutcome.FAULT}
    return [made for made in told.lifts if made.outcome in failed and not made.struck]


def tell(told: Soak) -> int:
    """Exit code."""
    struck = [made for made in told.lifts if made.struck]
    faults = sum(made.outcome == "fault" for made in struck)
    print(f"{told.minutes:g} min, {len(told.lifts)} lifts; {len(struck)} were struck, of which "
          f"{faults} ended in a fault; by itself failed {len(by_itself(told))}")  # fmt: skip
    outcomes = Counter(f"{made.outcome}{' (struck)' * bool(made.struck)}" for made in told.lifts)
    print(", ".join(f"{number} {outcome}" for outcome, number in outcomes.most_common()))
    excuses = sum(excused(made, told) for made in told.lifts if not made.struck)
    peak_n = max((made.peak_n for made in told.lifts if made.peak_n is not None), default=0.0)
    print(f"highest true force {peak_n:.2f} N; late with the machine, and excused: {excuses}")
    periods, missed = (sum(getattr(m, name) for m in told.lifts) for name in ("periods", "missed"))
    print(f"periods {periods}, missed {missed} ({missed_share(told, False):.2%} where not struck, "
          f"{missed_share(told, True):.2%} where struck); "
          f"idle {told.idle[0]}, missed {told.idle[1]}; "
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
