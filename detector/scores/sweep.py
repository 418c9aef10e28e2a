"""How soon against how often wrongly: rules and thresholds swept over what a detector said.

A detector's curve is the least delay for each rate of false events (AMOC, Fawcett and Provost
1999). Impacts are judged apart: what answers one is neither a slip nor false.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

import msgspec
import numpy as np

from detector.decision import RuleSettings, events_of, fused
from detector.scores.evaluation import Judged, Streamed, hand_rate, score_impacts, scored
from detector.scores.impacts import MOVED_M, ImpactScore
from detector.scores.metrics import Floats
from detector.scores.quantiles import quantile

LOG_ODDS = np.linspace(-2.0, 7.0, 28)  # thresholds tried
LIMITS = np.geomspace(0.5, 100.0, 14)  # of summed log-odds
CONSECUTIVE = (1, 2, 3, 5, 8)
DRIFTS = (0.0, 2.0)
FUSIONS: tuple[Literal["any", "mean"], ...] = ("any", "mean")
RELEASES = (3, 8)  # a pad that settles after a slip is no new one
BETWEEN = 3  # thresholds tried between two at the budget
MISS_MS = 500.0  # what a miss counts, and the most that any delay does
MOST_FALSE_IMPACTS = 0.05  # of those that move nothing, weak ones apart


class SweepPoint(msgspec.Struct, frozen=True):
    """What one rule makes of a detector."""

    rule: RuleSettings
    false_per_min: float  # over three fingers
    delay_ms: float  # median, as the others of all slips; infinite: so many are missed
    p90_delay_ms: float
    p99_delay_ms: float
    recall: float
    mean_delay_ms: float  # none longer than MISS_MS; slips and impacts that moved 1 mm, half each
    impacts: ImpactScore | None

    @property
    def false_impacts(self) -> float:
        """Share of the impacts that nearly moved it and were registered all the same."""
        if self.impacts is None or not self.impacts.nearly:
            return 0.0
        return self.impacts.nearly_registered / self.impacts.nearly


def rules(base: RuleSettings) -> Iterator[RuleSettings]:
    """Every rule tried, of both kinds and both fusions."""
    for fusion, release in itertools.product(FUSIONS, RELEASES):
        shared = msgspec.structs.replace(base, fusion=fusion, release=release)
        for k, odds in itertools.product(CONSECUTIVE, LOG_ODDS):
            yield msgspec.structs.replace(
                shared, kind="consecutive", consecutive=k, threshold=_logistic(float(odds))
            )
        for drift, limit in itertools.product(DRIFTS, LIMITS):
            yield msgspec.structs.replace(
                shared, kind="cusum", drift=drift, limit=float(limit), threshold=_logistic(drift)
            )


def _logistic(odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-odds))


def point(
    streams: Sequence[Streamed], rule: RuleSettings, judged: Sequence[Judged]
) -> SweepPoint | None:
    """Score one rule by what became of the streams; None for data without slip or rest."""
    events = [j.events for j in judged]
    delays: Floats = np.sort(np.concatenate([j.delays_ms for j in events]))
    rate = hand_rate(streams, events)
    if rate is None or not len(delays):
        return None
    p50, p90, p99 = (quantile(delays, share) for share in (0.5, 0.9, 0.99))
    recall = float(np.isfinite(delays).mean())
    return SweepPoint(rule, rate, p50, p90, p99, recall, _cost_ms(judged), score_impacts(judged))


def _cost_ms(judged: Sequence[Judged]) -> float:
    """Mean delay, slips and impacts half each; a slip detected early counts as no delay."""
    slips = np.concatenate([j.events.delays_ms for j in judged])
    answered = np.concatenate([j.answers_ms for j in judged])
    impacts = answered[np.concatenate([j.moved_m for j in judged]) >= MOVED_M]
    each = (np.maximum(slips, 0.0), impacts)
    return float(np.mean([np.minimum(d, MISS_MS).mean() for d in each if len(d)]))


def sweep(streams: Sequence[Streamed], tried: Iterable[RuleSettings]) -> list[SweepPoint]:
    """A point for every rule, in their order; rules of one fusion follow one another best."""
    every = [scored(s, apart=True) for s in streams]
    found = []
    fusion = ""
    for rule in tried:
        if rule.fusion != fusion:
            fusion, decide = rule.fusion, [fused(s.probabilities, rule) for s in streams]
        judged = [s.judged(events_of(p, rule)) for s, p in zip(every, decide, strict=True)]
        found.append(point(streams, rule, judged))
    return [p for p in found if p is not None]


def best(points: Iterable[SweepPoint], budget_per_min: float) -> SweepPoint | None:
    """The quickest on average that is `allowed`; None if none is."""
    kept = [p for p in points if allowed(p, budget_per_min)]
    return min(kept, key=lambda p: (p.mean_delay_ms, p.false_per_min), default=None)


def allowed(p: SweepPoint, budget_per_min: float) -> bool:
    """Whether a point keeps to the budget, and answers hardly an impact that moves nothing."""
    return p.false_per_min <= budget_per_min and p.false_impacts <= MOST_FALSE_IMPACTS


def at_the_budget(points: Iterable[SweepPoint], budget_per_min: float) -> list[RuleSettings]:
    """Thresholds between the least that is allowed and the next below it, of every rule of
    consecutive samples."""

    def family(p: SweepPoint) -> tuple[str, int, int]:
        return (p.rule.fusion, p.rule.release, p.rule.consecutive)

    found = []
    consecutive = [p for p in points if p.rule.kind == "consecutive"]
    consecutive.sort(key=lambda p: (*family(p), p.rule.threshold))
    for _, alike in itertools.groupby(consecutive, key=family):
        for below, above in itertools.pairwise(alike):
            if not allowed(below, budget_per_min) and allowed(above, budget_per_min):
                odds_of = (p.rule.threshold / (1.0 - p.rule.threshold) for p in (below, above))
                low, high = map(math.log, odds_of)
                found += [
                    msgspec.structs.replace(above.rule, threshold=_logistic(float(odds)))
                    for odds in np.linspace(low, high, BETWEEN + 2)[1:-1]
                ]
                break
    return found


def frontier(points: Iterable[SweepPoint]) -> list[SweepPoint]:
    """The points that no other beats in both respects, from few false events to many."""
    kept: list[SweepPoint] = []
    for p in sorted(points, key=lambda p: (p.false_per_min, p.delay_ms)):
        if not kept or p.delay_ms < kept[-1].delay_ms:
            kept.append(p)
    return kept
