"""One interface for every detector, from simplest to richest."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from detector.energy import EnergyDetector, EnergySettings

DETECTORS = ("energy",)


class SlipDetector(Protocol):
    """Streaming and causal. Counts are raw minus rest, int16, pressing negative."""

    name: str

    def reset(self) -> None: ...

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """One frame (fingers, 6) in, one probability of slip a finger (fingers,) out."""
        ...


def load_detector(name: str, settings: EnergySettings, fingers: int) -> SlipDetector:
    """A detector by name; raises ValueError for an unknown one."""
    if name != "energy":
        raise ValueError(f"unknown detector {name!r}: one of {', '.join(DETECTORS)}")
    return EnergyDetector(settings, fingers)
