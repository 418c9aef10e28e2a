"""Quantiles of samples, with one definition for all results.

A quantile is the smallest sample with at least that share of the samples at or below it (nearest
rank; NumPy's ``inverted_cdf``). Nothing is interpolated, so samples may be infinite (never
happened). This module needs the standard library only, for `grasp doctor`.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Quantiles:
    """Quantiles, rounded to a thousandth; infinity (null in JSON): that share never happened."""

    count: int
    p10: float
    p50: float
    p90: float
    p99: float
    max: float


def quantiles(samples: Iterable[float | None]) -> Quantiles | None:
    """Quantiles of the samples, where None counts as infinity; None without samples."""
    ordered = sorted([math.inf if sample is None else float(sample) for sample in samples])
    if not ordered:
        return None
    values = (round(quantile(ordered, share), 3) for share in (0.1, 0.5, 0.9, 0.99, 1.0))
    return Quantiles(len(ordered), *values)


def quantile(ordered: "Sequence[float] | NDArray[np.float64]", share: float) -> float:
    """Quantile at a share above 0, up to 1, of samples in ascending order (at least one)."""
    rank = math.ceil(share * len(ordered) - 1e-9)  # in floating point 0.1 x 30 exceeds 3
    return float(ordered[max(rank, 1) - 1])
