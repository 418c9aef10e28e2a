"""A decision rule set without labels: from minutes in which nothing slips, and one unloading.

The largest values of each second that a rule compares with its threshold are taken for exponential
beyond what a quarter of the seconds exceed. That tail is followed to the budget of false events.
The unloading says that the fingertips felt anything at all, and where the hold ended.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import MOST_LOG_ODDS, RuleSettings, cusum, log_odds, mean_probability
from detector.energy import SAMPLES_PER_MIN
from detector.scores.quantiles import quantile
from drivers.errors import UsageError

BLOCK = 100  # samples: a second, of which the largest value counts
TAIL = 0.25  # share of the seconds that the tail is fitted to
LEAST_BLOCKS = 30
CHUNK = 5  # blocks drawn together by the bootstrap: neighbours are alike
RESAMPLES, LOW, HIGH = 500, 0.025, 0.975
SETTLED = 100  # samples at either end of a hold that are left out
HOLDS = 0.5  # of the load of a hold: below it, it has ended
LEAST_LOAD_COUNTS = 30.0  # of a hand, over all its taxels: less is no hold
Floats = NDArray[np.float64]


class Unlabelled(msgspec.Struct, frozen=True):
    """A rule, and what it was set by."""

    rule: RuleSettings
    level: float  # what the rule compares: log-odds, or their sum
    interval: tuple[float, float]  # of that level, 95 %
    minutes: float
    load_counts: float  # over all taxels, that the unloading took off


def hold_of(counts: NDArray[np.int16]) -> tuple[slice, float]:
    """Of a recording (n, fingers, taxels) of one hold that ends with an unloading, the samples of
    the hold without its beginning and end, and the load that came off, counts.

    Raises UsageError where nothing was held, or the recording ends before the hold does.
    """
    load = np.abs(counts.sum(axis=(1, 2), dtype=np.float64))
    level = float(np.median(load[load > load.max() / 4])) if load.max() > 0.0 else 0.0
    held = np.flatnonzero(load > HOLDS * level)
    if level < LEAST_LOAD_COUNTS or held[-1] >= len(load) - 1:
        problem = "presses nothing" if level < LEAST_LOAD_COUNTS else "does not end unloaded"
        remedy = "hold something still for three minutes, open the hand, and record until then"
        raise UsageError(f"the hand {problem}", remedy)
    first = int(held[0]) + SETTLED
    return slice(first, max(first, int(held[-1]) - SETTLED)), level


def compared(probabilities: Floats, rule: RuleSettings) -> Floats:
    """What the rule compares with its threshold (n,), the most of any finger: the least log-odds of
    so many samples in a row, or their sum."""
    p = mean_probability(probabilities) if rule.fusion == "mean" else probabilities
    if rule.kind == "cusum":
        values = cusum(p, rule)
    elif len(p) < rule.consecutive:
        return np.empty(0)
    else:
        windows = np.lib.stride_tricks.sliding_window_view(log_odds(p), rule.consecutive, axis=0)
        values = windows.min(axis=2)
    most: Floats = values.max(axis=1)
    return most


def level_of(maxima: Floats, budget_per_min: float) -> float:
    """The level that the largest values (n,) of a second exceed so often, by their tail."""
    ordered = np.sort(maxima)
    border = quantile(ordered, 1.0 - TAIL)
    beyond = ordered[ordered > border]
    mean_excess = float((beyond - border).mean()) if len(beyond) else 0.0
    blocks_per_min = SAMPLES_PER_MIN / BLOCK
    return border + mean_excess * math.log(TAIL * blocks_per_min / budget_per_min)


def set_rule(
    holds: Sequence[Floats], rule: RuleSettings, budget_per_min: float, load_counts: float
) -> Unlabelled:
    """The rule with the threshold (or limit) that the probabilities (n, fingers) of static holds
    exceed so often. Raises UsageError for too little of them, and where the tail says that no
    threshold separates what is held from slip."""
    if budget_per_min <= 0.0:
        raise UsageError("a tail never ends", "allow some false events with --budget, 0.1 a minute")
    values = [compared(p, rule) for p in holds]
    seconds = [v[: len(v) // BLOCK * BLOCK].reshape(-1, BLOCK).max(axis=1) for v in values]
    maxima = np.concatenate(seconds)
    if len(maxima) < LEAST_BLOCKS:
        raise UsageError(
            f"{len(maxima)} s of hold are too few", f"record {LEAST_BLOCKS} s or more, best 180"
        )
    level = level_of(maxima, budget_per_min)
    interval = _interval(maxima, budget_per_min)
    if rule.kind == "cusum":
        made = msgspec.structs.replace(rule, limit=max(level, 0.01))
    elif level < MOST_LOG_ODDS:
        made = msgspec.structs.replace(rule, threshold=1.0 / (1.0 + math.exp(-level)))
    else:
        raise UsageError(
            "what is held still looks like slip to this detector",
            "allow more false events with --budget, or ask for more samples in a row",
        )
    return Unlabelled(made, level, interval, len(maxima) * BLOCK / SAMPLES_PER_MIN, load_counts)


def _interval(maxima: Floats, budget_per_min: float) -> tuple[float, float]:
    rng = np.random.default_rng(0)
    starts, chunks = np.arange(max(1, len(maxima) - CHUNK + 1)), math.ceil(len(maxima) / CHUNK)
    drawn = sorted(
        level_of(np.concatenate([maxima[s : s + CHUNK] for s in each]), budget_per_min)
        for each in (rng.choice(starts, chunks) for _ in range(RESAMPLES))
    )
    return quantile(drawn, LOW), quantile(drawn, HIGH)
