"""The side of the run: what it tells a live page, never waiting for anybody.

`grasp.watch.Onlooker` hands it to a process of its own; what that cannot take in time is lost.
"""

import math
import os
import secrets
import socket
from typing import Any, Self

from grasp.clock import stopwatch_ns
from grasp.watch import Onlooker
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.press import PressPhase
from scenarios.acquire.session import Sample
from scenarios.report.drawn import Seen
from scenarios.report.live import server
from scenarios.report.live.server import Begin, Row, Said, Serve
from scenarios.trial.pictures import taxel_places

NAMES = ("fingertip",)  # in place of fingers


class LiveAcquisition:
    """``watch`` is what each sample is handed to."""

    def __init__(self, config: AcquireConfig, title: str, seconds: float) -> None:
        """Raises OSError where nobody may listen."""
        self.feed = Feed(title, NAMES, Seen(False, False, True, None, None), of=1)
        self._finger = config.finger
        self._left_s = seconds
        self._period_s = config.sampling.period_s
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
            self._onlooker = Onlooker(server, STDERR, (listening.fileno(),))
            shown = any(os.environ.get(name) for name in DISPLAYS)
            self._onlooker.tell(Serve(listening.fileno(), host, token, title, fingers, seen, shown))
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
        return self._onlooker.pid

    @property
    def lost(self) -> int:
        """Messages that were not taken."""
        return self._onlooker.lost

    def say(self, text: str) -> None:
        """A line between two trials."""
        self._onlooker.tell(Said(text))

    def close(self) -> None:
        """The page stays as it is in whichever browser shows it; safe to call twice."""
        self._onlooker.close()

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
            if not self._onlooker.show(self._begin):
                return
            self._begin = None
        self._onlooker.show(Row(phase, values, left_s))
