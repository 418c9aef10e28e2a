"""Raw codes that no living fingertip gives. A frame that was missed proves nothing."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import CODE_MAX, FINGERS, TactileFrame
from grasp.monitors.settings import Data, MonitorSettings, named

Flags = NDArray[np.bool_]
RAIL_SAMPLES = 3  # in a row with a whole fingertip at code 0 or 1023; assumed
FROZEN_SAMPLES = 8  # repeats in a row of all codes of a loaded hand; measured: at most 3 by chance
# Repeats in a row of all codes of one loaded fingertip. Measured: by chance at most 7 with 0.1
# counts of noise, 18 with two dead taxels of six beside that.
DEAD_SAMPLES = 30
# Repeats in a row after which a taxel is stuck; assumed: at 0.3 counts of noise it comes by chance
# once in a day.
STUCK_SAMPLES = 100
LOADED_COUNTS = 30  # of a taxel from its rest; assumed: twice what warming up shifts it
# Share of each fingertip's taxels that live, or the arm does not lift; assumed: detectors learn
# with one of six dead, next to never with four.
LIVING_SHARE = 0.5


class FingertipHistory:
    """What the last samples say. Arrays are (3, taxels).

    ``can_tell``: which taxels would feel a change: neither stuck nor at an end of the range.
    ``all_tell``: all of them. ``believable``: codes can be taken for a force.
    """

    def __init__(self, settings: MonitorSettings) -> None:
        self._jump_counts = settings.jump_counts
        self.codes: NDArray[np.int64] | None = None  # None where there is no frame now
        self.rails: Flags = np.zeros((FINGERS, 1), np.bool_)
        self.still = np.zeros((FINGERS, 1), np.int64)  # repeats in a row of each taxel
        self.loaded: Flags = np.zeros(FINGERS, np.bool_)  # fingertips that press on something
        self.at_rail = np.zeros(FINGERS, np.int64)  # samples in a row of each whole fingertip
        self.jumped = False
        self.can_tell: Flags = np.ones((FINGERS, 1), np.bool_)
        self.all_tell = self.believable = True

    def update(self, frame: TactileFrame | None) -> None:
        """The frame of this step; a missed one only repeats the last."""
        if frame is None:
            self.codes = None
        elif not frame.missed:
            self._take(frame.raw.astype(np.int64), frame.counts)

    def _take(self, codes: NDArray[np.int64], counts: NDArray[np.int16]) -> None:
        moved = codes - (codes if self.codes is None else self.codes)
        self.still = np.where((moved == 0) & (self.codes is not None), self.still + 1, 0)
        rails_before, self.codes, self.rails = self.rails, codes, at_rail(codes)
        self.can_tell = ~(self.rails | (self.still >= STUCK_SAMPLES))
        self.all_tell = bool(self.can_tell.all())
        self.loaded = np.abs(counts * ~self.rails).max(axis=1) >= LOADED_COUNTS
        whole = self.rails.all(axis=1)
        self.at_rail = np.where(whole, self.at_rail + 1, 0)
        self.jumped = self._leapt(moved, self.can_tell & ~rails_before)
        self.believable = not (self.jumped or whole.any())

    def _leapt(self, moved: NDArray[np.int64], telling: Flags) -> bool:
        """All that can tell at once and one way, where a contact presses some taxels and lifts
        others; most must be able to tell."""
        if np.abs(moved).max() < self._jump_counts or 2 * telling.sum() <= moved.size:
            return False
        by = moved[telling]
        return bool(by.min() >= self._jump_counts or by.max() <= -self._jump_counts)


def frozen(h: FingertipHistory, s: MonitorSettings) -> Data:
    """All codes of a loaded hand repeat that can tell, most of them."""
    telling = h.still[h.can_tell]
    if h.codes is None or not h.loaded.any() or 2 * telling.size <= h.still.size:
        return None
    repeats = int(telling.min())
    return {"samples": repeats + 1} if repeats >= FROZEN_SAMPLES else None


def dead(h: FingertipHistory, s: MonitorSettings) -> Data:
    """All codes of a loaded fingertip repeat."""
    return named((h.still.min(axis=1) >= DEAD_SAMPLES) & h.loaded)


def few_living(h: FingertipHistory, s: MonitorSettings) -> Data:
    """A fingertip too few of whose taxels live to entrust an object to it. One at a rail lives: it
    is pressed."""
    if h.codes is None or h.all_tell:
        return None
    return named((h.can_tell | h.rails).mean(axis=1) < LIVING_SHARE)


def at_rail(raw: NDArray[np.integer[Any]]) -> Flags:
    """Which codes stand at an end of the range, where they no longer tell of pressure."""
    out: Flags = (raw <= 0) | (raw >= CODE_MAX)
    return out
