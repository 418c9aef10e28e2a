"""Recordings as what networks learn from: sequences of one hand, and draws from them."""

import hashlib
from collections.abc import Sequence
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import MOVED_M, LabelName, Recording
from detector.scores.evaluation import cause_of
from detector.scores.impacts import impacts_of
from drivers.errors import UsageError

Floats = NDArray[np.float32]
Balance = Literal["weights", "undersample"]
LEAST_CHANGE_COUNTS = 0.5  # no scale is finer than the noise of a taxel at rest

IMPACT_SAMPLES = 10  # an impact that moved it is slip so long: over at once, felt by what it leaves
UNSURE_M = 0.0006  # from here to MOVED_M an impact has no label: the pads cannot tell
UNMOVED_WEIGHT = 5.0  # of an impact that moved nothing: rare, and what else would be an alarm
BEFORE_IMPACT, AFTER_IMPACT = 6, 60  # samples learnt around an impact that a stretch was drawn for


class FingerSequences(msgspec.Struct, frozen=True, eq=False):
    """Sequences of one finger each; those of one hand follow one another."""

    counts: list[Floats]  # (n, taxels)
    labels: list[NDArray[np.bool_]]  # (n,)
    weights: list[Floats]  # (n,)
    hands: NDArray[np.intp]  # which recording each is of, ascending
    often: NDArray[np.float64]  # (hands,) share of the draws
    impacts: NDArray[np.intp]  # (m, 2): of which hand, first sample after it struck

    @property
    def taxels(self) -> int:
        """Of every finger."""
        return self.counts[0].shape[1]

    @property
    def slip_share(self) -> float:
        """Share of slip among all samples, those of a hand's fingers counted once."""
        firsts = np.unique(self.hands, return_index=True)[1]
        return float(np.concatenate([self.labels[i] for i in firsts]).mean())


class Statistics(msgspec.Struct, frozen=True):
    """What inputs are standardised with; mean and std of each taxel, counts."""

    mean: tuple[float, ...]
    std: tuple[float, ...]
    change_scale: float


class Batch(msgspec.Struct, frozen=True, eq=False):
    """Inputs with a label and a weight for every sample, 0 where nothing is to be learnt."""

    counts: Floats  # (batch, time, taxels)
    labels: Floats  # (batch, time)
    weights: Floats  # (batch, time)
    hands: NDArray[np.intp]  # (batch,): equal for fingers that felt the same


def fingers_of(
    recordings: Sequence[Recording], label: LabelName, evenness: float = 0.0
) -> FingerSequences:
    """Every finger of every recording, under the recording's one label; of the label `slip` with
    impacts as `targets` has them. ``evenness``: see `shares`."""
    counts, labels, weights = [], [], []
    layouts = sorted({r.taxels for r in recordings})
    if len(layouts) > 1:
        raise UsageError(
            f"recordings of fingertips with {' and '.join(map(str, layouts))} taxels",
            "train on recordings of one layout",
        )
    for recording in recordings:
        known, weight = targets(recording, label)
        for finger in range(recording.fingers):
            counts.append(recording.counts[:, finger].astype(np.float32))
            labels.append(known)
            weights.append(weight)
    hands = np.repeat(np.arange(len(recordings)), [r.fingers for r in recordings])
    impacts = [(hand, b.struck) for hand, r in enumerate(recordings) for b in impacts_of(r)]
    return FingerSequences(
        counts, labels, weights, hands, shares(recordings, evenness),
        np.array(impacts, np.intp).reshape(-1, 2),
    )  # fmt: skip


def shares(recordings: Sequence[Recording], evenness: float) -> NDArray[np.float64]:
    """How often each recording is drawn (n,), of 1: by its samples, and a cause by those of all its
    recordings to the power of 1 - ``evenness``."""
    causes = [cause_of(r) for r in recordings]
    lengths = np.array([len(r.t_s) for r in recordings], np.float64)
    of_cause = {c: lengths[[c == each for each in causes]].sum() for c in set(causes)}
    often = lengths * np.array([of_cause[c] ** -evenness for c in causes])
    found: NDArray[np.float64] = often / often.sum()
    return found


def targets(recording: Recording, label: LabelName) -> tuple[NDArray[np.bool_], Floats]:
    """Label (n,) and weight (n,) of each sample. An impact that moved the held object
    for good is slip for IMPACT_SAMPLES from its first motion; one that did not is no slip and
    weighs more; those between weigh nothing."""
    known = recording.label(label)
    weights = np.ones(len(known), np.float32)
    if label != "slip":
        return known, weights
    known = known.copy()
    for impact in impacts_of(recording):
        its = slice(impact.struck, impact.until)
        if impact.moved_m >= MOVED_M:
            known[impact.onset : min(impact.onset + IMPACT_SAMPLES, impact.until)] = True
        elif impact.moved_m < UNSURE_M:
            known[its], weights[its] = False, UNMOVED_WEIGHT
        else:
            weights[its] = 0.0
    return known, weights


