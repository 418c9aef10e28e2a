"""Training data of networks: labelled sequences of fingers, and random batches of them."""

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

Float32s = NDArray[np.float32]
Balance = Literal["weights", "undersample"]
MIN_CHANGE_COUNTS = 0.5  # lower bound of the scale: the noise of a taxel at rest

IMPACT_SAMPLES = 10  # length of the label of an impact that moved the object: its trace lasts
UNSURE_M = 0.0006  # from here to MOVED_M an impact has no label: the pads cannot resolve it
UNMOVED_WEIGHT = 5.0  # of an impact that moved nothing, because these are rare
BEFORE_IMPACT, AFTER_IMPACT = 6, 60  # samples with a loss around the impact of a crop


class FingerSequences(msgspec.Struct, frozen=True, eq=False):
    """Sequences of single fingers; those of one hand are consecutive."""

    counts: list[Float32s]  # (n, taxels)
    labels: list[NDArray[np.bool_]]  # (n,)
    weights: list[Float32s]  # (n,)
    hands: NDArray[np.intp]  # index of the recording, ascending
    sampling_shares: NDArray[np.float64]  # (hands,) probability of each hand
    impacts: NDArray[np.intp]  # (m, 2): index of the hand, first sample of the impact

    @property
    def taxels(self) -> int:
        """Taxels per finger."""
        return self.counts[0].shape[1]

    @property
    def slip_share(self) -> float:
        """Share of slip among all samples; the fingers of a hand count once."""
        firsts = np.unique(self.hands, return_index=True)[1]
        return float(np.concatenate([self.labels[i] for i in firsts]).mean())


class Statistics(msgspec.Struct, frozen=True):
    """Standardisation of the inputs: mean and std of each taxel, counts; scale of the changes."""

    mean: tuple[float, ...]
    std: tuple[float, ...]
    change_scale: float


class Batch(msgspec.Struct, frozen=True, eq=False):
    """Inputs with a label and a weight for every sample; weight 0: no loss."""

    counts: Float32s  # (batch, time, taxels)
    labels: Float32s  # (batch, time)
    weights: Float32s  # (batch, time)
    hands: NDArray[np.intp]  # (batch,): equal for the fingers of one hand


def finger_sequences(
    recordings: Sequence[Recording], label: LabelName, evenness: float = 0.0
) -> FingerSequences:
    """Sequences of all fingers of the recordings, with labels and weights by `targets`.
    ``evenness``: see `sampling_shares`. Raises UsageError for several layouts."""
    counts, labels, weights = [], [], []
    layouts = sorted({r.taxels for r in recordings})
    if len(layouts) > 1:
        raise UsageError(
            f"recordings of fingertips with {' and '.join(map(str, layouts))} taxels",
            "train on recordings of one layout",
        )
    for recording in recordings:
        target, weight = targets(recording, label)
        for finger in range(recording.fingers):
            counts.append(recording.counts[:, finger].astype(np.float32))
            labels.append(target)
            weights.append(weight)
    hands = np.repeat(np.arange(len(recordings)), [r.fingers for r in recordings])
    impacts = [(hand, i.start) for hand, r in enumerate(recordings) for i in impacts_of(r)]
    return FingerSequences(
        counts, labels, weights, hands, sampling_shares(recordings, evenness),
        np.array(impacts, np.intp).reshape(-1, 2),
    )  # fmt: skip


def sampling_shares(recordings: Sequence[Recording], evenness: float) -> NDArray[np.float64]:
    """Probability (n,) of each recording in sampling: proportional to its samples within a cause;
    that of a cause is proportional to its samples to the power of 1 - ``evenness``."""
    causes = [cause_of(r) for r in recordings]
    lengths = np.array([len(r.t_s) for r in recordings], np.float64)
    of_cause = {c: lengths[[c == each for each in causes]].sum() for c in set(causes)}
    weights = lengths * np.array([of_cause[c] ** -evenness for c in causes])
    shares: NDArray[np.float64] = weights / weights.sum()
    return shares


def targets(recording: Recording, label: LabelName) -> tuple[NDArray[np.bool_], Float32s]:
    """Label (n,) and weight (n,) of each sample. For the label `slip`, an impact with a lasting
    displacement of MOVED_M is slip for IMPACT_SAMPLES from its first motion. One below UNSURE_M is
    not slip and has a higher weight; one between has weight 0."""
    target = recording.label(label)
    weights = np.ones(len(target), np.float32)
    if label != "slip":
        return target, weights
    target = target.copy()
    for impact in impacts_of(recording):
        samples = slice(impact.start, impact.end)
        if impact.moved_m >= MOVED_M:
            target[impact.onset : min(impact.onset + IMPACT_SAMPLES, impact.end)] = True
        elif impact.moved_m < UNSURE_M:
            target[samples], weights[samples] = False, UNMOVED_WEIGHT
        else:
            weights[samples] = 0.0
    return target, weights


