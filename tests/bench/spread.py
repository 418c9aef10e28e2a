"""What benches tell of delays: what could have come and never did is infinitely late."""

from collections.abc import Iterable, Sequence

from detector.scores.quantiles import quantiles
from scenarios.lift.scoring import LiftResult

THREE = "p50 / p90 / p99"


def three(values: Iterable[float | None], digits: int = 0) -> str:
    """At p50 / p90 / p99; None of a value: it never came, `inf` so many."""
    q = quantiles(values)
    return "-" if q is None else " / ".join(f"{v:.{digits}f}" for v in (q.p50, q.p90, q.p99))


def slipped(results: Iterable[LiftResult]) -> list[LiftResult]:
    """Those lifts whose slip can be heard or missed: where nothing slid nothing is late."""
    return [r for r in results if r.slip_onset_s is not None]


def slid_mm(results: Sequence[LiftResult]) -> list[float]:
    """How far each object slid; the world knows it of every lift that has an end."""
    return [1e3 * r.slip_distance_m for r in results if r.slip_distance_m is not None]
