"""How much a detector's predictions vary where the truth does not: variance within each class.

The paper says that the TCN "predicted the class label with significantly lower variance" than the
frequency CNN, and not how that was measured. Here it is the variance of the probability among
samples of one label, the mean of both labels; intervals by bootstrap over recordings, and of a
difference over the same draws.
"""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings
from detector.scores.cells import RESAMPLES, Drawn, Estimate
from detector.scores.evaluation import WARM_UP_SAMPLES, Streamed, spoken
from detector.scores.metrics import Floats


class Variance(msgspec.Struct, frozen=True, eq=False):
    """Of one detector's probabilities within a class."""

    detector: str
    drawn: Drawn

    @property
    def estimate(self) -> Estimate:
        return self.drawn.estimate


def variance_of(
    detector: str, rule: RuleSettings, streams: Sequence[Streamed], seed: int = 0
) -> Variance:
    """Equal seeds and recordings give draws that can be subtracted."""
    sums = np.array([_sums(s, rule) for s in streams])  # (recordings, classes, 3)
    drawn = np.random.default_rng(seed).integers(0, len(sums), (RESAMPLES, len(sums)))
    return Variance(
        detector, Drawn(float(_within(sums.sum(axis=0))), _within(sums[drawn].sum(axis=1)))
    )


def _sums(s: Streamed, rule: RuleSettings) -> list[list[float]]:
    """Number, sum and sum of squares of the probabilities of either label."""
    p, labels = spoken(s, rule)[WARM_UP_SAMPLES:], s.labels[WARM_UP_SAMPLES:]
    parts = (p[~labels], p[labels])
    return [[float(len(x)), float(x.sum()), float(np.square(x).sum())] for x in parts]


def _within(sums: NDArray[np.float64]) -> Floats:
    """(...) of (..., classes, 3)."""
    n = np.maximum(sums[..., 0], 1.0)
    variance: Floats = (sums[..., 2] / n - np.square(sums[..., 1] / n)).mean(axis=-1)
    return variance
