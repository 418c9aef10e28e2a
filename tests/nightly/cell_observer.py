"""Observes the emulated cell through its control port, during a run and after its end."""

import contextlib
import threading
import time
from contextlib import closing
from itertools import pairwise
from typing import Any

import msgspec

from drivers.errors import LinkLost
from scenarios.rigs.emulated import ControlClient
from scenarios.rigs.emulated_cell import OPEN_M
from scenarios.world.truth import Truth
from tests.nightly.last_line import DROPPED_M, SLIDES_MPS

LOOK_S = 0.05
LATER_S, MOMENT_S = 1.5, 0.5  # wait after the end, then a period without any motion
NEAR_S = 6.0  # longest safe state and closing of the rig


class Snapshot(msgspec.Struct, frozen=True):
    """State of the cell at one instant."""

    truth: Truth
    arm_mps: float
    fingers_mps: float
    travel_m: float = 0.0  # of the most closed finger
    at_s: float = 0.0


class Aftermath(msgspec.Struct, frozen=True):
    """State of the object, and motion long after the end."""

    looks: int = 0
    object: str = "not observed"
    lost_at_m: float = 0.0  # height at which the hand lost it; 0: not lost, or on the table
    slid_m: float = 0.0  # in the hand, in the air
    peak_n: float = 0.0
    arm_mps: float = 0.0  # highest speed in the period long after the end
    fingers_mps: float = 0.0
    looks_later: int = 0  # observations in that period
    pressed_n: float | None = None  # last force of the most loaded finger
    opened: bool | None = None  # last state of the hand
    gap_s: float = 0.0  # longest time between two observations near the end


class CellObserver:
    """A thread with its own connection to the cell."""

    def __init__(self, host: str, port: int) -> None:
        self._address = host, port
        self._stopping = threading.Event()
        self._looks: list[Snapshot] = []
        self._thread = threading.Thread(target=self._run, name="observer", daemon=True)
        self._thread.start()

    def end(self) -> Aftermath:
        """Finish, after the application has closed its devices."""
        time.sleep(LATER_S)
        ended = len(self._looks)
        time.sleep(MOMENT_S)
        self._stopping.set()
        self._thread.join()
        return aftermath(self._looks, ended)

    def _run(self) -> None:
        with contextlib.suppress(OSError, LinkLost), closing(ControlClient(*self._address)) as cell:
            while not self._stopping.wait(LOOK_S):
                self._looks.append(snapshot(cell))


def snapshot(cell: Any) -> Snapshot:
    known, motion = cell.ask("truth"), cell.ask("motion")
    truth = msgspec.convert(known["truth"], Truth)
    return Snapshot(truth, motion["arm_mps"], motion["fingers_mps"], max(known["travel_m"]),
                time.monotonic())  # fmt: skip


def aftermath(looks: list[Snapshot], ended: int) -> Aftermath:
    """Evaluate the observations; ``ended``: index of the first in the period without motion."""
    later = looks[ended:]
    if not later:
        return Aftermath(len(looks))
    lost_at_m = slid_m = 0.0
    truths = [one.truth for one in looks]
    for before, after in pairwise(truths):
        if before.touched and not after.touched and before.height_m > DROPPED_M:
            lost_at_m = max(lost_at_m, before.height_m)
        if before.touched and after.touched and min(before.height_m, after.height_m) > DROPPED_M:
            slid_m += abs(after.slip_distance_m - before.slip_distance_m)
    since_s = later[0].at_s - LATER_S - NEAR_S
    near = [one.at_s for one in looks if one.at_s >= since_s]
    gap_s = max((after - before for before, after in pairwise(near)), default=0.0)
    return Aftermath(
        len(looks), _object(truths[-1]), lost_at_m, slid_m,
        max(max(t.peak_n) for t in truths), max(one.arm_mps for one in later),
        max(one.fingers_mps for one in later), len(later), max(truths[-1].normal_n),
        looks[-1].travel_m < OPEN_M, gap_s,
    )  # fmt: skip


def _object(truth: Truth) -> str:
    if truth.height_m <= DROPPED_M:
        return "on the table, gripped" if truth.touched else "on the table"
    if truth.touched and abs(truth.slip_speed_mps) < SLIDES_MPS:
        return "held in the air"
    return "slips" if truth.touched else "falls"
