"""Where success falls below a level along an axis that gets harder, and how sure that is.

The rate is the non-increasing one that fits the trials best (isotonic regression, pooled adjacent
violators); between two places it is taken for linear. The interval is of resampled trials
(bootstrap): 95 % of them.
"""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

RESAMPLES = 400
SEED = 7
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
    rng = np.random.default_rng(SEED)
    again = [_fitted(x, *_resampled(won, trials, rng)) for _ in range(RESAMPLES)]
    found = []
    for level in levels:
        at = _crossing(x, falling(won, trials), level)
        low, high = np.quantile([_crossing(*fit, level) for fit in again], (0.025, 0.975),
                                method="nearest")  # fmt: skip
        found.append(Place(level, _finite(at), _finite(float(low)), _finite(float(high))))
    return found


def _fitted(x: Floats, won: Floats, trials: Floats) -> tuple[Floats, Floats]:
    """Those places that were tried, and the rate at each."""
    tried = trials > 0.0
    return x[tried], falling(won[tried], trials[tried])


def falling(won: Floats, trials: Floats) -> Floats:
    """Rates (n,) that never rise, nearest to won / trials, weighted by the trials."""
    blocks: list[tuple[float, float, int]] = []  # won, trials, places
    for w, n in zip(won.tolist(), trials.tolist(), strict=True):
        blocks.append((w, n, 1))
        while len(blocks) > 1 and _rate(blocks[-1]) > _rate(blocks[-2]):
            (w1, n1, k1), (w0, n0, k0) = blocks.pop(), blocks.pop()
            blocks.append((w0 + w1, n0 + n1, k0 + k1))
    return np.repeat([_rate(b) for b in blocks], [k for _, _, k in blocks])


def _rate(block: tuple[float, float, int]) -> float:
    return block[0] / block[1]


def _crossing(x: Floats, rate: Floats, level: float) -> float:
    """First place below the level; infinite beyond what was tried, x[0] if it begins below."""
    below = np.flatnonzero(rate < level)
    if len(below) == 0:
        return np.inf
    i = int(below[0])
    if i == 0:
        return float(x[0])
    part = (rate[i - 1] - level) / (rate[i - 1] - rate[i])
    return float(x[i - 1] + part * (x[i] - x[i - 1]))


def _resampled(won: Floats, trials: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """As many trials as there were, drawn from them."""
    counts = np.concatenate([won, trials - won])
    drawn = rng.multinomial(int(counts.sum()), counts / counts.sum()).astype(float)
    return drawn[: len(won)], drawn[: len(won)] + drawn[len(won) :]


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
