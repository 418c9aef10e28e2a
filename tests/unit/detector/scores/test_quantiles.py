"""Quantiles: nearest rank, and infinite samples."""

import math

import msgspec
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from detector.scores.quantiles import Quantiles, quantile, quantiles


def test_quantiles_are_samples() -> None:
    assert quantiles([3.0, 1.0, 2.0]) == Quantiles(3, 1.0, 2.0, 3.0, 3.0, 3.0)
    assert quantiles(np.arange(1.0, 101.0)) == Quantiles(100, 10.0, 50.0, 90.0, 99.0, 100.0)


def test_missing_sample_is_infinite_and_null_in_json() -> None:
    found = quantiles([1.0, 2.0, 3.0, None])
    assert found is not None
    assert (found.p50, found.p90) == (2.0, math.inf)
    assert msgspec.json.decode(msgspec.json.encode(found))["p90"] is None


def test_a_share_that_is_a_whole_number_of_samples_is_not_rounded_up() -> None:
    for share, count in [(0.1, 30), (0.07, 100), (0.9, 110), (0.99, 300)]:
        assert quantile(range(1, count + 1), share) == round(share * count), (share, count)


@given(st.lists(st.floats(-1e9, 1e9), min_size=1), st.floats(0.0, 1.0))
def test_the_quantile_is_the_least_sample_with_that_share_at_or_below(
    samples: list[float], share: float
) -> None:
    ordered = sorted(samples)
    found = quantile(ordered, share)
    assert found in ordered
    assert sum(sample <= found for sample in ordered) >= share * len(ordered) - 1e-6
    assert sum(sample < found for sample in ordered) <= share * len(ordered)
