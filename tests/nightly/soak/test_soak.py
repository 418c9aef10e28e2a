"""The soak test (`make test-soak MINUTES=60`): recorded lifts on the emulated cell, one after the
other in one process. One in four has a random fault of the cell in a random phase. Each must end
correctly, and memory and descriptors must not grow after ten minutes.
"""

import os
import random
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from grasp.control.states import State
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.rigs import emulated
from scenarios.rigs.emulated import CellProcess, cell_process
from scenarios.trial.experiment import TrialContext
from scenarios.trial.series import run_series
from tests.nightly.cell_observer import CellObserver
from tests.nightly.lift_verdict import ObservedLift, problems

MINUTES = float(os.environ.get("MINUTES", "3"))
SEED = 20261122
BETWEEN = 4  # lifts, on average, between two faults
COUNTED_TICKS = 300  # into a lift
SETTLED_S = 600.0  # caches are filled by then
# one leaked float per control step is 11.5 MB an hour
MOST_GROWTH_MB_H, MOST_SPREAD_MB = 4.0, 12.0
LEAST_LIFTS_A_MINUTE, LEAST_FAULTS = 2.0, 0.1
OBJECTS = ("can", "ball", "foam")
PHASES = (
    State.SHAPE,
    State.BRACE,
    State.LIFT,
    State.COMPENSATE,
    State.HOLD,
    State.DESCEND,
    State.OPEN,
)
FAULTS: tuple[tuple[str, dict[str, Any]], ...] = (  # device and request to the cell
    ("gripper", {"name": "gripper_garble", "times": 3}),
    ("gripper", {"name": "gripper_freeze", "seconds": 1.0}),
    ("gripper", {"name": "gripper_disconnect"}),
    ("gripper", {"name": "gripper_fault", "code": 14}),
    ("fingertips", {"name": "usb_timeout", "times": 5}),
    ("fingertips", {"name": "unplug"}),
    ("arm", {"name": "protective_stop"}),
    ("arm", {"name": "emergency_stop"}),
    ("arm", {"name": "speed_slider", "fraction": 0.0}),
    ("arm", {"name": "arm_disconnect"}),
    ("arm", {"name": "arm_freeze", "seconds": 0.5}),
)
TAKE_THE_HAND = frozenset({"gripper_freeze", "gripper_disconnect", "gripper_fault"})


class Count(msgspec.Struct, frozen=True):
    """Resources of this process ``t_s`` after its start, once per lift at the same phase."""

    t_s: float
    resident_mb: float
    descriptors: int
    threads: int
    children: int
    children_mb: float


class Watcher:
    """Injects faults, counts resources during a lift, and starts an observer for each lift."""

    def __init__(self) -> None:
        self.counts: list[Count] = []
        self._start_s, self._random = time.monotonic(), random.Random(SEED)
        self._cell: CellProcess | None = None  # of the open rig
        self.begin()

    def seeds(self) -> list[int]:
        return [self._random.randrange(1 << 16) for _ in range(2 * BETWEEN)]

    def begin(self) -> None:
        """Begin another lift and choose its fault, if any."""
        self._periods, self.fault, self._device = 0, "", ""
        self._observer: CellObserver | None = None
        due = self._random.choice(FAULTS), self._random.choice(PHASES)
        self.due = due if self._random.random() * BETWEEN < 1.0 else None

    @contextmanager
    def cell_process(self, *args: Any) -> Iterator[CellProcess]:
        with cell_process(*args) as cell:
            self._cell = cell
            yield cell

    def watch(self, tick: Any, truth: Any, controller: Any) -> None:
        assert self._cell is not None
        if self._observer is None:
            at = self._cell.endpoints["control"]
            self._observer = CellObserver(at["host"], at["port"])
        self._periods += 1
        if self._periods == COUNTED_TICKS:
            self.counts.append(count(time.monotonic() - self._start_s))
        if self.due is not None and tick.decision.state is self.due[1]:
            (self._device, request), self.due = self.due[0], None
            self.fault = request["name"]
            self._cell.control.ask("fault", **request)

    def ended(self, finished: Any) -> ObservedLift:
        """Outcome of a lift whose rig is still open."""
        assert self._observer is not None, finished
        faulty = frozenset({self._device} - {""})
        return ObservedLift(faulty, self.fault in TAKE_THE_HAND, self._observer.end()).of(finished)


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


@pytest.mark.timeout(900 + 90 * MINUTES)
def test_long_series_of_lifts_has_no_problems_and_no_growth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    end_s, watcher, lifts, faults = time.monotonic() + 60.0 * MINUTES, Watcher(), 0, 0
    monkeypatch.setattr(emulated, "cell_process", watcher.cell_process)
    found = []
    while time.monotonic() < end_s:  # a fault ends a series, and another rig is opened
        name, runs = OBJECTS[lifts % len(OBJECTS)], tmp_path / str(lifts)
        config = load_config(name, "emulated", None, None, ("hand.activation_s=0.5",)).for_lift()
        runs.mkdir()
        watcher.begin()
        context = TrialContext(runs, watch=watcher.watch)
        with closing(run_series(lift, config, watcher.seeds(), context)) as series:
            for finished in series:
                ended = watcher.ended(finished)
                print(name, watcher.fault, ended, flush=True)
                lifts, faults = lifts + 1, faults + bool(watcher.fault)
                found += [(watcher.fault, ended, wrong) for wrong in problems(ended, config)]
                watcher.begin()
    assert found == []
    assert growing(watcher.counts) == []
    assert lifts >= LEAST_LIFTS_A_MINUTE * MINUTES
    assert faults >= int(LEAST_FAULTS * lifts)


def growing(counts: Sequence[Count]) -> list[str]:
    """Resources that grow after ten minutes."""
    late = [c for c in counts if c.t_s > SETTLED_S]
    found = []
    for name in ("resident_mb", "children_mb", "descriptors", "threads", "children"):
        values = [float(getattr(c, name)) for c in late]
        if len(values) < 3:
            continue
        spread = max(values) - min(values)
        if not name.endswith("mb"):
            found += [f"{name}: {min(values):g} to {max(values):g}"] if spread else []
            continue
        slope = float(np.polyfit([c.t_s / 3600.0 for c in late], values, 1)[0])
        if slope > MOST_GROWTH_MB_H or spread > MOST_SPREAD_MB:
            found.append(f"{name} grows by {slope:.1f} MB an hour, spread {spread:.0f} MB")
    return found


def test_growth_is_found() -> None:
    flat = [Count(14.0 * n, 200.0, 24, 5, 5, 470.0) for n in range(257)]
    assert growing(flat) == []
    for name, rate in (("resident_mb", 5.0), ("children_mb", 5.0), ("descriptors", 1.0)):
        grown = [
            msgspec.structs.replace(c, **{name: getattr(c, name) + rate * c.t_s / 3600.0})
            for c in flat
        ]
        assert name in "; ".join(growing(grown))
