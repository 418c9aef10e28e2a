"""What fingertips say and cannot be: the part of ``grasp.doubt`` that watches them."""

import math
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import CODE_MAX, FINGER_NAMES, FINGERS, TactileFrame
from grasp.doubt_settings import DoubtSettings
from grasp.phases import CONTACT_PHASES, OPEN_PHASES, Phase

Flags = NDArray[np.bool_]


class FingertipDoubt:
    """Raw codes that no living fingertip gives. A frame that was missed proves nothing.

    ``can_tell``: (3, taxels), which of them would feel a change: not at an end of their range, and
    seen to change within ``doubt.stuck_samples``. ``believable``: codes can be taken for a force.
    """

    def __init__(self, settings: DoubtSettings) -> None:
        self._settings = settings
        # the last sample's codes, and which of them stood at an end of their range
        self._before: tuple[NDArray[np.int16], Flags] | None = None
        self._still = np.zeros((FINGERS, 1), np.int64)  # repeats in a row of each taxel
        self._loaded = np.zeros((FINGERS, 1), np.bool_)
        self._at_rail = [0] * FINGERS
        self._jumped = False
        self.can_tell: Flags = np.ones((FINGERS, 1), np.bool_)
        self.believable = True

    def see(self, frame: TactileFrame | None, phase: Phase) -> str:
        """What is wrong with them, where somebody has to feel something."""
        if frame is None:
            self._before = None
            return self._absent(phase)
        if not frame.missed:
            self.take(frame.raw, frame.counts)
        return "" if phase in OPEN_PHASES else self.wrong()

    def _absent(self, phase: Phase) -> str:
        if phase in CONTACT_PHASES:
            return "fingertips_absent: there is no frame: the board came back without its rest"
        return ""

    def take(self, raw: NDArray[np.int16], counts: NDArray[np.int16]) -> None:
        """A sample that is new: raw codes (fingers, taxels), and the same without their rest."""
        rails = at_rail(raw)
        railed: list[bool] = [finger.all() for finger in rails]
        self._at_rail = [n + 1 if at else 0 for n, at in zip(self._at_rail, railed, strict=True)]
        self._loaded = np.abs(counts) >= self._settings.loaded_counts
        before, self._before = self._before, (raw, rails)
        if before is None:
            self._still, self._jumped = np.zeros(raw.shape, np.int64), False
        else:
            moved = raw - before[0]
            self._still = (self._still + 1) * (moved == 0)
        self.can_tell = ~rails & (self._still < self._settings.stuck_samples)
        if before is not None:
            self._jumped = self._leapt(moved[self.can_tell & ~before[1]], raw.size)
        self.believable = not (self._jumped or any(railed))

    def _leapt(self, moved: NDArray[np.int16], taxels: int) -> bool:
        """All that can tell at once and one way, where a contact presses some taxels and lifts
        others; most must be able to tell."""
        least = self._settings.jump_counts
        if 2 * moved.size <= taxels:
            return False
        return bool(moved.min() >= least or moved.max() <= -least)

    def wrong(self) -> str:
        """What the samples up to now say against the fingertips."""
        s = self._settings
        if max(self._at_rail) >= s.rail_samples:
            railed = ", ".join(compress(FINGER_NAMES, [n >= s.rail_samples for n in self._at_rail]))
            return f"fingertips_at_rail: finger {railed} reads 0 or {CODE_MAX} at every taxel"
        if self._jumped:
            return f"fingertips_jump: every taxel changed by {s.jump_counts} counts or more at once"
        repeats = self._still.min(axis=1).tolist()
        if not any(repeats):  # most often
            return ""
        dead = [n >= self._patience(i) for i, n in enumerate(repeats)]
        if all(dead) or min(repeats) >= _as_much(s.frozen_samples, self.can_tell):
            return f"fingertips_frozen: all codes have come {min(repeats) + 1} times alike"
        if any(dead):
            names = ", ".join(compress(FINGER_NAMES, dead))
            return f"fingertip_dead: finger {names} gives the same codes for ever"
        return ""

    def _patience(self, finger: int) -> int:
        """Repeats of a fingertip that its taxels that can tell, above all loaded ones, could
        end."""
        s, tell = self._settings, self.can_tell[finger]
        live = np.count_nonzero(tell & self._loaded[finger])
        if live >= s.live_taxels:
            return s.dead_samples
        return 2 * s.dead_samples if live else _as_much(s.dead_unloaded_samples, tell)


def at_rail(raw: NDArray[np.int16]) -> Flags:
    """Which codes stand at an end of the range, where they no longer tell of pressure."""
    out: Flags = (raw <= 0) | (raw >= CODE_MAX)
    return out


def _as_much(samples: int, can_tell: Flags) -> int:
    """Repeats that say as much as that many of all taxels, where some cannot tell."""
    telling = int(np.count_nonzero(can_tell)) or can_tell.size
    return math.ceil(samples * can_tell.size / telling)
