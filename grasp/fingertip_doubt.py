"""What fingertips say and cannot be: the part of ``grasp.doubt`` that watches them."""

import math
import operator
from collections.abc import Sequence
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import CODE_MAX, FINGER_NAMES, FINGERS, TactileFrame
from grasp.doubt_settings import DoubtSettings
from grasp.states import CONTACT_STATES, OPEN_STATES, State

Flags = NDArray[np.bool_]
Taxels = frozenset[int]
GRIPPED_STATES = frozenset({State.SETTLE, State.BASELINE})  # all is touched, and nothing moves yet
NONE: Taxels = frozenset()
NO_FINGER = (False,) * FINGERS


class Repeats:
    """How long codes stay alike by chance, learnt from those that changed again."""

    TAUGHT = 4  # changes before that: two codes that stray and come back may do so early

    def __init__(self) -> None:
        self._samples = 0
        self._changes = 0

    def ended(self, repeats: int, changes: int) -> None:
        """So many codes changed after so many repeats."""
        self._samples += repeats + 1
        self._changes += changes

    def patience(self, chance: float) -> float:
        """Repeats in a row that are at least as unlikely as ``chance``, were each code to stray and
        come back, two changes, at any time; infinite where too few have changed yet."""
        strayed = (self._changes - self.TAUGHT) / 2
        if strayed <= 0.0:
            return math.inf
        return -math.log(chance) * (self._samples + 1) / strayed


