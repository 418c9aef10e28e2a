"""The energy detector: a plain formula, streamed exactly, silent when young, cheap to tune."""

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from detector.energy import (
    EnergyDetector,
    EnergySettings,
    energy_series,
    probability_of,
)
from detector.interface import DETECTORS, load_detector
from detector.scores.evaluation import stream
from drivers.errors import UsageError


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
    """Mean absolute change over taxels and window, absent changes being zero."""
    out = np.zeros(counts.shape[:2])
    for i in range(len(counts)):
        for j in range(max(1, i - window + 1), i + 1):
            out[i] += np.abs(counts[j].astype(int) - counts[j - 1]).sum(axis=1)
    return out / (window * 6)


@given(
    window=st.integers(1, 25), fingers=st.integers(1, 4), n=st.integers(1, 60),
    seed=st.integers(0, 99), spread=st.sampled_from([0, 1, 30, 1023, 32767]),
)  # fmt: skip
def test_the_stream_equals_the_plain_formula_exactly(
    window: int, fingers: int, n: int, seed: int, spread: int
) -> None:
    counts = frames(n, fingers, seed, spread)
    detector = EnergyDetector(EnergySettings(window=window), fingers)
    expected = by_hand(counts, window)
    assert np.array_equal(energies(detector, counts), expected)
    assert np.array_equal(energy_series(counts, window), expected)


def test_a_long_stream_does_not_drift() -> None:
    counts = frames(30_000, 1, spread=900)
    detector = EnergyDetector(EnergySettings(), 1)
    assert np.array_equal(energies(detector, counts), energy_series(counts, 10))
    for _ in range(10):
        detector.update(counts[-1])
    assert detector.energy_counts == [0.0]


def test_the_probability_is_a_half_exactly_at_the_threshold_and_rises_with_energy() -> None:
    settings = EnergySettings(threshold_counts=6.0)
    assert probability_of(6.0, settings) == 0.5
    rising = [probability_of(e, settings) for e in (0.0, 0.1, 3.0, 5.9, 6.1, 20.0, 1000.0)]
    assert rising == sorted(set(rising))
    assert rising[0] == 0.0
    assert rising[3] < 0.5 < rising[4] < rising[-1] <= 1.0


def test_steepness_is_log_odds_per_e_fold() -> None:
    p = probability_of(6.0 * np.e, EnergySettings(threshold_counts=6.0, steepness=3.0))
    assert np.log(p / (1.0 - p)) == pytest.approx(3.0)


def test_the_first_frame_after_a_reset_is_no_change_however_loaded_it_is() -> None:
    detector = EnergyDetector(EnergySettings(threshold_counts=0.1), 3)
    loaded = np.full((3, 6), -400, np.int16)
    assert not detector.update(loaded).any()
    assert detector.update(np.zeros((3, 6), np.int16)).min() > 0.5
    detector.reset()
    assert not detector.update(loaded).any()


def test_while_warming_up_the_energy_is_never_above_that_of_a_full_window() -> None:
    counts = np.zeros((40, 1, 6), np.int16)
    counts[::2] = 7  # a change of 7 at every sample
    found = energies(EnergyDetector(EnergySettings(window=10), 1), counts)[:, 0]
    assert found[:11] == pytest.approx(np.arange(11) * 0.7)
    assert (found[10:] == 7.0).all()


def test_a_reset_detector_is_as_good_as_new() -> None:
    used = EnergyDetector(EnergySettings(), 3)
    stream(used, frames(50, seed=1))
    counts = frames(50, seed=2)
    again, _ = stream(used, counts)  # resets
    new, _ = stream(EnergyDetector(EnergySettings(), 3), counts)
    assert np.array_equal(again, new)


def test_a_missed_sample_that_repeats_the_last_frame_is_a_change_of_zero() -> None:
    counts = frames(30)
    repeated = np.insert(counts, 20, counts[19], axis=0)
    with_gap = energies(EnergyDetector(EnergySettings(), 3), repeated)
    without = energies(EnergyDetector(EnergySettings(), 3), counts)
    assert np.array_equal(with_gap[:20], without[:20])
    oldest = np.abs(np.diff(counts.astype(int), axis=0)).sum(axis=2)[9] / 60.0
    assert with_gap[20] == pytest.approx(without[19] - oldest)


def test_fingers_do_not_hear_each_other() -> None:
    counts = frames(30)
    quiet = counts.copy()
    quiet[:, 1] = 0
    loud, _ = stream(EnergyDetector(EnergySettings(), 3), counts)
    found, _ = stream(EnergyDetector(EnergySettings(), 3), quiet)
    assert not found[:, 1].any()
    assert np.array_equal(found[:, [0, 2]], loud[:, [0, 2]])


def test_what_update_returned_does_not_change_later() -> None:
    detector = EnergyDetector(EnergySettings(), 3)
    counts = frames(3)
    detector.update(counts[0])
    kept = detector.update(counts[1])
    copy = kept.copy()
    detector.update(counts[2])
    assert np.array_equal(kept, copy)


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


def test_an_unknown_detector_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UsageError, match="unknown detector 'tcm'"):
        load_detector("tcm", {}, 3)


@pytest.mark.parametrize("table", [{"window": 0}, {"threshold_counts": 0.0}, {"windw": 3}])
def test_settings_out_of_range_or_unknown_are_refused(table: dict[str, float]) -> None:
    with pytest.raises(msgspec.ValidationError):
        load_detector("energy", table, 3)
