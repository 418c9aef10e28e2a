"""Energy detector, the baseline of the networks: mean absolute change of the taxels.

A sliding fingertip vibrates at all frequencies up to 50 Hz, a fingertip at rest does not (recorded
by Grover, Nadeau, Grebe and Kelly 2022). The energy of a finger is the mean absolute change from
frame to frame over its taxels and a short window, in counts.
"""

from operator import sub
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from drivers.interfaces import KIT_TAXELS

SAMPLES_PER_MIN = 6000  # 100 Hz, the board's rate in the paper
STEEPNESS = 4.0  # log-odds gained when the energy or power grows by a factor of e; assumed


class EnergySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Window and threshold of the energy detector."""

    window: Annotated[
        int, Meta(ge=1, le=100, description="samples whose changes are averaged; assumed")
    ] = 10
    threshold_counts: Annotated[
        float, Meta(ge=0.1, le=500.0, description="energy at probability 0.5, counts per sample")
    ] = 6.0  # assumed: twice that of three loaded taxels of six at rest


class EnergyDetector:
    """Mean absolute change as a probability.

    The first frame after a reset has no change. Until the window is full, missing changes count
    as zero: detection may be late by one window, and a reset never causes an alarm. A repeated
    frame (a missed sample) is a change of zero.
    """

    name = "energy"
    threshold = 0.5

    def __init__(self, settings: EnergySettings, fingers: int, taxels: int = KIT_TAXELS) -> None:
        self.settings = settings
        self.fingers = fingers
        self.memory = settings.window + 1  # samples between which the changes are taken
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
        """Take one frame (fingers, taxels); return (fingers,) probabilities."""
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
    """Logistic function of the logarithm of the energy: 0 at 0, exactly 0.5 at the threshold."""
    if energy_counts == 0.0:
        return 0.0
    ratio: float = (threshold_counts / energy_counts) ** STEEPNESS
    return 1.0 / (1.0 + ratio)
