"""The side of the run: what it tells a live page, never waiting for anybody.

`grasp.viewer_process` hands it to a process of its own; what that cannot take in time is lost.
"""

import math
import os
import secrets
import socket
from typing import Any, Self

import msgspec
import numpy as np

from detector.decision import fused
from detector.interface import motion_told_by
from drivers.interfaces import FINGER_NAMES, FINGERS, PERIOD_S
from grasp.clock import stopwatch_ns
from grasp.controller import GraspController
from grasp.loop import Tick
from grasp.viewer_process import ViewerProcess
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.press import PressPhase
from scenarios.acquire.session import Sample
from scenarios.report.drawn import Seen, scene, taxels_of
from scenarios.report.live import server
from scenarios.report.live.server import Begin, Row, Said, Serve
from scenarios.report.run_decision import bound_of
from scenarios.report.run_record import Told
from scenarios.trial.config import TrialConfig
from scenarios.trial.pictures import taxel_places
from scenarios.world.truth import Truth

Values = list[float | None]
Columns = list[tuple[str, int]]
OF_MOTION: Columns = [("told_speed", 3), ("told_way", 3), ("told_turning", 3)]
OF_TRUTH: Columns = [
    ("true", 3), ("shear", 3), ("height", 1), ("slip", 1), ("slip_speed", 1), ("across", 1),
    ("turn", 1), ("onset", 1), ("struck", 1),
]  # fmt: skip


