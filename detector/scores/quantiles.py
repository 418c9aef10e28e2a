"""Quantiles of raw samples, by one definition for every figure of the project.

A quantile is a sample that occurred: the least with at least that share of the samples at or below
it (nearest rank; NumPy's ``inverted_cdf``). So nothing is interpolated between a number and an
infinite sample, what never came. Standard library alone: the doctor needs it without packages.
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
    """Of so many samples, to a thousandth; infinity (null in JSON): that share never came."""

    count: int
    p10: float
    p50: float
    p90: float
    p99: float
    max: float


def quantiles(samples: Iterable[float | None]) -> Quantiles | None:
    """None of a sample is infinity; None of no samples."""
    ordered = sorted(math.inf if sample is None else float(sample) for sample in samples)
    if not ordered:
        return None
    found = (round(quantile(ordered, share), 3) for share in (0.1, 0.5, 0.9, 0.99, 1.0))
    return Quantiles(len(ordered), *found)


def quantile(ordered: "Sequence[float] | NDArray[np.float64]", share: float) -> float:
    """The sample at that share, over 0 to 1, of at least one sample in ascending order."""
    rank = math.ceil(share * len(ordered) - 1e-9)  # 0.1 x 30 is a little more than 3
    return float(ordered[max(rank, 1) - 1])
