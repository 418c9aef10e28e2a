"""Lifts at 100 Hz on the emulated cell, one after the other, with a fault now and then.

One process makes all lifts and records each. By a seed, every fourth is struck by a fault of the
cell in some phase. Once a lift, at the same place, memory, descriptors, threads and processes are
counted. After each lift the cell is asked what became of the object and what still moves.
"""

import os
import random
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import msgspec

from drivers.errors import GraspError
from grasp.phases import Phase
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.lift.result import LiftResult
from scenarios.rigs.emulated_cell import OPEN_M
from scenarios.rigs.opening import open_rig
from scenarios.trial import series
from scenarios.trial.result import FinishedRun
from scenarios.trial.series import Bench
from scenarios.world.truth import Truth
from tests.nightly.last_line import LET_GO_M

SEED = 20261122
BETWEEN = 4  # lifts, on average, between two faults
COUNTED_TICKS = 300  # into a lift
LATER_S, LOOK_S = 1.5, 0.05  # after a lift that failed; between two looks
LOOKS, LOOKS_LATER = 4, 10  # after a lift that went well, and after one that failed
STALL_S = 0.05  # longer between two steps: the machine stood still
NOT_OPENED = "not opened"
OBJECTS = ("can", "ball", "foam")
PHASES = (Phase.APPROACH, Phase.GRASP, Phase.LIFT, Phase.HOLD, Phase.LOWER, Phase.RELEASE)
FAULTS: tuple[tuple[str, dict[str, Any]], ...] = (  # device and request to the cell
    ("gripper", {"name": "gripper_garble", "times": 3}),
    ("gripper", {"name": "gripper_freeze", "seconds": 1.0}),
    ("gripper", {"name": "gripper_disconnect"}),
    ("gripper", {"name": "gripper_fault", "code": 14}),
    ("fingertips", {"name": "usb_timeout", "times": 5}),
    ("fingertips", {"name": "unplug"}),
    ("arm", {"name": "protective_stop"}),
    ("arm", {"name": "arm_disconnect"}),
    ("arm", {"name": "arm_freeze", "seconds": 0.5}),
)


class Count(msgspec.Struct, frozen=True):
    """What this process holds ``t_s`` after the beginning."""

    t_s: float
    resident_mb: float
    descriptors: int
    threads: int
    children: int
    children_mb: float


class After(msgspec.Struct, frozen=True):
    """What the cell knows after a lift: highest speeds in a moment then, and the last state."""

    arm_mps: float
    fingers_mps: float
    pressed_n: float  # by the most loaded finger
    opened: bool  # the hand
    height_m: float
    slip_mps: float


class Lift(msgspec.Struct, frozen=True):
    """One lift. None: not observed."""

    object: str
    struck: str  # the fault's name; empty for none
    device: str  # that was struck
    outcome: str
    message: str
    arm: str  # how it was left, by the last line
    hand: str
    peak_n: float | None  # true force
    let_go_m: float  # height at which the hand lost the object; 0: it did not
    slid_m: float  # in the hand, in the air
    stalled: bool  # the machine, in this lift
    after: After | None = None