class LiveTrials:
    """``watch`` is what each tick is handed to."""

    def __init__(self, config: TrialConfig, title: str, of: int) -> None:
        """``of``: how many trials there will be. Raises OSError where nobody may listen."""
        self._told = msgspec.convert(msgspec.to_builtins(config), Told)
        self._rule = config.rule
        self._bound = bound = bound_of(config.rule)
        self._lift_m = config.controller.lift_height_m
        self._truth = config.rig != "hardware"
        self._motion = _has_heads(config, self._told)
        self._fused = bound.probable and config.rule.fusion == "mean"
        limit_n = config.guard.force_limit_n
        self.feed = Feed(
            title, FINGER_NAMES, Seen(True, self._truth, self._motion, limit_n, bound), of
        )
        self._controller: GraspController | None = None
        self._phase = ""
        self._number = 1

    def trial(self, number: int) -> None:
        """Which of all of them comes next, from 1."""
        self._number = number

    def watch(self, tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        """Show one tick, if it is time or something happened; another controller is another
        trial."""
        if controller is not self._controller:
            self._controller = controller
            self.feed.begin(self._data(tick), self._number)
        phase = tick.decision.state.value
        news = phase != self._phase or tick.decision.slip.event
        self._phase = phase
        if self.feed.due(news):
            self.feed.show(phase, self._values(tick, truth))

    def _data(self, tick: Tick) -> dict[str, Any]:
        height_m = tick.arm.position_m[2]
        taxels = taxels_of(self._told)
        columns: Columns = [
            ("t", 1), ("probability", FINGERS), ("felt", FINGERS), ("counts", FINGERS * taxels),
            ("positions", FINGERS), ("arm", 1), ("status", 1),
        ]  # fmt: skip
        columns += [("decided", 1)] if self._fused else []
        columns += OF_MOTION if self._motion else []
        columns += OF_TRUTH if self._truth else []
        return {
            "fingers": FINGER_NAMES,
            "taxels": taxel_places(self._told.fingertip.taxels_mm, taxels),
            "limit_n": self._told.guard.force_limit_n,
            "rule": msgspec.to_builtins(self._bound),
            "columns": columns,
            "scene": scene(self._told, height_m, height_m + self._lift_m),
        }

    def _values(self, tick: Tick, truth: Truth | None) -> Values:
        """The columns of ``_data``, in their order."""
        seen, slip = tick.observation, tick.decision.slip
        status = slip.armed * 1.0 + slip.masked * 2.0 + slip.registered * 4.0
        values: Values = [tick.t_ns * 1e-9]
        if tick.frame is None:  # nobody knows yet what fingertips feel
            values += [None] * (FINGERS * (2 + taxels_of(self._told)))
        else:
            values += [*seen.probabilities.tolist(), *tick.measured_n]
            values += tick.frame.counts.ravel().tolist()
        values += [*tick.gripper.positions, tick.arm.position_m[2], status]
        if self._fused:
            values.append(float(fused(seen.probabilities[None], self._rule)[0, 0]))
        if self._motion:
            told = seen.motion if slip.armed else None
            values += _empty(OF_MOTION) if told is None else [
                *told.speed_mps, *told.direction_deg, *told.turning
            ]  # fmt: skip
        if self._truth:
            values += _empty(OF_TRUTH) if truth is None else _true(truth)
        return values


def _has_heads(config: TrialConfig, told: Told) -> bool:
    """Whether the detector reports the kind of slip; only the detector's file states it."""
    detector = config.make_detector(FINGERS)
    detector.update(np.zeros((FINGERS, taxels_of(told)), np.int16))
    return motion_told_by(detector)() is not None


def _empty(columns: Columns) -> Values:
    return [None] * sum(width for _, width in columns)


def _true(t: Truth) -> Values:
    moved = (t.height_m, t.slip_distance_m, t.slip_speed_mps, t.across_m, t.turn_rad)
    return [*t.normal_n, *t.shear_n, *moved, t.slip_onset_s, t.struck_s]


NAMES = ("fingertip",)  # in place of fingers


class LiveAcquisition:
    """``watch`` is what each sample is handed to."""

    def __init__(self, config: AcquireConfig, title: str, seconds: float) -> None:
        """Raises OSError where nobody may listen."""
        self.feed = Feed(title, NAMES, Seen(False, False, True, None, None), of=1)
        self._finger = config.finger
        self._left_s = seconds
        self._period_s = PERIOD_S
        self._phase: PressPhase | None = None

    def watch(self, sample: Sample) -> None:
        """Show one sample, if it is time or a phase began."""
        counts = sample.frame.counts[self._finger]
        if self._phase is None:
            taxels = len(counts)
            columns = [("t", 1), ("felt", 1), ("counts", taxels), ("told_speed", 1)]
            places = taxel_places([], taxels)
            self.feed.begin({"fingers": NAMES, "taxels": places, "columns": columns})
        news = sample.phase is not self._phase
        self._phase = sample.phase
        if sample.phase is not PressPhase.APPROACH:
            self._left_s = max(0.0, self._left_s - self._period_s)
        if self.feed.due(news):
            x_mps, y_mps, _ = sample.arm.velocity_mps
            values = [
                sample.t_ns * 1e-9,
                sample.force_n,
                *counts.tolist(),
                math.hypot(x_mps, y_mps),
            ]
            self.feed.show(sample.phase.value, values, self._left_s)


LOOPBACK = "127.0.0.1"
STDERR = 2
EVERY = 4  # ticks between two rows: 25 a second
TOKEN_BYTES = 16
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


class Feed:
    """One page for all trials of a call. ``address`` is where it is."""

    def __init__(self, title: str, fingers: tuple[str, ...], seen: Seen, of: int) -> None:
        """``of``: how many trials there will be. Raises OSError where nobody may listen."""
        token = secrets.token_urlsafe(TOKEN_BYTES)
        with socket.create_server((LOOPBACK, 0)) as listening:
            host = "{}:{}".format(*listening.getsockname())
            # what a browser says of itself is no part of a result on standard output
            self._viewer = ViewerProcess(server, STDERR, (listening.fileno(),))
            shown = any(os.environ.get(name) for name in DISPLAYS)
            self._viewer.tell(Serve(listening.fileno(), host, token, title, fingers, seen, shown))
        self.address = f"http://{host}/{token}/"
        self._of = of
        self._begun = 0  # trials, also those of which nobody heard
        self._ticks = 0
        self._began_ns = stopwatch_ns()
        self._begin: Begin | None = None  # that nobody has taken yet

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def pid(self) -> int:
        """Of the process that serves."""
        return self._viewer.pid

    @property
    def lost(self) -> int:
        """Messages that were not taken."""
        return self._viewer.lost

    def say(self, text: str) -> None:
        """A line between two trials."""
        self._viewer.tell(Said(text))

    def close(self) -> None:
        """The page stays as it is in whichever browser shows it; safe to call twice."""
        self._viewer.close()

    def begin(self, data: dict[str, Any], number: int = 1) -> None:
        """Another trial, of which rows follow; ``number``: which of all, from 1."""
        self._ticks = 0
        spent_s = (stopwatch_ns() - self._began_ns) * 1e-9
        left_s = spent_s / self._begun * (self._of - number + 1) if self._begun else None
        self._begun += 1
        self._begin = Begin(number, self._of, left_s, data)

    def due(self, news: bool) -> bool:
        """Whether this tick is shown."""
        self._ticks += 1
        return news or self._ticks % EVERY == 1

    def show(self, phase: str, values: list[float | None], left_s: float | None = None) -> None:
        """One instant. A trial of which nobody heard that it began is begun first."""
        if self._begin is not None:
            if not self._viewer.show(self._begin):
                return
            self._begin = None
        self._viewer.show(Row(phase, values, left_s))
