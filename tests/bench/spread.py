"""Quantiles of delays for benchmarks; an event that did not happen has an infinite delay."""

from collections.abc import Iterable, Sequence

from detector.scores.quantiles import quantiles
from scenarios.lift.scoring import LiftResult

THREE = "p50 / p90 / p99"


def three(values: Iterable[float | None], digits: int = 0) -> str:
    """The quantiles p50 / p90 / p99 as text; a value of None counts as infinite."""
    q = quantiles(values)
    return "-" if q is None else " / ".join(f"{v:.{digits}f}" for v in (q.p50, q.p90, q.p99))


def slipped(results: Iterable[LiftResult]) -> list[LiftResult]:
    """The lifts in which the object slipped."""
    return [r for r in results if r.slip_onset_s is not None]


def slid_mm(results: Sequence[LiftResult]) -> list[float]:
    """True slip distance of each lift, mm."""
    return [1e3 * r.slip_distance_m for r in results if r.slip_distance_m is not None]
