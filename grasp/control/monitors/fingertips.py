"""Plausibility of the fingertips' raw codes. A frame that was missed is not judged.

Codes and repeats are lists of each finger's taxels: with so few numbers, lists are faster than
arrays.
"""

from collections.abc import Iterable
from itertools import chain, compress

import numpy as np

from drivers.interfaces import CODE_MAX, FINGER_NAMES, FINGERS, OPEN_COUNTS, Detection, TactileFrame
from grasp.control.monitors.settings import Failures, MonitorSettings
from grasp.control.observation import StepInput

INNER_CODES = frozenset(range(1, CODE_MAX))  # others are at a rail and show no change of pressure
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
PRESSED_COUNTS = 4  # mean of a fingertip; assumed: half of the lightest contact
UNPRESSED_NS = 300_000_000  # contact without a pressed fingertip; assumed: delays are 80 ms
STRONG_COUNTS = 250  # means of all fingertips together, about 10 N; assumed
SWAPPED_RATIO, SWAPPED_SAMPLES = 1.4, 10  # unswapped, in 420 simulated lifts: at most 4 in a row


class FingertipHistory:
    """Plausibility of the last samples.

    ``responsive``: for each finger, which taxels would show a change, since they are neither stuck
    nor saturated. ``all_responsive``: all are. ``plausible``: the codes give a force estimate.
    """

    def __init__(self, settings: MonitorSettings) -> None:
        self._jump_counts = settings.jump_counts
        self._absent = True  # this step has no frame
        self._counts = np.zeros((FINGERS, 1), np.int16)  # of the last frame
        self._codes = [[0]] * FINGERS  # of the last frame
        self._repeats = [[0]] * FINGERS  # in a row, of each taxel's code
        self._at_rail = [0] * FINGERS  # samples in a row of each whole fingertip
        self._jumped = False
        self._may_fail = False  # False: the last frame passes all checks
        self.responsive = [[True]] * FINGERS
        self.all_responsive = self.plausible = True

    def update(self, frame: TactileFrame | None) -> Failures:
        """Take the frame of this step; returns the checks that it fails. A missed frame only
        repeats the last and is ignored."""
        if frame is None:
            self._absent = True
        elif not frame.missed:
            self._take(frame)
        return self._failures() if self._absent or self._may_fail else {}

    def _take(self, frame: TactileFrame) -> None:
        codes, before = frame.raw.tolist(), self._codes
        if self._absent:  # codes are not compared across a gap
            self._absent, before = False, codes
            self._repeats = [[-1] * len(row) for row in codes]
            self.responsive = [[True] * len(row) for row in codes]
        self._codes, self._counts = codes, frame.counts
        self.all_responsive, self._may_fail = True, False
        fingers = zip(before, codes, self._repeats, self.responsive, strict=True)
        for finger, (was, now, repeats, responsive) in enumerate(fingers):
            railed, changes, stuck = 0, False, False
            for i, code in enumerate(now):
                repeats[i] = n = repeats[i] + 1 if code == was[i] else 0
                inner = code in INNER_CODES
                responsive[i] = inner and n < STUCK_SAMPLES
                if not inner:
                    railed += 1
                elif n < FROZEN_SAMPLES:
                    changes = True
                elif n >= STUCK_SAMPLES:
                    stuck = True
            self._at_rail[finger] = self._at_rail[finger] + 1 if railed == len(now) else 0
            if railed or stuck:
                self.all_responsive = False
            if stuck or not changes:  # else no check of this fingertip can fail but a jump
                self._may_fail = True
        self._jumped = self._all_jumped(before)
        self._may_fail = self._may_fail or self._jumped
        self.plausible = not (self._jumped or any(self._at_rail))

    def _all_jumped(self, before: list[list[int]]) -> bool:
        """Whether all responsive taxels, and most are, changed at once in one direction. A contact
        instead presses some taxels and unloads others."""
        rises = falls = 0
        for finger in zip(before, self._codes, self.responsive, strict=True):
            for was, now, responsive in zip(*finger, strict=True):
                if not responsive or was not in INNER_CODES:
                    continue
                if abs(now - was) < self._jump_counts:
                    return False
                rises, falls = rises + (now > was), falls + (now < was)
        return 2 * (rises + falls) > sum(map(len, before)) and not (rises and falls)

    def _failures(self) -> Failures:
        """The checks that this step fails."""
        failures: Failures = {}
        if self._absent:
            failures["fingertips_absent"] = {}
        if names := _names(n >= RAIL_SAMPLES for n in self._at_rail):
            failures["fingertips_at_rail"] = {"finger": names}
        if self._jumped:
            failures["fingertips_jump"] = {"counts": self._jump_counts}
        loaded = self._loaded()
        if not self._absent and any(loaded) and (repeats := self._frozen_repeats()):
            failures["fingertips_frozen"] = {"samples": repeats + 1}
        fewest = map(min, self._repeats)
        fingers = zip(loaded, fewest, strict=True)
        if names := _names(touches and n >= DEAD_SAMPLES for touches, n in fingers):
            failures["fingertip_dead"] = {"finger": names}
        if not self._absent and (names := _names(self._few_usable())):
            failures["fingertip_few_taxels"] = {"finger": names}
        return failures

    def _loaded(self) -> list[bool]:
        """Which fingertips are in contact."""
        return [
            any(c in INNER_CODES and abs(n) >= LOADED_COUNTS for c, n in zip(*finger, strict=True))
            for finger in zip(self._codes, self._counts.tolist(), strict=True)
        ]

    def _frozen_repeats(self) -> int:
        """How often the codes of all responsive taxels, and most are, have repeated; 0 if fewer
        times than in a frozen hand."""
        repeats = list(chain(*self._repeats))
        responsive = list(compress(repeats, chain(*self.responsive)))
        fewest = min(responsive) if 2 * len(responsive) > len(repeats) else 0
        return fewest if fewest >= FROZEN_SAMPLES else 0

    def _few_usable(self) -> list[bool]:
        """Which fingertips have too few usable taxels to lift an object. A saturated taxel counts
        as usable, because it is pressed."""
        few = []
        for codes, repeats in zip(self._codes, self._repeats, strict=True):
            taxels = zip(codes, repeats, strict=True)
            usable = sum(code not in INNER_CODES or n < STUCK_SAMPLES for code, n in taxels)
            few.append(usable / len(codes) < USABLE_SHARE)
        return few


