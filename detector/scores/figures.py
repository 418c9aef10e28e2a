"""Figures with 95 % bootstrap intervals, over recordings or other independent units.

Samples of one stroke are not independent, so resampling takes whole recordings, or whole strokes
and pauses of a single recording.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.scores.metrics import Floats, Labels, Ranking
from detector.scores.quantiles import quantile

LOW, HIGH = 0.025, 0.975
RESAMPLES, RESAMPLES_OF_STROKES = 300, 1000
T = TypeVar("T")


class Figure(msgspec.Struct, frozen=True):
    """A value with its 95 % interval; None where undefined, infinite where more was missed."""

    value: float | None
    low: float | None = None
    high: float | None = None


def figure(statistic: Callable[[Sequence[T]], float | None], units: Sequence[T]) -> Figure:
    """The statistic with its interval over units, if there are several."""
    if len(units) < 2:
        return Figure(statistic(units))
    drawn = [statistic([units[i] for i in chosen]) for chosen in resamples(len(units))]
    return bounded(statistic(units), drawn)


def resamples(units: int, seed: int = 0) -> list[NDArray[np.intp]]:
    """Numbers of the units in each resample, the same in every call."""
    rng = np.random.default_rng(seed)
    return [rng.integers(0, units, units) for _ in range(RESAMPLES)]


def quantile_figures(name: str, unit: str, values: Floats) -> dict[str, Figure]:
    """Three quantiles of values, without intervals, as NAME_p50_UNIT, ...; None without values."""
    ordered, shares = np.sort(values), {"p50": 0.5, "p90": 0.9, "p99": 0.99}
    return {
        f"{name}_{title}_{unit}": Figure(quantile(ordered, share) if len(values) else None)
        for title, share in shares.items()
    }


def bounded(value: float | None, drawn: Sequence[float | None]) -> Figure:
    """The value with the interval of its resamples."""
    ordered = sorted(each for each in drawn if each is not None)
    if value is None or not ordered:
        return Figure(value)
    return Figure(float(value), float(quantile(ordered, LOW)), float(quantile(ordered, HIGH)))


class Samples(msgspec.Struct, frozen=True, eq=False):
    """Probabilities and labels (n,) with the block of each sample; blocks are resampled whole."""

    p: Floats
    labels: Labels
    block: NDArray[np.intp]
    resamples: list[NDArray[np.intp]]  # numbers of blocks

    def figure(self, statistic: Callable[[Floats], float | None]) -> Figure:
        """A statistic of the weights (n,) of the samples, with its interval."""
        blocks = int(self.block[-1]) + 1
        times = (np.bincount(each, minlength=blocks) for each in self.resamples)
        drawn = [statistic(each[self.block].astype(np.float64)) for each in times]
        return bounded(statistic(np.ones(len(self.p))), drawn)

    def auc(self) -> Figure:
        """Area under the ROC curve."""
        return self.figure(Ranking(self.p, self.labels).auc)

    def accuracy(self, threshold: float) -> Figure:
        """Share of the samples that the threshold classifies correctly."""
        correct = (self.p > threshold) == self.labels
        return self.figure(lambda weights: float((correct * weights).sum() / weights.sum()))


def samples_of(parts: Sequence[tuple[Floats, Labels]]) -> Samples:
    """Probabilities and labels of recordings; the blocks of a single one are its strokes and
    pauses, which have no resamples if there are fewer than two of a kind."""
    p, labels = (np.concatenate(column) for column in zip(*parts, strict=True))
    if len(parts) > 1:
        block = np.repeat(np.arange(len(parts)), [len(each) for _, each in parts])
        return Samples(p, labels, block, resamples(len(parts)))
    block = np.concatenate([[0], np.cumsum(labels[1:] != labels[:-1])])
    is_slip = labels[np.unique(block, return_index=True)[1]]
    kinds = np.flatnonzero(is_slip), np.flatnonzero(~is_slip)
    rng, draws = np.random.default_rng(0), RESAMPLES_OF_STROKES if min(map(len, kinds)) > 1 else 0
    drawn = [np.concatenate([rng.choice(kind, len(kind)) for kind in kinds]) for _ in range(draws)]
    return Samples(p, labels, block, drawn)