class Watcher:
    """Strikes, counts and follows the object while a lift goes on."""

    def __init__(self) -> None:
        self.counts: list[Count] = []
        self.cell: Any = None  # of the open rig
        self._start_s, self._random = time.monotonic(), random.Random(SEED)
        self.begin()

    def seeds(self) -> list[int]:
        return [self._random.randrange(1 << 16) for _ in range(2 * BETWEEN)]

    def begin(self) -> None:
        """Another lift; draws its fault, if any."""
        self._periods, self.struck, self.device = 0, "", ""
        self.stalled, self._last_s = False, 0.0
        self.let_go_m = self.slid_m = self._held_at_m = self._slip_m = 0.0
        due = self._random.choice(FAULTS), self._random.choice(PHASES)
        self._due = due if self._random.random() * BETWEEN < 1.0 else None

    def watch(self, tick: Any, truth: Any, controller: Any) -> None:
        self._periods += 1
        last_s, self._last_s = self._last_s, time.monotonic()
        self.stalled |= 0.0 < last_s < self._last_s - STALL_S
        if truth is not None:
            self.see(truth)
        if self._periods == COUNTED_TICKS:
            self.counts.append(count(time.monotonic() - self._start_s))
        if self._due is not None and tick.decision.phase is self._due[1]:
            (self.device, request), self._due = self._due[0], None
            self.struck = request["name"]
            self.cell.control.ask("fault", **request)

    def see(self, truth: Truth) -> None:
        """Follow the object."""
        if not truth.touched and self._held_at_m > LET_GO_M:
            self.let_go_m = max(self.let_go_m, self._held_at_m)
        if truth.touched and min(truth.height_m, self._held_at_m) > LET_GO_M:
            self.slid_m += abs(truth.slip_distance_m - self._slip_m)
        self._held_at_m = truth.height_m if truth.touched else 0.0
        self._slip_m = truth.slip_distance_m

    def after(self, failed: bool) -> After | None:
        """Look at the cell while its rig is still open; None: it is gone."""
        if failed:
            time.sleep(LATER_S)
        moved = list[dict[str, Any]]()
        try:
            for _ in range(LOOKS_LATER if failed else LOOKS):
                time.sleep(LOOK_S)
                known = self.cell.control.ask("truth")
                truth = msgspec.convert(known["truth"], Truth)
                self.see(truth)
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

    def ended(self, name: str, finished: FinishedRun[LiftResult]) -> Lift:
        result, failure = finished.result, finished.failure
        outcome = "" if result is None else result.outcome
        forces = None if result is None else result.peak_force_n
        end = None if failure is None else failure.end
        after = self.after(failure is not None)
        return Lift(
            name, self.struck, self.device, outcome, "" if failure is None else failure.message,
            "" if end is None else end.arm, "" if end is None else end.hand,
            max(forces.values()) if forces else None, self.let_go_m, self.slid_m, self.stalled,
            after,
        )  # fmt: skip


def count(t_s: float) -> Count:
    children = [
        int(child) for task in Path("/proc/self/task").iterdir()
        for child in _words(task / "children")
    ]  # fmt: skip
    return Count(
        t_s, _resident_mb("self"), len(os.listdir("/proc/self/fd")),
        len(os.listdir("/proc/self/task")), len(children), sum(map(_resident_mb, children)),
    )  # fmt: skip


def _words(path: Path) -> list[str]:
    try:
        return path.read_text().split()
    except OSError:  # it has ended
        return []


def _resident_mb(pid: int | str) -> float:
    words = _words(Path(f"/proc/{pid}/statm"))
    return int(words[1]) * os.sysconf("SC_PAGESIZE") / 1e6 if words else 0.0


def soak(minutes: float, folder: Path) -> tuple[list[Lift], list[Count]]:
    """Lifts until the time is over; a fault ends a series, and another rig is opened."""
    end_s, watcher, made = time.monotonic() + 60.0 * minutes, Watcher(), list[Lift]()
    with mock.patch.object(series, "open_rig", watcher.open):
        while time.monotonic() < end_s:
            name = OBJECTS[len(made) % len(OBJECTS)]
            told = load_config(name, "emulated", None, None, ("hand.activation_s=0.5",)).for_lift()
            runs = folder / str(len(made))
            runs.mkdir()
            watcher.begin()
            bench = Bench(runs, watch=watcher.watch)
            with closing(lift.run_series(told, watcher.seeds(), bench)) as going:
                try:
                    for finished in going:
                        made.append(watcher.ended(name, finished))
                        print(made[-1], flush=True)
                        watcher.begin()
                except GraspError as error:  # a rig could not be opened
                    made.append(Lift(name, watcher.struck, watcher.device, NOT_OPENED, str(error),
                                     "", "", None, 0.0, 0.0, watcher.stalled))  # fmt: skip
    return made, watcher.counts
