"""Label-free calibration of a decision rule: from a hold without slip that ends with an unloading.

The maxima per second of the value that the rule compares with its threshold are modelled by an
exponential tail above their upper quartile. Extrapolating the tail to the budget of false alarms
gives the threshold. The unloading proves that the fingertips measured a load, and ends the hold.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import MAX_LIMIT, MAX_LOG_ODDS, RuleSettings, cusum, fused, log_odds
from detector.energy import SAMPLES_PER_MIN
from detector.scores.figures import HIGH, LOW
from detector.scores.metrics import Floats
from detector.scores.quantiles import quantile
from drivers.errors import UsageError

BLOCK = 100  # samples, one second; its maximum counts
TAIL = 0.25  # share of the seconds that the tail is fitted to
MIN_BLOCKS = 30
CHUNK = 5  # consecutive blocks resampled together, because neighbours are correlated
RESAMPLES_OF_HOLDS = 500
MARGIN_SAMPLES = 100  # excluded at either end of a hold
END_SHARE = 0.5  # of the load of a hold, below which it has ended
MIN_LOAD_COUNTS = 30.0  # of a hand, over all its taxels: less is not a hold


class CalibratedRule(msgspec.Struct, frozen=True):
    """A calibrated rule, and the data that it is based on."""

    rule: RuleSettings
    level: float  # threshold in log-odds, or limit of their sum
    interval: tuple[float, float]  # of that level, 95 %
    minutes: float
    load_counts: float  # over all taxels, removed by the unloading


def find_hold(counts: NDArray[np.int16]) -> tuple[slice, float]:
    """Find the hold in a recording (n, fingers, taxels) that ends with an unloading.

    Returns the samples of the hold without its margins, and the load that was removed, counts.
    Raises UsageError without a hold, and for a recording that ends before the unloading.
    """
    load = np.abs(counts.sum(axis=(1, 2), dtype=np.float64))
    level = float(np.median(load[load > load.max() / 4])) if load.max() > 0.0 else 0.0
    loaded = np.flatnonzero(load > END_SHARE * level)
    if level < MIN_LOAD_COUNTS or loaded[-1] >= len(load) - 1:
        problem = "presses nothing" if level < MIN_LOAD_COUNTS else "does not end unloaded"
        remedy = "hold something still for three minutes, open the hand, then stop recording"
        raise UsageError(f"the hand {problem}", remedy)
    first = int(loaded[0]) + MARGIN_SAMPLES
    return slice(first, max(first, int(loaded[-1]) - MARGIN_SAMPLES)), level


def decision_values(probabilities: Floats, rule: RuleSettings) -> Floats:
    """Value (n,) that the rule compares with its threshold, maximum over the fingers: the minimum
    log-odds of consecutive samples, or their sum."""
    p = fused(probabilities, rule)
    if rule.kind == "cusum":
        values = cusum(p, rule)
    elif len(p) < rule.consecutive:
        return np.empty(0)
    else:
        windows = np.lib.stride_tricks.sliding_window_view(log_odds(p), rule.consecutive, axis=0)
        values = windows.min(axis=2)
    maximum: Floats = values.max(axis=1)
    return maximum


def tail_level(maxima: Floats, budget_per_min: float) -> float:
    """Level that the maxima (n,) per second exceed ``budget_per_min`` times, by their tail."""
    ordered = np.sort(maxima)
    border = quantile(ordered, 1.0 - TAIL)
    beyond = ordered[ordered > border]
    mean_excess = float((beyond - border).mean()) if len(beyond) else 0.0
    blocks_per_min = SAMPLES_PER_MIN / BLOCK
    return border + mean_excess * math.log(TAIL * blocks_per_min / budget_per_min)


def calibrate_rule(
    holds: Sequence[Floats], rule: RuleSettings, budget_per_min: float, load_counts: float
) -> CalibratedRule:
    """Calibrate the threshold (or limit) of a rule on probabilities (n, fingers) of static holds.

    Raises UsageError for holds that are too short, and if no threshold keeps to the budget.
    """
    if budget_per_min <= 0.0:
        remedy = "allow some false alarms with --budget, e.g. 0.1 a minute"
        raise UsageError("a budget of 0 false alarms has no threshold", remedy)
    values = [decision_values(p, rule) for p in holds]
    seconds = [v[: len(v) // BLOCK * BLOCK].reshape(-1, BLOCK).max(axis=1) for v in values]
    maxima = np.concatenate(seconds)
    if len(maxima) < MIN_BLOCKS:
        raise UsageError(
            f"{len(maxima)} s of hold are too few", f"record at least {MIN_BLOCKS} s, better 180 s"
        )
    level = tail_level(maxima, budget_per_min)
    interval = _interval(maxima, budget_per_min)
    if rule.kind == "cusum" and level <= MAX_LIMIT:
        tuned = msgspec.structs.replace(rule, limit=max(level, 0.01))
    elif rule.kind != "cusum" and level < MAX_LOG_ODDS:
        tuned = msgspec.structs.replace(rule, threshold=1.0 / (1.0 + math.exp(-level)))
    else:
        raise UsageError(
            "this detector classifies the hold without slip as slip",
            "allow more false alarms with --budget, or set more consecutive samples or drift",
        )
    minutes = len(maxima) * BLOCK / SAMPLES_PER_MIN
    return CalibratedRule(tuned, level, interval, minutes, load_counts)


def _interval(maxima: Floats, budget_per_min: float) -> tuple[float, float]:
    rng = np.random.default_rng(0)
    starts, chunks = np.arange(max(1, len(maxima) - CHUNK + 1)), math.ceil(len(maxima) / CHUNK)
    levels = sorted(
        tail_level(np.concatenate([maxima[s : s + CHUNK] for s in each]), budget_per_min)
        for each in (rng.choice(starts, chunks) for _ in range(RESAMPLES_OF_HOLDS))
    )
    return quantile(levels, LOW), quantile(levels, HIGH)
