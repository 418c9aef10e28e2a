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
from scenarios.report.live_server import Begin, Note, Row, Serve, Values
from scenarios.report.run_view import View, bound_of, page_data, taxels_of
from scenarios.trial.config import TrialConfig
from scenarios.world.truth import Truth

NOTHING = [None] * FINGERS


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
        height_m = tick.arm.position_m[2]
        top_m = height_m + self._config.controller.lift_height_m
        return page_data(self._config, self._bound, self._taxels, height_m, top_m)

    def _values(self, tick: Tick, truth: Truth | None) -> Values:
        """The columns of one row, the same in every row."""
        obs, slip, frame = tick.observation, tick.decision.slip, tick.frame  # frame: over rest
        status = slip.armed * 1.0 + slip.masked * 2.0 + slip.registered * 4.0
        values: Values = {
            "t": [tick.t_ns * 1e-9],
            "probability": NOTHING if frame is None else obs.probabilities.tolist(),
            "estimated": NOTHING if frame is None else tick.estimated_n,
            "counts": NOTHING * self._taxels if frame is None else frame.counts.ravel().tolist(),
            "positions": tick.gripper.positions,
            "arm": [tick.arm.position_m[2]],
            "status": [status],
        }
        if self._fused:
            fused_p = fused(obs.probabilities[None], self._config.rule)[0, 0]
            values["decided"] = [float(fused_p)]
        if self._motion:
            motion = obs.motion() if slip.armed else None
            values["reported_speed"] = NOTHING if motion is None else motion.speed_mps
            values["reported_direction"] = NOTHING if motion is None else motion.direction_deg
            values["reported_turning"] = NOTHING if motion is None else motion.turning
        if self._truth:
            names = {
                "height": "height_m", "slip": "slip_distance_m", "slip_speed": "slip_speed_mps",
                "across": "across_m", "turn": "turn_rad", "onset": "slip_onset_s",
                "impact": "impact_s",
            }  # fmt: skip
            values["true"] = NOTHING if truth is None else truth.normal_n
            values["shear"] = NOTHING if truth is None else truth.shear_n
            for key, name in names.items():
                values[key] = [None if truth is None else getattr(truth, name)]
        return values


def _reports_motion(config: TrialConfig) -> bool:
    """Whether the detector has auxiliary outputs of motion; only its file states that."""
    detector = config.make_detector(FINGERS)
    detector.update(np.zeros((FINGERS, taxels_of(config)), np.int16))
    return motion_reader(detector)() is not None


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

    def show(self, phase: str, values: Values) -> None:
        """Send one row, preceded by the trial's Begin if that is not sent yet."""
        if self._begin is not None:
            if not self._viewer.show(self._begin):
                return
            self._begin = None
        self._viewer.show(Row(phase, values))
