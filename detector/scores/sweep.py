"""How soon against how often wrongly: rules and thresholds swept over what a detector said.

The curve of a detector is what a user can choose from: for each rate of false events the least
delay (an AMOC curve, Fawcett and Provost 1999). Misses count as delays to the end of their slip.
"""

import math
from collections.abc import Iterable, Iterator, Sequence

import msgspec
import numpy as np

from detector.decision import RuleSettings
from detector.scores.evaluation import (
    WARM_UP_SAMPLES,
    Streamed,
    events_by_label,
    hand_rate,
    judge_stream,
)
from detector.scores.metrics import Floats
from detector.scores.quantiles import quantile

LOG_ODDS = np.linspace(-3.0, 9.0, 17)  # thresholds tried
LIMITS = np.geomspace(0.5, 100.0, 14)  # of summed log-odds
CONSECUTIVE = (1, 2, 3, 5)
DRIFTS = (0.0, 2.0)


class SweepPoint(msgspec.Struct, frozen=True):
    """What one rule makes of a detector."""

    rule: RuleSettings
    false_per_min: float  # over three fingers
    delay_ms: float  # median
    mean_delay_ms: float
    p90_delay_ms: float
    recall: float


def rules(base: RuleSettings) -> Iterator[RuleSettings]:
    """Every rule tried: consecutive samples over a threshold, and sums over a limit."""
    for k in CONSECUTIVE:
        for odds in LOG_ODDS:
            yield msgspec.structs.replace(
                base, kind="consecutive", consecutive=k, threshold=_logistic(float(odds))
            )
    for drift in DRIFTS:
        for limit in LIMITS:
            yield msgspec.structs.replace(
                base, kind="cusum", drift=drift, limit=float(limit), threshold=_logistic(drift)
            )


def _logistic(odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-odds))


def point(streams: Sequence[Streamed], rule: RuleSettings, first_sample: int) -> SweepPoint | None:
    """Score one rule; None for data without slip or without rest."""
    judged = [judge_stream(s, rule, events_by_label(s.label), first_sample) for s in streams]
    delays: Floats = np.concatenate([j.delays_ms for j in judged])
    rate = hand_rate(streams, judged)
    if rate is None or not len(delays):
        return None
    missed = sum(j.missed for j in judged)
    ordered = np.sort(delays)
    return SweepPoint(
        rule, rate, quantile(ordered, 0.5), float(delays.mean()), quantile(ordered, 0.9),
        1.0 - missed / len(delays),
    )  # fmt: skip


def sweep(
    streams: Sequence[Streamed],
    tried: Iterable[RuleSettings],
    first_sample: int = WARM_UP_SAMPLES,
) -> list[SweepPoint]:
    """A point for every rule."""
    found = (point(streams, rule, first_sample) for rule in tried)
    return [p for p in found if p is not None]


def best(points: Iterable[SweepPoint], budget_per_min: float) -> SweepPoint | None:
    """The quickest on average that keeps to the budget over three fingers; None if none does."""
    allowed = [p for p in points if p.false_per_min <= budget_per_min]
    return min(allowed, key=lambda p: (p.mean_delay_ms, p.false_per_min), default=None)


def frontier(points: Iterable[SweepPoint]) -> list[SweepPoint]:
    """The points that no other beats in both respects, from few false events to many."""
    kept: list[SweepPoint] = []
    for p in sorted(points, key=lambda p: (p.false_per_min, p.delay_ms)):
        if not kept or p.delay_ms < kept[-1].delay_ms:
            kept.append(p)
    return kept
