"""What every slip detector is to its users, and how one is made from its name."""

from collections.abc import Mapping
from typing import Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.energy import EnergyDetector, EnergySettings


class SlipDetector(Protocol):
    """A causal stream: one frame of all fingertips in, one probability of slip per finger out.

    It reads no clock: frames are taken to be 10 ms apart, and a missed one is repeated by whoever
    feeds it. A probability above ``threshold`` is a sample that reads as slip.
    """

    name: str
    threshold: float

    def reset(self) -> None:
        """Forget all frames."""

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take counts (fingers, 6), raw minus rest, pressing negative; give (fingers,)."""


DETECTORS = ("energy",)


def load_detector(
    name: str, settings: Mapping[str, Any] | EnergySettings, fingers: int
) -> SlipDetector:
    """Make the named detector, reset, for so many fingers.

    Raises ValueError for an unknown name, msgspec.ValidationError for settings out of range.
    """
    if name not in DETECTORS:
        raise ValueError(f"unknown detector {name!r}; known: {', '.join(DETECTORS)}")
    if not isinstance(settings, EnergySettings):
        settings = msgspec.convert(dict(settings), EnergySettings)
    return EnergyDetector(settings, fingers)