class FingertipDoubt:
    """Raw codes that no living fingertip gives. A frame that was missed proves nothing.

    ``can_tell``: (3, taxels), which of them would feel a change: not at an end of their range, and
    seen to change within ``doubt.stuck_samples``. ``believable``: codes can be taken for a force.
    """

    def __init__(self, settings: DoubtSettings) -> None:
        self._settings = settings
        # The last sample's codes, and those taxels that stood at an end of their range. Taxels are
        # counted finger by finger; for so few numbers lists and sets are faster than arrays.
        self._before: tuple[list[int], Taxels] | None = None
        self._still: list[int] = [0] * FINGERS  # repeats in a row of each taxel
        self._deaf = NONE
        self._counts: list[int] = [0] * FINGERS
        self._repeats = [0] * FINGERS  # in a row of all of a fingertip's codes
        # A quiet sensor is no frozen one: of each fingertip, free and loaded, and of all
        self._free = tuple(Repeats() for _ in range(FINGERS))
        self._pressed = tuple(Repeats() for _ in range(FINGERS))
        self._all_free = Repeats()
        self._at_rail = [0] * FINGERS
        self._jumped = False
        self.can_tell: Flags = np.ones((FINGERS, 1), np.bool_)
        self.believable = True

    @property
    def all_tell(self) -> bool:
        """Most often, and faster than to look at ``can_tell``."""
        return not self._deaf

    def see(self, frame: TactileFrame | None, state: State) -> str:
        """What is wrong with them, where somebody has to feel something."""
        if frame is None:
            self._before = None
            return self._absent(state)
        if not frame.missed:
            self.take(frame.raw, frame.counts)
        if state in OPEN_STATES:
            return ""
        return self.wrong() or (self._deafened() if state in GRIPPED_STATES else "")

    def _absent(self, state: State) -> str:
        if state in CONTACT_STATES:
            return "fingertips_absent: there is no frame: the board came back without its rest"
        return ""

    def take(self, raw: NDArray[np.int16], counts: NDArray[np.int16]) -> None:
        """A sample that is new: raw codes (fingers, taxels), and the same without their rest."""
        codes: list[int] = raw.ravel().tolist()
        rails = NONE if min(codes) > 0 and max(codes) < CODE_MAX else _at_rail(codes)
        whole = len(rails) * FINGERS >= len(codes)
        railed = _whole_fingers(rails, len(codes)) if whole else NO_FINGER
        self._at_rail = [n + 1 if at else 0 for n, at in zip(self._at_rail, railed, strict=True)]
        before, self._before, self._counts = self._before, (codes, rails), counts.ravel().tolist()
        if before is None:
            self._still, self._jumped = [0] * len(codes), False
            self._repeats = [0] * FINGERS
            self._hear(rails, raw.shape)
        else:
            moved = list(map(operator.sub, codes, before[0]))
            self._still = [0 if way else n + 1 for way, n in zip(moved, self._still, strict=True)]
            self._hear(rails, raw.shape)
            self._jumped = self._leapt(moved, self._deaf | before[1])
            self._learn()
        self.believable = not (self._jumped or any(railed))

    def _learn(self) -> None:
        """How often codes repeat by chance."""
        before, fingers = self._repeats, _by_finger(self._still)
        self._repeats = [min(own) for own in fingers]
        loaded = [self._loaded(finger) for finger in range(FINGERS)]
        changes = [own.count(0) for own in fingers]
        for finger, number in enumerate(changes):
            if number:
                which = self._pressed if loaded[finger] else self._free
                which[finger].ended(before[finger], number)
        if any(changes) and not any(loaded):
            self._all_free.ended(min(before), sum(changes))

    def _loaded(self, finger: int) -> bool:
        """Whether a taxel that can tell is."""
        least, each = self._settings.loaded_counts, len(self._counts) // FINGERS
        own = range(finger * each, (finger + 1) * each)
        return any(abs(self._counts[i]) >= least and i not in self._deaf for i in own)

    def _hear(self, rails: Taxels, shape: tuple[int, ...]) -> None:
        """Which taxels can tell now."""
        most, deaf = self._settings.stuck_samples, rails
        if max(self._still) >= most:
            deaf = rails.union(i for i, n in enumerate(self._still) if n >= most)
        if deaf != self._deaf or shape != self.can_tell.shape:
            self.can_tell = np.ones(shape, np.bool_)
            self.can_tell.flat[list(deaf)] = False
            self._deaf = deaf

    def _leapt(self, moved: list[int], deaf: Taxels) -> bool:
        """All that can tell at once and one way, where a contact presses some taxels and lifts
        others; most must be able to tell."""
        least = self._settings.jump_counts
        if max(moved) < least and min(moved) > -least:  # most often
            return False
        heard = [way for i, way in enumerate(moved) if i not in deaf]
        if 2 * len(heard) <= len(moved):
            return False
        return min(heard) >= least or max(heard) <= -least

    def wrong(self) -> str:
        """What the samples up to now say against the fingertips."""
        s = self._settings
        if max(self._at_rail) >= s.rail_samples:
            railed = ", ".join(compress(FINGER_NAMES, [n >= s.rail_samples for n in self._at_rail]))
            return f"fingertips_at_rail: finger {railed} reads 0 or {CODE_MAX} at every taxel"
        if self._jumped:
            return f"fingertips_jump: every taxel changed by {s.jump_counts} counts or more at once"
        if not any(self._repeats):  # most often
            return ""
        dead = [n >= self._patience(i) for i, n in enumerate(self._repeats)]
        if all(dead) or min(self._repeats) >= self._hand_patience():
            return f"fingertips_frozen: all codes have come {min(self._repeats) + 1} times alike"
        if any(dead):
            names = ", ".join(compress(FINGER_NAMES, dead))
            return f"fingertip_dead: finger {names} gives the same codes for ever"
        return ""

    def _deafened(self) -> str:
        """A fingertip of which too few taxels live: what it holds is not entrusted to it. In the
        air it would be too late, and a rail is none of it: there a taxel is pressed."""
        if not self._deaf or self._before is None:
            return ""
        s, rails = self._settings, self._before[1]
        still = [n >= s.stuck_samples and i not in rails for i, n in enumerate(self._still)]
        for name, own in zip(FINGER_NAMES, _by_finger(still), strict=True):
            if len(own) - sum(own) < s.living_share * len(own):
                return (
                    f"fingertip_deaf: {sum(own)} of finger {name}'s {len(own)} taxels stand still"
                )
        return ""

    def _patience(self, finger: int) -> float:
        """Repeats of a fingertip that a taxel that can tell, above all a loaded one, could end."""
        s = self._settings
        if self._loaded(finger):  # it may hold something: no longer than until no taxel can tell
            by_chance = self._pressed[finger].patience(s.repeat_chance)
            return max(s.dead_samples, min(by_chance, s.stuck_samples - 1))
        least = _as_much(s.dead_unloaded_samples, self.can_tell[finger])
        return max(least, self._free[finger].patience(s.repeat_chance))

    def _hand_patience(self) -> float:
        """Likewise of all fingertips at once."""
        least = _as_much(self._settings.frozen_samples, self.can_tell)
        if any(self._loaded(finger) for finger in range(FINGERS)):
            return least
        return max(least, self._all_free.patience(self._settings.repeat_chance))


def at_rail(raw: NDArray[np.int16]) -> Flags:
    """Which codes stand at an end of the range, where they no longer tell of pressure."""
    out: Flags = (raw <= 0) | (raw >= CODE_MAX)
    return out


def _at_rail(codes: Sequence[int]) -> Taxels:
    return frozenset(i for i, code in enumerate(codes) if code <= 0 or code >= CODE_MAX)


def _whole_fingers(rails: Taxels, taxels: int) -> Sequence[bool]:
    return [rails.issuperset(own) for own in _by_finger(range(taxels))]


def _by_finger(taxels: Sequence[int]) -> list[Sequence[int]]:
    each = len(taxels) // FINGERS
    return [taxels[at : at + each] for at in range(0, len(taxels), each)]


def _as_much(samples: int, can_tell: Flags) -> int:
    """Repeats that say as much as that many of all taxels, where some cannot tell."""
    telling = int(np.count_nonzero(can_tell)) or can_tell.size
    return math.ceil(samples * can_tell.size / telling)
