"""A series of taps in figures: successes among those that moved the object, and the rest apart."""

from collections import Counter
from collections.abc import Iterable, Sequence

import msgspec

from detector.scores.quantiles import Quantiles, quantiles
from scenarios.tap.result import TapResult
from scenarios.tap.scoring import TapOutcome


class TapCount(msgspec.Struct, frozen=True):
    """Taps of one direction, or of all. ``moved`` is what a success rate is out of."""

    struck: int
    moved: int
    successes: int
    unmoved: int
    false_alarms: int  # registered although nothing moved


class TapSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Of one series; of the taps that moved it, one that was not registered, or not nominal again,
    counts as infinitely late."""

    total: TapCount
    by_direction: dict[str, TapCount]
    outcomes: dict[str, int]
    slip_duration_ms: Quantiles | None
    detection_latency_ms: Quantiles | None
    nominal_again_ms: Quantiles | None


def summarise(results: Sequence[TapResult]) -> TapSummary:
    """Figures of a series; a tap that was never struck counts in ``outcomes`` alone."""
    directions = sorted({r.direction for r in results}, reverse=True)
    return TapSummary(
        total=count(results),
        by_direction={d: count(r for r in results if r.direction == d) for d in directions},
        outcomes=dict(Counter(r.outcome for r in results).most_common()),
        slip_duration_ms=_known(r.slip_duration_ms for r in results if r.moved),
        detection_latency_ms=quantiles(r.detection_latency_ms for r in results if r.moved),
        nominal_again_ms=quantiles(r.nominal_again_ms for r in results if r.moved),
    )


def count(results: Iterable[TapResult]) -> TapCount:
    """Taps by what they did."""
    struck = [r for r in results if r.moved is not None]
    moved = [r for r in struck if r.moved]
    return TapCount(
        struck=len(struck),
        moved=len(moved),
        successes=sum(bool(r.success) for r in moved),
        unmoved=len(struck) - len(moved),
        false_alarms=sum(r.outcome == TapOutcome.UNMOVED_REGISTERED for r in struck),
    )


def _known(values: Iterable[float | None]) -> Quantiles | None:
    """Of those that anybody could tell."""
    return quantiles(value for value in values if value is not None)
