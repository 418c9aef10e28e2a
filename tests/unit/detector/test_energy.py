"""The energy detector: exact streaming, no alarm after a reset."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from detector.energy import EnergyDetector, EnergySettings, probability_of
from detector.loading import DETECTORS, load_detector
from detector.scores.evaluation import stream


def frames(n: int, fingers: int = 3, seed: int = 0, spread: int = 20) -> NDArray[np.int16]:
    rng = np.random.default_rng(seed)
    return rng.integers(-spread, spread + 1, (n, fingers, 6)).astype(np.int16)


def energies(detector: EnergyDetector, counts: NDArray[np.int16]) -> NDArray[np.float64]:
    found = []
    for frame in counts:
        detector.update(frame)
        found.append(detector.energy_counts)
    return np.array(found)


def by_hand(counts: NDArray[np.int16], window: int) -> NDArray[np.float64]:
    """Mean absolute change over taxels and window; missing changes are zero."""
    out = np.zeros(counts.shape[:2])
    for i in range(len(counts)):
        for j in range(max(1, i - window + 1), i + 1):
            out[i] += np.abs(counts[j].astype(int) - counts[j - 1]).sum(axis=1)
    return out / (window * 6)


@given(
    window=st.integers(1, 25), fingers=st.integers(1, 4), n=st.integers(1, 60),
    seed=st.integers(0, 99), spread=st.sampled_from([0, 1, 30, 1023, 32767]),
)  # fmt: skip
def test_streamed_energy_equals_the_formula_exactly(
    window: int, fingers: int, n: int, seed: int, spread: int
) -> None:
    counts = frames(n, fingers, seed, spread)
    detector = EnergyDetector(EnergySettings(window=window), fingers)
    expected = by_hand(counts, window)
    assert np.array_equal(energies(detector, counts), expected)


def test_energy_of_a_long_stream_does_not_drift() -> None:
    counts = frames(30_000, 1, spread=900)
    detector = EnergyDetector(EnergySettings(), 1)
    fresh = EnergyDetector(EnergySettings(), 1)
    assert energies(detector, counts)[-1] == energies(fresh, counts[-11:])[-1]
    for _ in range(10):
        detector.update(counts[-1])
    assert detector.energy_counts == [0.0]


def test_the_probability_is_a_half_exactly_at_the_threshold_and_rises_with_energy() -> None:
    assert probability_of(6.0, 6.0) == 0.5
    rising = [probability_of(e, 6.0) for e in (0.0, 0.1, 3.0, 5.9, 6.1, 20.0, 1000.0)]
    assert rising == sorted(set(rising))
    assert rising[0] == 0.0
    assert rising[3] < 0.5 < rising[4] < rising[-1] <= 1.0


def test_first_frame_after_a_reset_has_no_change() -> None:
    detector = EnergyDetector(EnergySettings(threshold_counts=0.1), 3)
    loaded = np.full((3, 6), -400, np.int16)
    assert not detector.update(loaded).any()
    assert detector.update(np.zeros((3, 6), np.int16)).min() > 0.5
    detector.reset()
    assert not detector.update(loaded).any()


def test_a_frame_of_another_shape_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\(1, 6\), not \(3, 6\)"):
        EnergyDetector(EnergySettings(), 3).update(np.zeros((1, 6), np.int16))


def test_a_detector_is_loaded_by_name_with_settings_or_a_plain_table() -> None:
    assert DETECTORS[0] == "energy"
    counts = frames(20)
    one = load_detector("energy", EnergySettings(threshold_counts=3.0), 3)
    two = load_detector("energy", {"threshold_counts": 3.0}, 3)
    assert one.name == "energy"
    assert one.threshold == 0.5
    assert np.array_equal(stream(one, counts)[0], stream(two, counts)[0])
