"""Spectral detectors, compared with their definitions."""

import numpy as np
import pytest

from detector.loading import load_detector
from detector.psd import (
    MEAN_COUNTS,
    STD_COUNTS,
    PsdDetector,
    PsdFairDetector,
    PsdFairSettings,
    PsdSettings,
)
from detector.scores.evaluation import stream
from tests.unit.detector.network_files import walk


def test_the_published_power_is_summed_over_taxels_first_and_from_1_to_50_hz() -> None:
    counts = walk(160)
    p = stream(PsdDetector(PsdSettings(), 3), counts)[0]
    standard = (counts[60:160].astype(float) - MEAN_COUNTS) / STD_COUNTS
    common = standard.sum(axis=2)
    n = np.arange(100)
    power = [
        sum(
            abs((common[:, f] * np.exp(-2j * np.pi * k * n / 100)).sum()) ** 2 for k in range(1, 51)
        )
        for f in range(3)
    ]
    odds = (np.array(power) / 11000.0) ** 4
    assert np.allclose(p[-1], odds / (1 + odds))


def test_psd_misses_opposite_changes_of_taxels_and_psd_fair_does_not() -> None:
    counts = np.zeros((150, 1, 6), np.int16)
    counts[::2, 0, 0], counts[::2, 0, 1] = 1827, -1465  # ten standard deviations each
    assert stream(PsdDetector(PsdSettings(), 1), counts)[0].max() < 1e-6
    assert stream(PsdFairDetector(PsdFairSettings(), 1), counts)[0][-1, 0] > 0.99


def test_sine_of_known_amplitude_has_the_amplitude_of_the_authors_analysis() -> None:
    """|FFT| of a sine at a bin of the window is half its amplitude times the window's length."""
    t = np.arange(63)
    counts = np.zeros((63, 1, 6), np.int16)
    counts[:, 0, 2] = np.round(400 * np.sin(2 * np.pi * 4 * t / 21))
    settings = PsdFairSettings(threshold_counts=400 * 21 / 2 / 20)
    assert stream(PsdFairDetector(settings, 1), counts)[0][-1, 0] == pytest.approx(0.5, abs=0.02)


def test_reset_clears_all_state() -> None:
    for name in ["psd", "psd-fair"]:
        detector = load_detector(name, {}, 3)
        first = stream(detector, walk(130))[0]
        stream(detector, walk(40, seed=3))
        assert np.array_equal(stream(detector, walk(130))[0], first), name
