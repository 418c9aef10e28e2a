"""Plausibility of the fingertips' raw codes. A frame that was missed is not judged."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import CODE_MAX, FINGERS, TactileFrame
from grasp.monitors.settings import Data, MonitorSettings, finger_names

Flags = NDArray[np.bool_]
RAIL_SAMPLES = 3  # in a row with a whole fingertip at code 0 or 1023; assumed
FROZEN_SAMPLES = 8  # repeats in a row of all codes of a loaded hand; measured: at most 3 by chance
# Repeats in a row of all codes of one loaded fingertip. Measured: by chance at most 7 with 0.1
# counts of noise, 18 if two of its six taxels are dead as well.
DEAD_SAMPLES = 30
# Repeats in a row after which a taxel counts as stuck; assumed: at 0.3 counts of noise this
# happens by chance once a day.
STUCK_SAMPLES = 100
LOADED_COUNTS = 30  # of a taxel from its rest; assumed: twice the drift of warming up
# Least share of usable taxels of each fingertip for a lift; assumed: detectors are trained with one
# dead taxel of six, almost never with four.
USABLE_SHARE = 0.5


class FingertipHistory:
    """Plausibility of the last samples. Arrays are (3, taxels).

    ``responsive``: taxels that would show a change, since they are neither stuck nor saturated.
    ``all_responsive``: all taxels are. ``plausible``: the codes give a valid force estimate.
    """

    def __init__(self, settings: MonitorSettings) -> None:
        self._jump_counts = settings.jump_counts
        self.codes: NDArray[np.int64] | None = None  # None if this step has no frame
        self.rails: Flags = np.zeros((FINGERS, 1), np.bool_)
        self.repeats = np.zeros((FINGERS, 1), np.int64)  # in a row, of each taxel's code
        self.loaded: Flags = np.zeros(FINGERS, np.bool_)  # fingertips in contact
        self.at_rail = np.zeros(FINGERS, np.int64)  # samples in a row of each whole fingertip
        self.jumped = False
        self.responsive: Flags = np.ones((FINGERS, 1), np.bool_)
        self.all_responsive = self.plausible = True

    def update(self, frame: TactileFrame | None) -> None:
        """Take the frame of this step; a missed frame only repeats the last and is ignored."""
        if frame is None:
            self.codes = None
        elif not frame.missed:
            self._take(frame.raw.astype(np.int64), frame.counts)

    def _take(self, codes: NDArray[np.int64], counts: NDArray[np.int16]) -> None:
        change = codes - (codes if self.codes is None else self.codes)
        self.repeats = np.where((change == 0) & (self.codes is not None), self.repeats + 1, 0)
        rails_before, self.codes, self.rails = self.rails, codes, at_rail(codes)
        self.responsive = ~(self.rails | (self.repeats >= STUCK_SAMPLES))
        self.all_responsive = bool(self.responsive.all())
        self.loaded = np.abs(counts * ~self.rails).max(axis=1) >= LOADED_COUNTS
        whole = self.rails.all(axis=1)
        self.at_rail = np.where(whole, self.at_rail + 1, 0)
        self.jumped = self._all_jumped(change, self.responsive & ~rails_before)
        self.plausible = not (self.jumped or whole.any())

    def _all_jumped(self, change: NDArray[np.int64], responsive: Flags) -> bool:
        """Whether all responsive taxels, and most are, changed at once in one direction. A contact
        instead presses some taxels and unloads others."""
        if np.abs(change).max() < self._jump_counts or 2 * responsive.sum() <= change.size:
            return False
        by = change[responsive]
        return bool(by.min() >= self._jump_counts or by.max() <= -self._jump_counts)


def frozen(h: FingertipHistory, s: MonitorSettings) -> Data:
    """Fails if the codes of all responsive taxels of a loaded hand repeat."""
    repeats = h.repeats[h.responsive]
    if h.codes is None or not h.loaded.any() or 2 * repeats.size <= h.repeats.size:
        return None
    fewest = int(repeats.min())
    return {"samples": fewest + 1} if fewest >= FROZEN_SAMPLES else None


def dead(h: FingertipHistory, s: MonitorSettings) -> Data:
    """Fails if all codes of a loaded fingertip repeat."""
    return finger_names((h.repeats.min(axis=1) >= DEAD_SAMPLES) & h.loaded)


def few_responsive(h: FingertipHistory, s: MonitorSettings) -> Data:
    """Fails if a fingertip has too few usable taxels to lift an object. A saturated taxel counts as
    usable, because it is pressed."""
    if h.codes is None or h.all_responsive:
        return None
    return finger_names((h.responsive | h.rails).mean(axis=1) < USABLE_SHARE)


def at_rail(raw: NDArray[np.integer[Any]]) -> Flags:
    """Which codes are at an end of the range, and so no longer show changes of pressure."""
    out: Flags = (raw <= 0) | (raw >= CODE_MAX)
    return out
