"""The slip detector protocol and its types."""

from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray


class Motion(msgspec.Struct, frozen=True):
    """Estimated motion of each fingertip, mean of the last 50 ms; valid only while it slips."""

    speed_mps: list[float]
    direction_deg: list[int]  # one of eight, from the fingertip's x to its y
    turning: list[float]  # probability that rotation exceeds translation

    @property
    def hand_mps(self) -> float:
        """Median speed of the fingers, m/s."""
        return sorted(self.speed_mps)[len(self.speed_mps) // 2]


class SlipDetector(Protocol):
    """Causal stream: one frame of all fingertips in, one slip probability per finger out.

    Frames are 10 ms apart; the caller repeats the last frame for a missed one. A probability above
    ``threshold`` classifies the sample as slip. The output depends on the last ``memory`` samples;
    0: all samples since the reset.
    """

    name: str
    threshold: float
    memory: int

    def reset(self) -> None:
        """Clear all state."""

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take counts (fingers, taxels), raw minus rest, pressing negative; return (fingers,)."""
