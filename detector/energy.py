"""The one-number detector that every network has to beat: how much do the taxels change?

A fingertip that slides is shaken at every frequency that 100 Hz can show, a fingertip at rest is
not (Grover, Nadeau, Grebe and Kelly 2022 published a recording of both). So the energy of a finger
is the mean absolute change from frame to frame, over its taxels and a short window, in counts.
"""

from operator import sub
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from drivers.interfaces import KIT_TAXELS

SAMPLES_PER_MIN = 6000  # 100 Hz, the board's rate in the paper
STEEPNESS = 4.0  # log-odds gained per e-fold of a formula's figure; assumed


class EnergySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How long the detector looks, and which change reads as slip."""

    window: Annotated[
        int, Meta(ge=1, le=100, description="changes averaged, samples of 10 ms; assumed")
    ] = 10
    threshold_counts: Annotated[
        float, Meta(ge=0.1, le=500.0, description="energy of probability 0.5, counts per sample")
    ] = 6.0  # assumed: twice that of three loaded taxels of six at rest


class EnergyDetector:
    """Mean absolute change as a probability.

    After a reset the first frame has no change, and until the window is full the changes still to
    come count as zero: slip may be found up to a window late, and a reset never raises an alarm. A
    repeated frame (a missed sample) is a change of zero like any other.
    """

    name = "energy"
    threshold = 0.5

    def __init__(self, settings: EnergySettings, fingers: int, taxels: int = KIT_TAXELS) -> None:
        self.settings = settings
        self.fingers = fingers
        self.memory = settings.window + 1  # samples that its changes are made of
        self._shape = (fingers, taxels)
        self._per_energy = settings.window * taxels
        self.reset()

    def reset(self) -> None:
        self._last: list[list[int]] | None = None
        self._ring = [[0] * self.fingers for _ in range(self.settings.window)]
        self._at = 0
        self._sums = [0] * self.fingers  # whole counts: a running sum without drift

    @property
    def energy_counts(self) -> list[float]:
        """Energy of each finger after the latest frame, counts per sample."""
        return [total / self._per_energy for total in self._sums]

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take one frame (fingers, taxels); give (fingers,) probabilities."""
        if counts.shape != self._shape:
            raise ValueError(f"frame has shape {counts.shape}, not {self._shape}")
        # for 18 numbers plain integers are quicker than arrays, and they cannot overflow
        frame: list[list[int]] = counts.tolist()
        last = self._last or frame
        new = [sum(map(abs, map(sub, a, b))) for a, b in zip(frame, last, strict=True)]
        old = self._ring[self._at]
        self._sums = [s + n - o for s, n, o in zip(self._sums, new, old, strict=True)]
        self._ring[self._at] = new
        self._at = (self._at + 1) % self.settings.window
        self._last = frame
        threshold = self.settings.threshold_counts
        return np.array([probability_of(e, threshold) for e in self.energy_counts])


def probability_of(energy_counts: float, threshold_counts: float) -> float:
    """Logistic in the log of the energy: 0 for none, exactly 0.5 at the threshold."""
    if energy_counts == 0.0:
        return 0.0
    ratio: float = (threshold_counts / energy_counts) ** STEEPNESS
    return 1.0 / (1.0 + ratio)


def energy_series(counts: NDArray[np.int16], window: int) -> NDArray[np.float64]:
    """Energies (n, fingers) of a recording (n, fingers, taxels), as the detector streams them."""
    changes = np.abs(np.diff(counts.astype(np.int64), axis=0, prepend=counts[:1])).sum(axis=2)
    total = np.cumsum(changes, axis=0)
    total[window:] -= total[:-window].copy()
    energies: NDArray[np.float64] = total / (window * counts.shape[2])
    return energies
