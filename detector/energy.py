"""`energy`: the one scalar that every network must beat.

Mean absolute change of a fingertip's counts over a short window, all six taxels together, against
one threshold. Slip lifts the spectrum of the barometers at every frequency, so the simplest measure
of change already tells slip from rest.
"""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

TAXELS = 6


class EnergySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Window and threshold of the scalar."""

    window: Annotated[
        int, Meta(ge=1, le=100, description="changes averaged; 10 samples are 100 ms")
    ] = 10
    threshold_counts: Annotated[
        float, Meta(gt=0.0, le=500.0, description="mean |change| a sample at which p is 0.5")
    ] = 2.5
    steepness: Annotated[
        float, Meta(gt=0.1, le=50.0, description="of p in log energy; orders nothing, only scales")
    ] = 4.0


class EnergyDetector:
    """Streaming and exact: sums of whole numbers neither drift nor round.

    Until ``window`` changes have been seen after a reset their sum is still divided by ``window``:
    a young detector hears less, so it cannot alarm by being new.
    """

    name = "energy"

    def __init__(self, settings: EnergySettings, fingers: int) -> None:
        self._settings = settings
        self._scale = 1.0 / (settings.window * TAXELS)
        self._changes = np.zeros((settings.window, fingers), np.int64)
        self._sum = np.zeros(fingers, np.int64)
        self._last: NDArray[np.int32] | None = None
        self._next = 0

    def reset(self) -> None:
        self._changes[:] = 0
        self._sum[:] = 0
        self._last = None
        self._next = 0

    def energy(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take one frame (fingers, 6); mean absolute change a taxel and sample, (fingers,) counts."""
        wide = counts.astype(np.int32)
        if self._last is not None:
            change = np.abs(wide - self._last).sum(axis=1)
            self._sum += change - self._changes[self._next]
            self._changes[self._next] = change
            self._next = (self._next + 1) % len(self._changes)
        self._last = wide
        return self._sum * self._scale

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take one frame (fingers, 6); probability of slip, (fingers,)."""
        ratio = self.energy(counts) / self._settings.threshold_counts
        powered = ratio**self._settings.steepness
        out: NDArray[np.float64] = powered / (1.0 + powered)
        return out
