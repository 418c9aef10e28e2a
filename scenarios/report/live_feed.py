"""Sends a run to its live page, which a separate process serves. Sending never waits: messages that
the process cannot take in time are lost (`grasp.run.viewer_process`)."""

import secrets
import socket
from typing import Any

import numpy as np

from detector.decision import fused
from detector.loading import motion_reader
from drivers.interfaces import FINGERS
from grasp.control.controller import GraspController
from grasp.run.loop import Tick
from grasp.run.viewer_process import ViewerProcess
from scenarios.report import live_server as server
from scenarios.report.live_server import Begin, Note, Row, Serve
from scenarios.report.run_view import View, bound_of, page_data, taxels_of
from scenarios.trial.config import TrialConfig
from scenarios.world.truth import Truth

Values = list[float | None]
Columns = list[tuple[str, int]]
OF_MOTION: Columns = [("reported_speed", 3), ("reported_direction", 3), ("reported_turning", 3)]
OF_TRUTH: Columns = [
    ("true", 3), ("shear", 3), ("height", 1), ("slip", 1), ("slip_speed", 1), ("across", 1),
    ("turn", 1), ("onset", 1), ("impact", 1),
]  # fmt: skip


class LiveTrials:
    """Sends the ticks passed to ``watch`` to one page."""

    def __init__(self, config: TrialConfig, title: str, of: int) -> None:
        """``of``: number of trials. Raises OSError where no socket can listen."""
        self._config, self._taxels = config, taxels_of(config)
        self._bound = bound = bound_of(config.rule)
        self._truth = config.rig != "hardware"
        self._motion = _reports_motion(config)
        self._fused = bound.probable and config.rule.fusion == "mean"
        view = View(self._truth, self._motion, config.guard.force_limit_n, bound)
        self.feed = Feed(title, view, of)
        self._controller: GraspController | None = None
        self._phase = ""
        self._number = 1

    def trial(self, number: int) -> None:
        """Number of the next trial, from 1."""
        self._number = number

    def watch(self, tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        """Show one tick if it is due or an event; a new controller begins a new trial."""
        if controller is not self._controller:
            self._controller = controller
            self.feed.begin(self._data(tick), self._number)
        phase = tick.decision.state.value
        event = phase != self._phase or tick.decision.slip.event
        self._phase = phase
        if self.feed.due(event):
            self.feed.show(phase, self._values(tick, truth))

    def _data(self, tick: Tick) -> dict[str, Any]:
        config, height_m = self._config, tick.arm.position_m[2]
        columns: Columns = [
            ("t", 1), ("probability", FINGERS), ("estimated", FINGERS),
            ("counts", FINGERS * self._taxels), ("positions", FINGERS), ("arm", 1), ("status", 1),
            *([("decided", 1)] if self._fused else []),
            *(OF_MOTION if self._motion else []),
            *(OF_TRUTH if self._truth else []),
        ]  # fmt: skip
        top_m = height_m + config.controller.lift_height_m
        data = page_data(config, self._bound, self._taxels, height_m, top_m)
        return data | {"columns": columns}

    def _values(self, tick: Tick, truth: Truth | None) -> Values:
        """The columns of ``_data``, in their order."""
        obs, slip = tick.observation, tick.decision.slip
        status = slip.armed * 1.0 + slip.masked * 2.0 + slip.registered * 4.0
        values: Values = [tick.t_ns * 1e-9]
        if tick.frame is None:  # before rest counts were taken
            values += [None] * (FINGERS * (2 + self._taxels))
        else:
            values += [*obs.probabilities.tolist(), *tick.estimated_n]
            values += tick.frame.counts.ravel().tolist()
        values += [*tick.gripper.positions, tick.arm.position_m[2], status]
        if self._fused:
            values.append(float(fused(obs.probabilities[None], self._config.rule)[0, 0]))
        if self._motion:
            motion = obs.motion() if slip.armed else None
            values += _empty(OF_MOTION) if motion is None else [
                *motion.speed_mps, *motion.direction_deg, *motion.turning
            ]  # fmt: skip
        if self._truth:
            values += _empty(OF_TRUTH) if truth is None else [
                *truth.normal_n, *truth.shear_n, truth.height_m, truth.slip_distance_m,
                truth.slip_speed_mps, truth.across_m, truth.turn_rad, truth.slip_onset_s,
                truth.impact_s,
            ]  # fmt: skip
        return values


def _reports_motion(config: TrialConfig) -> bool:
    """Whether the detector has auxiliary outputs of motion; only its file states that."""
    detector = config.make_detector(FINGERS)
    detector.update(np.zeros((FINGERS, taxels_of(config)), np.int16))
    return motion_reader(detector)() is not None


def _empty(columns: Columns) -> Values:
    return [None] * sum(width for _, width in columns)


LOOPBACK = "127.0.0.1"
STDERR = 2
EVERY = 4  # control steps between two rows: 25 rows a second
TOKEN_BYTES = 16


class Feed:
    """One page for all trials of a call. ``address``: its URL."""

    def __init__(self, title: str, view: View, of: int) -> None:
        """``of``: number of trials. Raises OSError where no socket can listen."""
        token = secrets.token_urlsafe(TOKEN_BYTES)
        with socket.create_server((LOOPBACK, 0)) as listening:
            host = "{}:{}".format(*listening.getsockname())
            # the browser's messages must not mix with results on standard output
            self._viewer = ViewerProcess(server, STDERR, (listening.fileno(),))
            self._viewer.show_waiting(Serve(listening.fileno(), host, token, title, view))
        self.address = f"http://{host}/{token}/"
        self._of = of
        self._ticks = 0
        self._begin: Begin | None = None  # not sent yet

    @property
    def pid(self) -> int:
        """Process id of the server."""
        return self._viewer.pid

    @property
    def lost(self) -> int:
        """Number of lost messages."""
        return self._viewer.lost

    def say(self, text: str) -> None:
        """Show a message between two trials."""
        self._viewer.show_waiting(Note(text))

    def close(self) -> None:
        """Stop the server; an open page keeps its content. Safe to call twice."""
        self._viewer.close()

    def begin(self, data: dict[str, Any], number: int = 1) -> None:
        """Begin a trial, whose rows follow; ``number`` counts from 1."""
        self._ticks = 0
        self._begin = Begin(number, self._of, data)

    def due(self, event: bool) -> bool:
        """Count a tick, and return whether to show it."""
        self._ticks += 1
        return event or self._ticks % EVERY == 1

    def show(self, phase: str, values: list[float | None]) -> None:
        """Send one row, preceded by the trial's Begin if that is not sent yet."""
        if self._begin is not None:
            if not self._viewer.show(self._begin):
                return
            self._begin = None
        self._viewer.show(Row(phase, values))
