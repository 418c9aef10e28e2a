"""Where success falls below a level along an axis that gets harder, and how sure that is.

The rate is the non-increasing one that fits the trials best (isotonic regression, pooled adjacent
violators); between two places it is taken for linear. The interval holds every gap between
neighbouring places in which the fall could be, by the likelihood ratio of a rate that stays above
the level before it and below it after (as Banerjee and Wellner 2001, with the wider bound of the
chi-square distribution, since places are few). Its ends are places that were tried.
"""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

RATIO = 3.84  # twice the logarithm of the likelihood ratio; 95 %
Floats = NDArray[np.float64]


class Place(msgspec.Struct, frozen=True):
    """Where the rate falls below ``level``. None: not within what was tried."""

    level: float
    at: float | None
    low: float | None  # of the interval; None: not even there
    high: float | None  # None: the interval goes on beyond what was tried


def places(
    hard: Sequence[float], held: Sequence[bool], levels: Sequence[float] = (0.95, 0.5)
) -> list[Place]:
    """Along how hard each trial was, by whether it succeeded."""
    x, which = np.unique(np.asarray(hard, float), return_inverse=True)
    won, trials = np.zeros(len(x)), np.zeros(len(x))
    np.add.at(won, which, np.asarray(held, float))
    np.add.at(trials, which, 1.0)
    return [
        Place(level, _crossing(x, falling(won, trials), level), *_interval(x, won, trials, level))
        for level in levels
    ]


def falling(won: Floats, trials: Floats) -> Floats:
    """Rates (n,) that never rise, nearest to won / trials, weighted by the trials."""
    blocks: list[tuple[float, float, int]] = []  # won, trials, places
    for w, n in zip(won.tolist(), trials.tolist(), strict=True):
        blocks.append((w, n, 1))
        while len(blocks) > 1 and _rate(blocks[-1]) > _rate(blocks[-2]):
            (w1, n1, k1), (w0, n0, k0) = blocks.pop(), blocks.pop()
            blocks.append((w0 + w1, n0 + n1, k0 + k1))
    return np.repeat([_rate(b) for b in blocks], np.array([k for _, _, k in blocks], int))


def _rate(block: tuple[float, float, int]) -> float:
    return block[0] / block[1]


def _crossing(x: Floats, rate: Floats, level: float) -> float | None:
    """First place below the level; None beyond what was tried, x[0] if it begins below."""
    below = np.flatnonzero(rate < level)
    if len(below) == 0:
        return None
    i = int(below[0])
    if i == 0:
        return float(x[0])
    part = (rate[i - 1] - level) / (rate[i - 1] - rate[i])
    return float(x[i - 1] + part * (x[i] - x[i - 1]))


def _interval(
    x: Floats, won: Floats, trials: Floats, level: float
) -> tuple[float | None, float | None]:
    """From the easiest gap in which the fall could be to the hardest."""
    best = _log_likelihood(falling(won, trials), won, trials)
    may = [
        i
        for i in range(len(x) + 1)
        if 2 * (best - _log_likelihood(_split(won, trials, i, level), won, trials)) <= RATIO
    ]
    low = float(x[max(0, may[0] - 1)]) if may[0] < len(x) else None
    return low, float(x[may[-1]]) if may[-1] < len(x) else None


def _split(won: Floats, trials: Floats, i: int, level: float) -> Floats:
    """The best rates that are at least the level at the first i places and at most it after."""
    easy = np.maximum(falling(won[:i], trials[:i]), level) if i else np.zeros(0)
    hard = np.minimum(falling(won[i:], trials[i:]), level) if i < len(won) else np.zeros(0)
    return np.concatenate([easy, hard])


def _log_likelihood(rate: Floats, won: Floats, trials: Floats) -> float:
    sure = np.clip(rate, 1e-300, 1.0 - 1e-16)  # 0 log 0 is 0, and what cannot be is unlikely
    return float((won * np.log(sure) + (trials - won) * np.log1p(-sure)).sum())