def statistics(fingers: FingerSequences, per_taxel: bool) -> Statistics:
    """Mean and deviation, of each taxel or of all together; mean absolute change while static."""
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
        max(change, MIN_CHANGE_COUNTS),
    )  # fmt: skip


def digest(recordings: Sequence[Recording]) -> str:
    """Digest of the data: equal for equal recordings in the same order."""
    sha = hashlib.sha256()
    for recording in recordings:
        for array in (recording.counts, recording.slip, recording.moved_m):
            sha.update(b"" if array is None else array.tobytes())
    return sha.hexdigest()[:16]


def random_crops(
    fingers: FingerSequences,
    rng: np.random.Generator,
    batch: int,
    crop: int,
    warm: int,
    fresh: float,
    near_impacts: float = 0.0,
) -> Batch:
    """Random crops of ``warm + crop`` samples, of all fingers of a hand. The number is ``batch``,
    or slightly more to complete the last hand.

    The first ``warm`` samples have no loss, except in a share ``fresh``, as after a reset. Hands
    are sampled by `sampling_shares`; a hand has the same total weight as a single finger. A share
    ``near_impacts`` is taken around an impact, all equally likely.
    """
    sampled = rng.choice(len(fingers.sampling_shares), batch, p=fingers.sampling_shares)
    impacts = np.full(batch, -1)
    if len(fingers.impacts) and near_impacts:
        near = rng.random(batch) < near_impacts
        chosen = fingers.impacts[rng.integers(len(fingers.impacts), size=batch)]
        sampled = np.where(near, chosen[:, 0], sampled)
        impacts = np.where(near, chosen[:, 1], impacts)
    of_hand = [np.flatnonzero(fingers.hands == hand) for hand in sampled]
    enough = int(np.searchsorted(np.cumsum([len(each) for each in of_hand]), batch)) + 1
    rows, time = sum(len(each) for each in of_hand[:enough]), warm + crop
    counts = np.zeros((rows, time, fingers.taxels), np.float32)
    labels, weights = np.zeros((rows, time), np.float32), np.zeros((rows, time), np.float32)
    row = 0
    for each, impact in zip(of_hand[:enough], impacts, strict=False):
        start = int(rng.integers(0, max(1, len(fingers.counts[each[0]]) - time)))
        if impact >= 0:
            first = warm + BEFORE_IMPACT
            at = rng.integers(first, max(first + 1, time - AFTER_IMPACT))
            start = max(0, int(impact - at))
        first_learnt = 0 if rng.random() < fresh else warm
        for i in each:
            part = slice(start, start + time)
            n = len(fingers.counts[i][part])
            counts[row, :n] = fingers.counts[i][part]
            counts[row, n:] = counts[row, n - 1]
            labels[row, :n] = fingers.labels[i][part]
            weights[row, first_learnt:n] = fingers.weights[i][part][first_learnt:] / len(each)
            row += 1
    hands = np.repeat(np.arange(enough), [len(each) for each in of_hand[:enough]])
    return Batch(counts, labels, weights, hands)


class Windows:
    """All windows of a given length, each with the label of its last sample."""

    def __init__(self, fingers: FingerSequences, window: int) -> None:
        self._fingers, self._window = fingers, window
        ends = [np.arange(window - 1, len(c)) for c in fingers.counts]
        self._finger = np.repeat(np.arange(len(ends)), [len(e) for e in ends])
        self._end = np.concatenate(ends)
        self.labels = np.concatenate([label[window - 1 :] for label in fingers.labels])

    def epoch(self, rng: np.random.Generator, balance: Balance) -> NDArray[np.intp]:
        """Indices of all windows in random order, or (paper) of equal numbers of both classes."""
        if balance == "weights":
            return rng.permutation(len(self.labels))
        slip, static = np.flatnonzero(self.labels), np.flatnonzero(~self.labels)
        n = min(len(slip), len(static))
        both = [rng.choice(kind, n, replace=False) for kind in (slip, static)]
        return rng.permutation(np.concatenate(both))

    def take(self, chosen: NDArray[np.intp]) -> Batch:
        """Batch of the chosen windows; only their last sample has a label."""
        counts = np.stack([
            self._fingers.counts[i][end - self._window + 1 : end + 1]
            for i, end in zip(self._finger[chosen], self._end[chosen], strict=True)
        ])  # fmt: skip
        labels = self.labels[chosen].astype(np.float32)[:, None]
        return Batch(counts, labels, np.ones_like(labels), np.arange(len(labels)))
