"""Validation score of a network: mean delay of events, then likelihood. Does not need torch."""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings
from detector.recordings import LabelName, Recording
from detector.scores.evaluation import Streamed
from detector.scores.sweep import MISS_MS, best, rules, sweep

BUDGETS_PER_MIN = (0.5, 1.0, 2.0, 4.0)  # of false alarms, over three fingers
NEWTON_STEPS, RIDGE, LEAST_SLOPE = 25, 1e-6, 0.05


class Score(msgspec.Struct, frozen=True):
    """Score of one validation. ``delay_ms`` is the least mean delay within a budget of false alarms
    (`scores.sweep.best`), averaged over budgets; MISS_MS for a budget that no rule keeps to."""

    delay_ms: float
    loss: float
    accuracy: float

    def better_than(self, other: "Score | None") -> bool:
        """Whether the delay is shorter, or equal with a lower loss; True for None."""
        return other is None or (self.delay_ms, self.loss) < (other.delay_ms, other.loss)


def score(
    odds: Sequence[NDArray[np.float64]],
    recordings: Sequence[Recording],
    label: LabelName,
    shift: float,
) -> Score:
    """Score of log-odds (n, fingers) of each recording."""
    streams = [
        Streamed(r, 1.0 / (1.0 + np.exp(-(o + shift))), np.empty(0), label)
        for r, o in zip(recordings, odds, strict=True)
    ]
    # the mean over the fingers of a hand, as in training
    kind = ("consecutive", "mean", 2, RuleSettings().release)
    candidates = [
        r for r in rules(RuleSettings()) if (r.kind, r.fusion, r.consecutive, r.release) == kind
    ]
    points = sweep(streams, candidates)
    chosen = [best(points, budget) for budget in BUDGETS_PER_MIN]
    delays = [point.mean_delay_ms if point else MISS_MS for point in chosen]
    z = np.concatenate([o.mean(axis=1) + shift for o in odds])
    y = np.concatenate([s.labels for s in streams])
    return Score(
        delay_ms=float(np.mean(delays)),
        loss=likelihood(z, y),
        accuracy=float(((z > 0) == y).mean()),
    )


def likelihood(odds: NDArray[np.float64], labels: NDArray[np.bool_]) -> float:
    """Mean negative log-likelihood of labels (n,) under log-odds (n,)."""
    return float(np.logaddexp(0.0, np.where(labels, -odds, odds)).mean())


def calibration(odds: NDArray[np.float64], labels: NDArray[np.bool_]) -> tuple[float, float]:
    """Temperature and shift of maximum likelihood, for (odds + shift) / temperature (Platt 1999, by
    Newton's method). The shift restores the share of slip in these labels."""
    x = np.column_stack([odds, np.ones_like(odds)])
    w = np.zeros(2)
    for _ in range(NEWTON_STEPS):
        p = 0.5 * (1.0 + np.tanh(x @ w / 2.0))
        curvature = (x * (p * (1.0 - p))[:, None]).T @ x + RIDGE * np.eye(2)
        w -= np.linalg.solve(curvature, x.T @ (p - labels))
    slope = max(float(w[0]), LEAST_SLOPE)
    return 1.0 / slope, float(w[1]) / slope
