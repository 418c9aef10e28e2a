"""The figures that real, simulated and stored signals are compared by, on signals made by hand."""

import numpy as np
import pytest
from numpy.typing import NDArray

from scenarios.acquire.signal_statistics import FFT_HZ, signal_statistics

N = 400
T = np.arange(N) * 0.01
SLIP = (np.arange(N) // 80) % 2 == 1


def figures(counts: NDArray[np.float64], slip: NDArray[np.bool_] = SLIP) -> dict[str, float]:
    return signal_statistics(T, np.rint(counts).astype(np.int16), slip)


def noise(scale: float, seed: int = 0) -> NDArray[np.float64]:
    return scale * np.random.default_rng(seed).standard_normal((N, 6))


def test_loud_strokes_between_quiet_pauses_are_told_apart_but_for_the_edges() -> None:
    out = figures(noise(1.0) + noise(30.0, 1) * SLIP[:, None])
    assert out["AUC of energy"] > 0.93
    assert out["AUC over 200 ms"] == 1.0
    assert out["AUC 0-50 ms"] < out["AUC over 200 ms"]
    assert out["increment ratio"] > 10


def test_signal_that_ignores_the_label_has_no_contrast() -> None:
    out = figures(noise(5.0))
    assert out["AUC of energy"] == pytest.approx(0.5, abs=0.2)
    assert out["increment ratio"] == pytest.approx(1.0, abs=0.2)


def test_common_motion_of_taxels_shows_as_correlation() -> None:
    common = noise(20.0)[:, :1].repeat(6, axis=1)
    assert figures(common)["correlation static"] == pytest.approx(1.0, abs=0.01)
    assert abs(figures(noise(20.0))["correlation slip"]) < 0.15


def test_sine_appears_in_its_own_bin_with_half_its_amplitude() -> None:
    sine = 40.0 * np.sin(2 * np.pi * 5 * 100 / 21 * T)[:, None].repeat(6, axis=1)
    out = figures(sine)
    spectrum = [out[f"{f} Hz static"] for f in FFT_HZ]
    assert int(np.argmax(spectrum)) == 4
    assert spectrum[4] == pytest.approx(40.0 * 21 / 20 / 2, rel=0.02)


def test_plateaus_far_below_rest_are_saturation_and_quiet_rest_is_not() -> None:
    counts = noise(10.0)
    counts[100:110, 2] = -421
    assert figures(counts)["share saturated"] == pytest.approx(8 / (N - 2))
    assert figures(np.zeros((N, 6)))["share saturated"] == 0.0


def test_creep_is_the_rise_of_the_pressed_taxel_after_a_stop() -> None:
    counts = np.full((N, 6), -200.0) + np.where(SLIP, 0.0, 70.0 * (T % 0.8))[:, None]
    assert figures(counts)["creep after a stop per s"] == pytest.approx(70.0, rel=0.05)


def test_idle_noise_is_that_of_the_quietest_taxel() -> None:
    counts = noise(20.0)
    counts[:, 4] /= 20.0
    assert figures(counts)["idle noise"] == pytest.approx(np.sqrt(1 + 1 / 12), rel=0.15)


def test_recording_without_slip_has_no_contrast_and_no_figures_of_slip() -> None:
    out = figures(noise(5.0), np.zeros(N, bool))
    assert np.isnan(out["AUC of energy"])
    assert np.isnan(out["5 Hz slip"])
    assert np.isfinite(out["5 Hz static"])
