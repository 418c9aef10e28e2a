"""Spectral detectors after Holweg et al. 1996: the paper's version and a fairer one.

`psd` (the paper's; accuracy 57.4 % there) sums the standardised taxels first and takes their power
from 1 to 50 Hz over one second. `psd-fair` takes the amplitude of each taxel from 5 to 50 Hz over
the last 0.2 s, like the authors' analysis of vibration.
"""

from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from detector.energy import STEEPNESS
from detector.network_file import check_layout
from drivers.interfaces import KIT_TAXELS

# The published detector, from the authors' configuration
PAPER_WINDOW = 100
MEAN_COUNTS = (-120.24, -59.29, -14.26, -19.77, -55.34, -60.12)
STD_COUNTS = (182.70, 146.50, 80.06, 86.97, 140.52, 143.61)
FAIR_WINDOW = 21  # the authors' own analysis


class PsdSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Threshold of `psd`."""

    threshold_power: Annotated[
        float, Meta(ge=1.0, le=1e6, description="spectral power of a window above which it is slip")
    ] = 11000.0  # the authors' configuration


class PsdFairSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Threshold of `psd-fair`."""

    threshold_counts: Annotated[
        float, Meta(ge=1.0, le=10000.0, description="summed spectral amplitude at probability 0.5")
    ] = 150.0  # assumed: between the authors' recording at rest (59) and slipping (373)


class SampleWindow:
    """Sliding window in an array (fingers, length, taxels); until it is full, the first sample is
    repeated."""

    def __init__(self, samples: NDArray[Any]) -> None:
        self.samples = samples
        self._shape = (samples.shape[0], samples.shape[2])
        self.reset()

    def reset(self) -> None:
        self._started = False

    def add(self, counts: NDArray[np.int16]) -> None:
        if counts.shape != self._shape:
            raise ValueError(f"frame has shape {counts.shape}, not {self._shape}")
        if self._started:
            self.samples[:, :-1] = self.samples[:, 1:]
            self.samples[:, -1] = counts
        else:
            self.samples[:] = counts[:, None, :]
            self._started = True


class PsdDetector:
    """Power of the sum of all taxels over one second, 1-50 Hz."""

    name = "psd"
    threshold = 0.5
    memory = PAPER_WINDOW

    def __init__(self, settings: PsdSettings, fingers: int, taxels: int = KIT_TAXELS) -> None:
        check_layout(self.name, len(MEAN_COUNTS), taxels)
        self.settings = settings
        self._window = SampleWindow(np.zeros((fingers, PAPER_WINDOW, taxels)))
        self.reset = self._window.reset

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take one frame (fingers, taxels); return (fingers,) probabilities."""
        self._window.add(counts)
        common = ((self._window.samples - np.array(MEAN_COUNTS)) / np.array(STD_COUNTS)).sum(axis=2)
        power = np.square(np.abs(np.fft.rfft(common, axis=1)[:, 1:])).sum(axis=1)
        return _probability(power, self.settings.threshold_power)


class PsdFairDetector:
    """Amplitude of every taxel, 5-50 Hz, over the last 0.2 s."""

    name = "psd-fair"
    threshold = 0.5
    memory = FAIR_WINDOW

    def __init__(self, settings: PsdFairSettings, fingers: int, taxels: int = KIT_TAXELS) -> None:
        self.settings = settings
        self._window = SampleWindow(np.zeros((fingers, FAIR_WINDOW, taxels)))
        self.reset = self._window.reset

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take one frame (fingers, taxels); return (fingers,) probabilities."""
        self._window.add(counts)
        spectra = np.abs(np.fft.rfft(self._window.samples, axis=1)[:, 1:])
        amplitude = spectra.sum(axis=(1, 2)) / (FAIR_WINDOW - 1)
        return _probability(amplitude, self.settings.threshold_counts)


def _probability(values: NDArray[np.float64], threshold: float) -> NDArray[np.float64]:
    """Logistic function of the logarithm of the values (n,): 0.5 at the threshold, 0 at 0."""
    odds = (values / threshold) ** STEEPNESS
    probabilities: NDArray[np.float64] = odds / (1.0 + odds)
    return probabilities