def statistics(fingers: FingerSequences, per_taxel: bool) -> Statistics:
    """Mean and deviation, of each taxel or of all alike; mean absolute change while static."""
    every = np.concatenate(fingers.counts).astype(np.float64)
    axis = 0 if per_taxel else None
    taxels = every.shape[1]
    mean, std = (np.broadcast_to(x, taxels) for x in (every.mean(axis), every.std(axis)))
    still = [
        np.abs(np.diff(c, axis=0))[~label[1:]]
        for c, label in zip(fingers.counts, fingers.labels, strict=True)
    ]
    change = float(np.concatenate(still).mean())
    return Statistics(
        tuple(mean.tolist()), tuple(np.maximum(std, 1.0).tolist()),
        max(change, LEAST_CHANGE_COUNTS),
    )  # fmt: skip


def digest(recordings: Sequence[Recording]) -> str:
    """Names the data: equal recordings in equal order give an equal digest."""
    found = hashlib.sha256()
    for recording in recordings:
        for array in (recording.counts, recording.slip, recording.moved_m):
            found.update(b"" if array is None else array.tobytes())
    return found.hexdigest()[:16]


def crops(
    fingers: FingerSequences,
    rng: np.random.Generator,
    batch: int,
    crop: int,
    warm: int,
    fresh: float,
    near_impacts: float = 0.0,
) -> Batch:
    """Stretches of ``warm + crop`` samples, of all fingers of a hand; the first ``warm`` are not
    learnt from. ``batch`` or, with the last hand's fingers, a few more.

    Hands are drawn as often as `shares` has it; the fingers of one weigh as much as a finger alone.
    A share ``fresh`` is learnt from the first sample on, like the time after a reset. A share
    ``near_impacts`` is drawn around one of the impacts, all equally likely.
    """
    drawn = rng.choice(len(fingers.often), batch, p=fingers.often)
    struck = np.full(batch, -1)
    if len(fingers.impacts) and near_impacts:
        near = rng.random(batch) < near_impacts
        chosen = fingers.impacts[rng.integers(len(fingers.impacts), size=batch)]
        drawn, struck = np.where(near, chosen[:, 0], drawn), np.where(near, chosen[:, 1], struck)
    of_hand = [np.flatnonzero(fingers.hands == hand) for hand in drawn]
    enough = int(np.searchsorted(np.cumsum([len(each) for each in of_hand]), batch)) + 1
    rows, time = sum(len(each) for each in of_hand[:enough]), warm + crop
    counts = np.zeros((rows, time, fingers.taxels), np.float32)
    labels, weights = np.zeros((rows, time), np.float32), np.zeros((rows, time), np.float32)
    row = 0
    for each, impact in zip(of_hand[:enough], struck, strict=False):
        start = int(rng.integers(0, max(1, len(fingers.counts[each[0]]) - time)))
        if impact >= 0:
            first = warm + BEFORE_IMPACT
            at = rng.integers(first, max(first + 1, time - AFTER_IMPACT))
            start = max(0, int(impact - at))
        learnt = 0 if rng.random() < fresh else warm
        for i in each:
            part = slice(start, start + time)
            n = len(fingers.counts[i][part])
            counts[row, :n] = fingers.counts[i][part]
            counts[row, n:] = counts[row, n - 1]
            labels[row, :n] = fingers.labels[i][part]
            weights[row, learnt:n] = fingers.weights[i][part][learnt:] / len(each)
            row += 1
    hands = np.repeat(np.arange(enough), [len(each) for each in of_hand[:enough]])
    return Batch(counts, labels, weights, hands)


class Windows:
    """All windows of so many samples, each with the label of its last one."""

    def __init__(self, fingers: FingerSequences, window: int) -> None:
        self._fingers, self._window = fingers, window
        ends = [np.arange(window - 1, len(c)) for c in fingers.counts]
        self._finger = np.repeat(np.arange(len(ends)), [len(e) for e in ends])
        self._end = np.concatenate(ends)
        self.labels = np.concatenate([label[window - 1 :] for label in fingers.labels])

    def epoch(self, rng: np.random.Generator, balance: Balance) -> NDArray[np.intp]:
        """All windows in random order, or (paper) as many static as slipping ones."""
        if balance == "weights":
            return rng.permutation(len(self.labels))
        slip, static = np.flatnonzero(self.labels), np.flatnonzero(~self.labels)
        n = min(len(slip), len(static))
        both = [rng.choice(kind, n, replace=False) for kind in (slip, static)]
        return rng.permutation(np.concatenate(both))

    def take(self, chosen: NDArray[np.intp]) -> Batch:
        """The chosen windows; only their last sample has a weight."""
        counts = np.stack([
            self._fingers.counts[i][end - self._window + 1 : end + 1]
            for i, end in zip(self._finger[chosen], self._end[chosen], strict=True)
        ])  # fmt: skip
        labels = self.labels[chosen].astype(np.float32)[:, None]
        return Batch(counts, labels, np.ones_like(labels), np.arange(len(labels)))
