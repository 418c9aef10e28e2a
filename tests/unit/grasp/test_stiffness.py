"""Newtons into counts."""

from hypothesis import given
from hypothesis import strategies as st

from grasp.stiffness import Stiffness


@given(rise_n=st.floats(-20, 60), per_count_n=st.floats(0.1, 8))
def test_counts_are_the_most_that_keep_within_the_rise(rise_n: float, per_count_n: float) -> None:
    counts = Stiffness(per_count_n).counts_within(rise_n)
    assert counts * per_count_n <= max(0.0, rise_n) * (1 + 1e-12)
    assert (counts + 1) * per_count_n > rise_n
