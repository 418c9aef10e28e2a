"""Decision rules: from a stream of probabilities to registered slip."""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray


class RuleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """k consecutive samples above threshold on the same finger; any finger will do."""

    consecutive: Annotated[
        int, Meta(ge=1, le=50, description="samples in a row (paper, section V: 2)")
    ] = 2
    threshold: Annotated[
        float, Meta(gt=0.0, lt=1.0, description="on the probability")
    ] = 0.5


class ConsecutiveRule:
    """Counts samples above threshold in a row, a finger at a time."""

    def __init__(self, settings: RuleSettings, fingers: int) -> None:
        self.threshold = settings.threshold
        self._consecutive = settings.consecutive
        self._run = np.zeros(fingers, np.int64)

    def reset(self) -> None:
        self._run[:] = 0

    def update(self, probabilities: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Take one sample (fingers,); True for each finger on which slip is registered now."""
        self._run += 1
        self._run *= probabilities > self.threshold
        registered: NDArray[np.bool_] = self._run >= self._consecutive
        return registered
