"""`forte`: the band's level in decibels, and slip where it rises."""

import numpy as np
import pytest
from numpy.typing import NDArray

from detector.forte import ForteDetector, ForteSettings
from detector.interface import load_detector
from detector.scores.evaluation import stream
from tests.unit.detector.networks import walk

SOFT = ForteSettings(steepness=1.0)  # odds are the rise over its threshold


def shaken(amplitudes: NDArray[np.float64], hz: float, fingers: int = 1) -> NDArray[np.int16]:
    """One taxel of the first finger swings with these amplitudes (n,), counts."""
    t_s = np.arange(len(amplitudes)) * 0.01
    counts = np.zeros((len(amplitudes), fingers, 6), np.int16)
    counts[:, 0, 2] = np.rint(amplitudes * np.sin(2 * np.pi * hz * t_s))
    return counts


def heard(counts: NDArray[np.int16], settings: ForteSettings = SOFT) -> NDArray[np.float64]:
    return stream(ForteDetector(settings, counts.shape[1]), counts)[0]


def burst(hz: float) -> NDArray[np.int16]:
    return shaken(np.where(np.arange(120) < 60, 0.0, 200.0), hz)


def test_a_vibration_that_begins_is_heard_at_once_and_one_that_goes_on_no_more() -> None:
    p = heard(burst(20.0))[:, 0]
    assert p[:60].max() == 0.0
    assert p[60:66].max() > 0.7
    assert p[-1] == 0.0  # steady: its level rises no more, and the rise is forgotten


def test_the_probability_is_the_variance_of_levels_that_rise() -> None:
    counts = walk(90, fingers=1)
    taper = np.hanning(22)[1:-1]
    levels = []
    for end in range(20, 91):
        window = counts[end - 20 : end, 0].astype(float)
        swing = (window - window.mean(axis=0)) * taper[:, None]
        n = np.arange(20)
        power = [
            abs((swing * np.exp(-2j * np.pi * hz * n / 100)[:, None]).sum(axis=0)) ** 2
            for hz in range(10, 51, 5)
        ]
        levels.append(10 * np.log10(np.max(power, axis=0) / (taper**2).sum() + 1.0))
    threes = [np.array(levels[i : i + 3]) for i in range(len(levels) - 2)]
    rises = [
        np.where((np.diff(three, axis=0) > 0.1).all(axis=0), three.var(axis=0), 0.0).mean()
        for three in threes
    ]
    odds = max(rises[-20:]) / 2.0
    assert heard(counts)[-1, 0] == pytest.approx(odds / (1 + odds))


def test_a_finger_that_rests_says_nothing_while_another_is_shaken() -> None:
    counts = shaken(np.where(np.arange(120) < 60, 0.0, 200.0), 20.0, fingers=3)
    p = heard(counts)
    assert p[:, 0].max() > 0.7
    assert p[:, 1:].max() == 0.0


def test_a_reset_forgets() -> None:
    detector = load_detector("forte", {}, 3)
    first = stream(detector, walk(130))[0]
    stream(detector, walk(40, seed=3))
    assert np.array_equal(stream(detector, walk(130))[0], first)
    with pytest.raises(ValueError, match="frame has shape"):
        detector.update(np.zeros((2, 6), np.int16))
