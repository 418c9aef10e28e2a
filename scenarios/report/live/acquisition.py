"""An acquisition on a live page: one fingertip, its force, how fast it is drawn."""

import math

from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.press import PressPhase
from scenarios.acquire.session import Sample
from scenarios.report.drawn import Seen
from scenarios.report.live.feed import Feed
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
