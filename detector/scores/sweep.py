"""Sweep of decision rules and thresholds over a detector's output: delay against false alarms.

A detector's curve is the least delay for each rate of false alarms (AMOC, Fawcett and Provost
1999). Impacts are scored separately: an event in the time of an impact is neither a slip nor false.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

import msgspec
import numpy as np

from detector.decision import RuleSettings, events_of, fused
from detector.recordings import MOVED_M
from detector.scores import evaluation
from detector.scores.evaluation import RecordingScore, Streamed, score_impacts
from detector.scores.events import all_delays_ms, false_rate, recall
from detector.scores.impacts import ImpactScore
from detector.scores.quantiles import quantile

LOG_ODDS = np.linspace(-2.0, 7.0, 28)  # thresholds of the sweep
LIMITS = np.geomspace(0.5, 100.0, 14)  # of summed log-odds
CONSECUTIVE = (1, 2, 3, 5, 8)
DRIFTS = (0.0, 2.0)
FUSIONS: tuple[Literal["any", "mean"], ...] = ("any", "mean")
RELEASES = (3, 8)  # the longer one keeps a pad that settles after a slip from being a new event
BETWEEN = 3  # additional thresholds between two neighbours
MISS_MS = 500.0  # delay of a miss in the mean, and upper bound of any delay
MAX_FALSE_IMPACTS = 0.05  # registered share of impacts that move nothing, without weak ones


class SweepPoint(msgspec.Struct, frozen=True):
    """Scores of a detector with one rule."""

    rule: RuleSettings
    false_per_min: float  # of a hand of three fingers
    delay_ms: float  # median over all slips; infinite if half are missed
    p90_delay_ms: float
    p99_delay_ms: float
    recall: float
    mean_delay_ms: float  # at most MISS_MS each; slips and impacts that moved 1 mm, half each
    impacts: ImpactScore | None

    @property
    def false_impacts(self) -> float:
        """Registered share of the impacts that moved nothing, without weak ones."""
        if self.impacts is None or not self.impacts.unmoved_strong:
            return 0.0
        return self.impacts.unmoved_strong_registered / self.impacts.unmoved_strong


def rules(base: RuleSettings) -> Iterator[RuleSettings]:
    """All rules of the sweep: counts, beside the sum of a base of kind ``either``, and sums."""
    counts: Literal["consecutive", "either"] = "either" if base.kind == "either" else "consecutive"
    for fusion, release in itertools.product(FUSIONS, RELEASES):
        shared = msgspec.structs.replace(base, fusion=fusion, release=release)
        for k, odds in itertools.product(CONSECUTIVE, LOG_ODDS):
            yield msgspec.structs.replace(
                shared, kind=counts, consecutive=k, threshold=_logistic(float(odds))
            )
        for drift, limit in itertools.product(DRIFTS, LIMITS):
            yield msgspec.structs.replace(
                shared, kind="cusum", drift=drift, limit=float(limit), threshold=_logistic(drift)
            )


def _logistic(odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-odds))


def sweep_point(rule: RuleSettings, scores: Sequence[RecordingScore]) -> SweepPoint | None:
    """Point of one rule from its scores; None for data without slip or rest."""
    events = [s.events for s in scores]
    delays, rate, caught = np.sort(all_delays_ms(events)), false_rate(events), recall(events)
    if rate is None or caught is None:
        return None
    p50, p90, p99 = (quantile(delays, share) for share in (0.5, 0.9, 0.99))
    mean_ms, impacts = _mean_delay_ms(scores), score_impacts(scores)
    return SweepPoint(rule, rate, p50, p90, p99, caught, mean_ms, impacts)


def _mean_delay_ms(scores: Sequence[RecordingScore]) -> float:
    """Mean delay, slips and impacts half each; a slip detected early has delay 0."""
    slips = np.concatenate([s.events.delays_ms for s in scores])
    delays_ms = np.concatenate([s.impact_delays_ms for s in scores])
    impacts = delays_ms[np.concatenate([s.moved_m for s in scores]) >= MOVED_M]
    each = (np.maximum(slips, 0.0), impacts)
    return float(np.mean([np.minimum(d, MISS_MS).mean() for d in each if len(d)]))


def sweep(streams: Sequence[Streamed], candidates: Iterable[RuleSettings]) -> list[SweepPoint]:
    """A point for every rule, in order. Faster if rules of one fusion follow one another."""
    references = [evaluation.scoring_reference(s, exclude_impacts=True) for s in streams]
    points = []
    fusion = ""
    for rule in candidates:
        if rule.fusion != fusion:
            fusion, decide = rule.fusion, [fused(s.probabilities, rule) for s in streams]
        scores = [r.score(events_of(p, rule)) for r, p in zip(references, decide, strict=True)]
        points.append(sweep_point(rule, scores))
    return [p for p in points if p is not None]


def best(points: Iterable[SweepPoint], budget_per_min: float) -> SweepPoint | None:
    """Point with the least mean delay that is `within_budget`; None if none is."""
    kept = [p for p in points if within_budget(p, budget_per_min)]
    return min(kept, key=lambda p: (p.mean_delay_ms, p.false_per_min), default=None)


def within_budget(p: SweepPoint, budget_per_min: float) -> bool:
    """Whether a point is within the budget of false alarms and MAX_FALSE_IMPACTS."""
    return p.false_per_min <= budget_per_min and p.false_impacts <= MAX_FALSE_IMPACTS


def thresholds_at_budget(points: Iterable[SweepPoint], budget_per_min: float) -> list[RuleSettings]:
    """Rules `consecutive` with thresholds just below the lowest one within the budget."""

    def family(p: SweepPoint) -> tuple[str, int, int]:
        return (p.rule.fusion, p.rule.release, p.rule.consecutive)

    refined = []
    consecutive = [p for p in points if p.rule.kind != "cusum"]
    consecutive.sort(key=lambda p: (*family(p), p.rule.threshold))
    for _, group in itertools.groupby(consecutive, key=family):
        for below, above in itertools.pairwise(group):
            if not within_budget(below, budget_per_min) and within_budget(above, budget_per_min):
                odds_of = (p.rule.threshold / (1.0 - p.rule.threshold) for p in (below, above))
                low, high = map(math.log, odds_of)
                refined += [
                    msgspec.structs.replace(above.rule, threshold=_logistic(float(odds)))
                    for odds in np.linspace(low, high, BETWEEN + 2)[1:-1]
                ]
                break
    return refined
