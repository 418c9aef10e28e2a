"""Raw codes that no living fingertip gives. A frame that was missed proves nothing."""

import math
import operator
from collections.abc import Sequence
from itertools import compress
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import CODE_MAX, FINGER_NAMES, FINGERS, TactileFrame
from grasp.monitors.settings import Data, MonitorSettings

T = TypeVar("T")
Flags = NDArray[np.bool_]
Taxels = frozenset[int]
NONE: Taxels = frozenset()
RAIL_SAMPLES = 3  # in a row with a whole fingertip at code 0 or 1023; assumed
# Repeats in a row of all codes of one loaded fingertip. Measured: by chance at most 7 with 0.1
# counts of noise, 18 with two dead taxels of six beside that.
DEAD_SAMPLES = 30
LOADED_COUNTS = 30  # of a taxel from its rest; assumed: twice what warming up shifts it
# Share of each fingertip's taxels that live, or the arm does not lift; assumed: detectors learn
# with one of six dead, next to never with four.
LIVING_SHARE = 0.5


class FingertipHistory:
    """What the last samples say. Taxels are counted finger by finger; for so few numbers lists and
    sets are faster than arrays.

    ``can_tell``: (3, taxels), which would feel a change: neither stuck nor at an end of the range.
    ``believable``: codes can be taken for a force.
    """

    def __init__(self, settings: MonitorSettings) -> None:
        self._settings = settings
        self.absent = True  # no frame, now
        self.codes: list[int] | None = None
        self.rails = NONE
        self.still: list[int] = [0] * FINGERS  # repeats in a row of each taxel
        self.blind = NONE  # taxels that cannot tell
        self.counts: list[int] = [0] * FINGERS
        self.at_rail = [0] * FINGERS  # samples in a row of each whole fingertip
        self.jumped = False
        self.can_tell: Flags = np.ones((FINGERS, 1), np.bool_)
        self.believable = True

    @property
    def all_tell(self) -> bool:
        """Most often, and faster than to look at ``can_tell``."""
        return not self.blind

    def update(self, frame: TactileFrame | None) -> None:
        """The frame of this step; a missed one only repeats the last."""
        self.absent = frame is None
        if frame is None:
            self.codes = None
        elif not frame.missed:
            self._take(frame.raw, frame.counts)

    def _take(self, raw: NDArray[np.int16], counts: NDArray[np.int16]) -> None:
        before, rails_before = self.codes, self.rails
        self.codes = codes = raw.ravel().tolist()
        self.counts = counts.ravel().tolist()
        inside = min(codes) > 0 and max(codes) < CODE_MAX
        self.rails = NONE if inside else frozenset(np.flatnonzero(at_rail(raw)).tolist())
        railed = [self.rails.issuperset(own) for own in by_finger(range(len(codes)))]
        self.at_rail = [n + 1 if at else 0 for n, at in zip(self.at_rail, railed, strict=True)]
        if before is None:
            self.still, moved = [0] * len(codes), [0] * len(codes)
        else:
            moved = list(map(operator.sub, codes, before))
            self.still = [0 if by else n + 1 for by, n in zip(moved, self.still, strict=True)]
        self._find_blind(raw.shape)
        self.jumped = self._leapt(moved, self.blind | rails_before)
        self.believable = not (self.jumped or any(railed))

    def _find_blind(self, shape: tuple[int, ...]) -> None:
        most, blind = self._settings.stuck_samples, self.rails
        if max(self.still) >= most:
            blind = blind.union(i for i, n in enumerate(self.still) if n >= most)
        if blind != self.blind or shape != self.can_tell.shape:
            self.can_tell = np.ones(shape, np.bool_)
            self.can_tell.flat[list(blind)] = False
            self.blind = blind

    def _leapt(self, moved: list[int], blind: Taxels) -> bool:
        """All that can tell at once and one way, where a contact presses some taxels and lifts
        others; most must be able to tell."""
        least = self._settings.jump_counts
        if max(moved) < least and min(moved) > -least:  # most often
            return False
        telling = [by for i, by in enumerate(moved) if i not in blind]
        if 2 * len(telling) <= len(moved):
            return False
        return min(telling) >= least or max(telling) <= -least

    def loaded(self) -> list[bool]:
        """Which fingertips press on something, by a taxel that is not at a rail."""
        pressed = [abs(n) >= LOADED_COUNTS for n in self.counts]
        for i in self.rails:
            pressed[i] = False
        return [any(own) for own in by_finger(pressed)]


def absent(h: FingertipHistory, s: MonitorSettings) -> Data:
    """There is no frame, though there has to be one."""
    return {} if h.absent else None


def whole_at_rail(h: FingertipHistory, s: MonitorSettings) -> Data:
    """Every taxel of a fingertip reads an end of its range."""
    return _named([n >= RAIL_SAMPLES for n in h.at_rail])


def jumped(h: FingertipHistory, s: MonitorSettings) -> Data:
    """Every taxel changed one way at once."""
    return {"counts": s.jump_counts} if h.jumped else None


def frozen(h: FingertipHistory, s: MonitorSettings) -> Data:
    """All codes of a loaded hand repeat: more often where some could not tell anyhow."""
    repeats = min(h.still)
    if repeats < s.frozen_samples or h.codes is None or not any(h.loaded()):
        return None
    telling = len(h.codes) - len(h.blind) or len(h.codes)
    most = math.ceil(s.frozen_samples * len(h.codes) / telling)
    return {"samples": repeats + 1} if repeats >= most else None


def dead(h: FingertipHistory, s: MonitorSettings) -> Data:
    """All codes of a loaded fingertip repeat."""
    still = [min(own) >= DEAD_SAMPLES for own in by_finger(h.still)]
    if not any(still):  # most often
        return None
    return _named(list(map(operator.and_, still, h.loaded())))


def few_living(h: FingertipHistory, s: MonitorSettings) -> Data:
    """A fingertip too few of whose taxels live to entrust an object to it. One at a rail lives: it
    is pressed."""
    if h.codes is None or not h.blind:
        return None
    stuck = [n >= s.stuck_samples and i not in h.rails for i, n in enumerate(h.still)]
    return _named([len(own) - sum(own) < LIVING_SHARE * len(own) for own in by_finger(stuck)])


def at_rail(raw: NDArray[np.int16]) -> Flags:
    """Which codes stand at an end of the range, where they no longer tell of pressure."""
    out: Flags = (raw <= 0) | (raw >= CODE_MAX)
    return out


def _named(fingers: list[bool]) -> Data:
    return {"finger": ", ".join(compress(FINGER_NAMES, fingers))} if any(fingers) else None


def by_finger(taxels: Sequence[T]) -> list[Sequence[T]]:
    each = len(taxels) // FINGERS
    return [taxels[at : at + each] for at in range(0, len(taxels), each)]
