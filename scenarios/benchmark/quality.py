"""The score of a detector: 0 for one that never registers slip, 100 for the oracle.

All rows of a benchmark have the same trials. They are resampled alike for all of them, so that
the difference of two rows has a narrower interval than either score.
"""

from collections.abc import Sequence
from functools import cache
from itertools import combinations

import msgspec
import numpy as np

from detector.scores.figures import Figure, bounded, resamples
from detector.scores.metrics import Floats

BUDGET_PER_MIN = 1.0  # false alarms that a threshold may have to be chosen
PER_FALSE_ALARM = 0.01  # of `raw`, off for each a minute
BLOCK = 8  # lifts with every kind of grip and object


class Trials(msgspec.Struct, frozen=True):
    """Qualities from 0 to 1 of the lifts and taps of one row, and its false alarms."""

    lifts: list[float]
    # of each hand: sum and number of the taps that moved the object, and of the others
    taps: list[tuple[float, int, float, int]]
    alarms: list[tuple[int, float]]  # of each recording: false alarms, and seconds of a hand

    def first(self, lifts: int) -> "Trials":
        return msgspec.structs.replace(self, lifts=self.lifts[:lifts])

    def half(self, which: int) -> "Trials":
        """Every other hand, recording and block of lifts."""
        chosen = [q for i, q in enumerate(self.lifts) if i // BLOCK % 2 == which]
        return Trials(chosen, self.taps[which::2], self.alarms[which::2])


NO_TRIALS = Trials([], [], [])


class Drawn(msgspec.Struct, frozen=True, eq=False):
    """Measures of all trials, then of each resample: shares, and false alarms a minute."""

    lifts: Floats
    moved: Floats  # taps that moved the object
    unmoved: Floats
    false_per_min: Floats

    @property
    def raw(self) -> Floats:
        taps = (self.moved + self.unmoved) / 2.0
        return (self.lifts + taps) / 2.0 - PER_FALSE_ALARM * self.false_per_min


@cache
def _times(units: int, seed: int) -> Floats:
    """How often each unit is in all trials, then in each resample."""
    drawn = [np.bincount(each, minlength=units) for each in resamples(units, seed)]
    return np.array([np.ones(units), *drawn])


def drawn(trials: Trials) -> Drawn:
    lifts = np.array(trials.lifts)
    taps, alarms = np.array(trials.taps).reshape(-1, 4), np.array(trials.alarms).reshape(-1, 2)
    moved, of_moved, unmoved, of_unmoved = (_times(len(taps), 1) @ taps).T
    false, seconds = (_times(len(alarms), 2) @ alarms).T
    return Drawn(
        _times(len(lifts), 0) @ lifts / max(len(lifts), 1),
        moved / np.maximum(of_moved, 1.0),
        unmoved / np.maximum(of_unmoved, 1.0),
        60.0 * false / np.maximum(seconds, 1e-9),
    )


def scores(trials: Trials, silence: Trials, oracle: Trials) -> Floats:
    """Score as a share, of all trials and of each resample. With fewer lifts than the references,
    these are cut to the same."""
    raw, none, most = (
        drawn(each.first(len(trials.lifts))).raw for each in (trials, silence, oracle)
    )
    return (raw - none) / (most - none)


def interval(values: Floats) -> Figure:
    return bounded(float(values[0]), values[1:].tolist())


def resolved(figure: Figure) -> bool:
    """Whether the interval of a difference excludes zero."""
    return figure.low is not None and figure.high is not None and figure.low * figure.high > 0.0


def halves_agree(
    rows: Sequence[Trials], silence: Trials, oracle: Trials
) -> list[tuple[int, int, bool]]:
    """Every pair of rows whose difference is resolved by all trials, and whether two disjoint
    halves of the trials order it alike."""
    whole = [scores(row, silence, oracle) for row in rows]
    halves = [
        [scores(row.half(i), silence.half(i), oracle.half(i))[0] for row in rows] for i in (0, 1)
    ]
    return [
        (a, b, all((half[a] - half[b]) * (whole[a] - whole[b])[0] > 0.0 for half in halves))
        for a, b in combinations(range(len(rows)), 2) if resolved(interval(whole[a] - whole[b]))
    ]  # fmt: skip
