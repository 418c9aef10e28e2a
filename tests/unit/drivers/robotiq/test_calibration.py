"""Force and speed of a byte by a calibration."""

import hypothesis.strategies as st
import pytest
from hypothesis import given

from drivers.errors import Refused
from drivers.robotiq.calibration import GripperCalibration
from tests.calibrations import MANUAL, PAPER

calibrations = st.builds(
    GripperCalibration,
    name=st.just("any"),
    source=st.just("measured"),
    least_force_n=st.floats(1, 14),
    most_force_n=st.floats(15, 80),
    force_exponent=st.floats(0.3, 3),
)


@given(calibrations, st.floats(0.5, 100))
def test_byte_at_most_is_the_largest_byte_within_the_force(
    calibration: GripperCalibration, cap: float
) -> None:
    if cap < calibration.least_force_n:
        with pytest.raises(Refused):
            calibration.byte_at_most(cap)
        return
    chosen = calibration.byte_at_most(cap)
    assert calibration.force_n(chosen) <= cap
    assert chosen == 255 or calibration.force_n(chosen + 1) > cap


def test_ten_newtons_are_byte_zero_of_the_paper_and_impossible_for_the_manual() -> None:
    assert PAPER.byte_at_most(10.0) == 0
    with pytest.raises(Refused) as refusal:
        MANUAL.byte_at_most(10.0)
    assert "15 N" in refusal.value.message
    assert MANUAL.name in refusal.value.message and MANUAL.source in refusal.value.message
    assert "limit" in refusal.value.remedy


def test_an_invalid_force_is_refused() -> None:
    for force in [float("nan"), float("inf"), -1.0, 0.0]:
        with pytest.raises(Refused):
            PAPER.byte_at_most(force)


@given(st.integers(0, 255))
def test_speed_bytes_survive_a_round_trip(value: int) -> None:
    assert PAPER.speed_byte_at_most(PAPER.speed_mps(value)) == value


def test_speed_bytes_span_22_to_110_mm_per_second() -> None:
    assert PAPER.speed_mps(0) == 0.022
    assert PAPER.speed_mps(255) == pytest.approx(0.110, abs=1e-4)
    assert PAPER.speed_byte_at_most(1.0) == 255
    assert PAPER.speed_byte_at_most(0.001) == 0
    with pytest.raises(Refused):
        PAPER.speed_byte_at_most(0.0)