class PressHistory:
    """Which fingertips are pressed, compared with the hand and with each other."""

    def __init__(self) -> None:
        self._swapped = 0  # samples in a row in which B or C reads more than the thumb
        self._pressed = False  # some fingertip was, since the hand was open
        self._plausible_ns: int | None = None  # of the last sample without unpressed contact

    def update(self, inputs: StepInput) -> Failures:
        """Take frame and hand of this step; returns the checks that they fail."""
        failures: Failures = {}
        if (frame := inputs.frame) is None:
            return failures
        a, b, c = pressed = [-sum(row) / len(row) for row in frame.counts.tolist()]
        opened = max(inputs.gripper.positions) <= OPEN_COUNTS
        self._pressed = not opened and (self._pressed or max(pressed) >= PRESSED_COUNTS)
        stopped = Detection.CONTACT_CLOSING in [f.detection for f in inputs.gripper.fingers]
        plausible = opened or self._pressed or not (stopped or min(pressed) <= -LOADED_COUNTS)
        if plausible or self._plausible_ns is None:
            self._plausible_ns = inputs.t_ns
        if inputs.t_ns - self._plausible_ns >= UNPRESSED_NS:
            failures["fingertips_unpressed"] = {}
        # the thumb carries the sum of B and C, which a closing makes about equal
        swapped = a + b + c >= STRONG_COUNTS and max(b, c) > SWAPPED_RATIO * a
        self._swapped = (self._swapped + 1) * swapped
        if self._swapped >= SWAPPED_SAMPLES:
            failures["fingertips_swapped"] = {"finger": "B" if b > c else "C"}
        return failures


def taxels_at_rail(frame: TactileFrame) -> list[int]:
    """Number of each finger's taxels with a code at an end of the range."""
    inner = INNER_CODES.__contains__
    return [len(codes) - sum(map(inner, codes)) for codes in frame.raw.tolist()]


def _names(fingers: Iterable[bool]) -> str:
    return ", ".join(compress(FINGER_NAMES, fingers))
