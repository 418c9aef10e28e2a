"""Numbers in a page are those that went in."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from scenarios.report.run_page import Column, pack
from tests.unit.scenarios.report.conftest import unpacked

NUMBERS = st.floats(-1e6, 1e6) | st.just(float("nan"))


@given(arrays(np.float64, (7, 3), elements=NUMBERS))
def test_what_is_packed_comes_back_to_the_nearest_step(values: np.ndarray) -> None:
    columns = unpacked(pack({"one": Column(values, 0.01), "other": Column(values[:, 0], 0.5)}))
    np.testing.assert_allclose(columns["one"], values, atol=0.005001)
    np.testing.assert_allclose(columns["other"][:, 0], values[:, 0], atol=0.25001)
