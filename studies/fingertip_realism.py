"""Two-sample test of simulated fingertips against a real recording, by a classifier.

The classifier gets short windows within pauses, or within strokes. Each taxel's mean is removed and
taxels are ordered by their activity, so only the motion of the signal counts. It is a ridge
regression on random convolutions (Dempster, Petitjean and Webb 2020, ROCKET): the maximum and the
share above zero of each. Cross-validation splits the real windows by stroke or pause, the simulated
ones by recording.

Even simulated recordings differ from one another. As a control, simulated recordings take the real
one's place; the rank of the AUC among those controls is the result.
"""

import argparse
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import Recording, read, read_dataset
from detector.scores.metrics import auc
from detector.scores.quantiles import quantile
from drivers.errors import UsageError
from grasp.cli.options import whole
from grasp.cli.parser import Parser
from studies.runner import Study, add_data, markdown

SEGMENT_SAMPLES = 416  # of a data set's recordings: the length of the real recording, 4.2 s
MIN_RUN = {"rest": 12, "slip": 15}  # samples; minimum length of a pause or a stroke
WINDOW, HOP = {"rest": 16, "slip": 40}, {"rest": 4, "slip": 5}  # samples
EDGE = 2  # samples removed at both ends of a stroke or pause
ACTIVE_TAXELS = 3  # input taxels of the convolutions
KERNELS, KERNEL_SAMPLES = 200, 7
PENALTIES = (1.0, 30.0, 1000.0)  # of the ridge
RESAMPLES, CONTROLS, MAX_WINDOWS, MIN_WINDOWS = 400, 12, 600, 8
MIN_SOURCES = 4  # recordings of the simulated side
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Task(msgspec.Struct, frozen=True):
    """Comparison of one state (pause or stroke) of one part of a data set with the recording."""

    recording: str
    data: str
    part: str
    state: str
    seed: int


class Row(msgspec.Struct, frozen=True):
    """AUC of the classifier for real against simulated windows, and its 95 % interval. NaN: too few
    strokes, pauses or recordings."""

    part: str
    state: str
    auc: float = np.nan
    low: float = np.nan
    high: float = np.nan
    real_windows: int = 0
    simulated_windows: int = 0
    control: tuple[float, ...] = ()  # AUC of the simulated controls, ascending

    @property
    def rank(self) -> float | None:
        """Percentage of controls with a lower AUC; ties count half."""
        if not self.control:
            return None
        below = sum(0.5 * (c == self.auc) + (c < self.auc) for c in self.control)
        return 100.0 * below / len(self.control)


class Windows(msgspec.Struct, frozen=True, eq=False):
    """Windows (n, samples, taxels), and the group of each (n,): its stroke, pause or recording."""

    values: Floats
    group: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.values)

    @property
    def groups(self) -> int:
        return len(np.unique(self.group))


def windows_of(counts: NDArray[Any], slip: Bools, state: str) -> Windows:
    """Windows of counts (n, taxels) with labels (n,), grouped by stroke or pause."""
    edges = [0, *(np.flatnonzero(slip[1:] != slip[:-1]) + 1).tolist(), len(slip)]
    found: list[Floats] = []
    for first, end in pairwise(edges):
        if slip[first] != (state == "slip") or end - first < MIN_RUN[state]:
            continue
        run = counts[first + EDGE : end - EDGE].astype(np.float64)
        starts = range(0, len(run) - WINDOW[state] + 1, HOP[state])
        if starts:
            found.append(np.stack([_normalised(run[s : s + WINDOW[state]]) for s in starts]))
    return _grouped(enumerate(found))


def _normalised(window: Floats) -> Floats:
    """Window without its mean, the most active taxel first."""
    level = window - window.mean(axis=0)
    out: Floats = level[:, np.argsort(-np.diff(level, axis=0).std(axis=0), kind="stable")]
    return out


def _grouped(parts: Iterable[tuple[int, Floats]]) -> Windows:
    kept = [(group, values) for group, values in parts if len(values)]
    if not kept:
        return Windows(np.zeros((0, 0, 0)), np.zeros(0, np.intp))
    groups, values = zip(*kept, strict=True)
    return Windows(np.concatenate(values), np.repeat(groups, [len(v) for v in values]))


def convolved(values: Floats, seed: int) -> Floats:
    """Features (n, 2 kernels): maximum and share above zero of each random convolution."""
    rng = np.random.default_rng(seed)
    scale = values[:, :, :ACTIVE_TAXELS].std(axis=(1, 2), keepdims=True)
    x = values[:, :, :ACTIVE_TAXELS] / np.sqrt(scale + 0.2)  # keeps part of the amplitude
    n, samples, taxels = x.shape
    out = np.empty((n, 2 * KERNELS))
    for k in range(KERNELS):
        weights = rng.standard_normal((KERNEL_SAMPLES, taxels)) * (rng.random(taxels) < 0.6)
        weights -= weights.mean(axis=0)
        dilation = int(rng.integers(1, (samples - 1) // (KERNEL_SAMPLES - 1) + 1))
        bias = rng.uniform(-1.0, 1.0)
        span = samples - dilation * (KERNEL_SAMPLES - 1)
        total = np.full((n, span), bias)
        for j in range(KERNEL_SAMPLES):
            total += x[:, j * dilation : j * dilation + span] @ weights[j]
        out[:, 2 * k] = np.log1p(np.maximum(total.max(axis=1), 0.0))
        out[:, 2 * k + 1] = (total > 0.0).mean(axis=1)
    return out


def ridge_scores(train: Floats, label: Bools, test: Floats) -> list[Floats]:
    """Scores (m,) of a ridge regression on +-1 for each penalty; both classes count alike."""
    mean, std, share = train.mean(axis=0), train.std(axis=0) + 1e-9, label.mean()
    weight = np.where(label, 0.5 / share, 0.5 / (1.0 - share))
    a, b = (train - mean) / std, (test - mean) / std
    square, target = (a * weight[:, None]).T @ a, a.T @ (weight * np.where(label, 1.0, -1.0))
    return [b @ np.linalg.solve(square + c * np.eye(len(square)), target) for c in PENALTIES]


Fold = tuple[Floats, Floats, NDArray[np.intp]]  # scores of real and simulated; their recordings


def _auc(real: Floats, simulated: Floats) -> float:
    label = np.r_[np.ones(len(real), bool), np.zeros(len(simulated), bool)]
    value = auc(np.r_[real, simulated], label)
    return 0.5 if value is None else value


def mean_auc(folds: Sequence[Fold]) -> float:
    """Over folds, weighted by the real windows of each."""
    values = [_auc(real, simulated) for real, simulated, _ in folds]
    return float(np.average(values, weights=[len(real) for real, _, _ in folds]))


def cross_validated(real: Windows, simulated: Windows, seed: int) -> list[Fold]:
    """Scores of held-out windows, for the penalty with the highest AUC."""
    count = real.groups
    sources = np.random.default_rng([seed, 1]).permutation(np.unique(simulated.group))
    fold_of = {int(source): k % count for k, source in enumerate(sources)}
    fold = np.r_[
        np.unique(real.group, return_inverse=True)[1], [fold_of[int(g)] for g in simulated.group]
    ]
    x = convolved(np.concatenate([real.values, simulated.values]), seed)
    label = np.arange(len(x)) < len(real)
    found: list[list[Fold]] = [[] for _ in PENALTIES]
    for k in range(count):
        train, test = fold != k, fold == k
        if not (label & test).any() or not (~label & test).any():
            continue
        group = simulated.group[fold[len(real) :] == k]
        for folds, scores in zip(found, ridge_scores(x[train], label[train], x[test]), strict=True):
            folds.append((scores[label[test]], scores[~label[test]], group))
    return max(found, key=mean_auc)


def interval(folds: Sequence[Fold], rng: np.random.Generator) -> tuple[float, float]:
    """95 % interval: bootstrap over folds and recordings."""
    means = []
    for _ in range(RESAMPLES):
        resample = []
        for f in rng.integers(0, len(folds), len(folds)):
            real, simulated, source = folds[f]
            chosen = rng.choice(np.unique(source), len(np.unique(source)))
            times = np.bincount(chosen, minlength=int(source.max()) + 1)[source]
            resample.append((real, np.repeat(simulated, times), source))
        means.append(mean_auc(resample))
    means.sort()
    return quantile(means, 0.025), quantile(means, 0.975)


def separate(real: Windows, segments: Sequence[tuple[int, Windows]], task: Task) -> Row:
    """Classify the real windows against windows of a data set, given by recording and segment."""
    rng = np.random.default_rng([task.seed, 0])
    each = max(1, MAX_WINDOWS // max(1, len({source for source, _ in segments})))
    of: dict[int, list[Floats]] = {}
    for source, segment in segments:
        of.setdefault(source, []).extend([segment.values] if len(segment) else [])
    joined = [(source, np.concatenate(parts)) for source, parts in of.items() if parts]
    simulated = _grouped((s, values[rng.permutation(len(values))[:each]]) for s, values in joined)
    few = min(len(real), len(simulated)) < MIN_WINDOWS
    if few or real.groups < 2 or simulated.groups < MIN_SOURCES:
        return Row(task.part, task.state)
    folds = cross_validated(real, simulated, task.seed)
    low, high = interval(folds, rng)
    control: list[float] = []
    for index in rng.permutation(len(segments)):
        source, other = segments[index]
        other = Windows(other.values[: len(real)], other.group[: len(real)])
        if len(control) == CONTROLS or other.groups < 2 or len(other) < MIN_WINDOWS:
            continue
        rest = simulated.group != source
        against = Windows(simulated.values[rest], simulated.group[rest])
        control.append(mean_auc(cross_validated(other, against, task.seed)))
    return Row(
        task.part, task.state, mean_auc(folds), low, high, len(real), len(simulated),
        tuple(sorted(control)),
    )  # fmt: skip


@cache
def strokes_by_part(folder: str) -> dict[str, list[Recording]]:
    """Stroked recordings of one fingertip, by the part of their set."""
    found: dict[str, list[Recording]] = {}
    for r in read_dataset(Path(folder)):
        if r.fingers == 1 and r.metadata is not None and r.metadata.set == "slide":
            found.setdefault(r.metadata.part, []).append(r)
    return found


def trial(task: Task) -> Row:
    real, n = read(Path(task.recording)), SEGMENT_SAMPLES
    cuts = [
        (source, r.counts[first : first + n, 0], r.slip[first : first + n])
        for source, r in enumerate(strokes_by_part(task.data)[task.part])
        for first in range(0, len(r.slip) - n + 1, n)
    ]
    segments = [(source, windows_of(counts, slip, task.state)) for source, counts, slip in cuts]
    return separate(windows_of(real.counts[:, 0], real.slip, task.state), segments, task)


def options(parser: Parser) -> None:
    parser.add_argument("--recording", type=Path, required=True, metavar="PATH",
                        help="real, of one fingertip: strokes with pauses, labelled")  # fmt: skip
    parser.add_argument("--seed", type=whole(0, 2**31 - 1), default=0, metavar="N")
    add_data(parser)


def grid(args: argparse.Namespace) -> list[Task]:
    taxels = read(args.recording).counts.shape[2]
    tasks = []
    for folder in map(str, args.data):
        for part, recordings in sorted(strokes_by_part(folder).items()):
            if any(r.counts.shape[2] != taxels for r in recordings):
                raise UsageError(
                    f"{folder}: not all fingertips have {taxels} taxels",
                    "give sets with the layout of --recording",
                )
            tasks += [Task(str(args.recording), folder, part, state, args.seed) for state in WINDOW]
    return tasks


def table(rows: Sequence[Row]) -> str:
    return markdown({
        "part": [r.part or "all" for r in rows], "state": [r.state for r in rows],
        "AUC (0.5: indistinguishable)": [r.auc for r in rows],
        "95 %": [f"{r.low:.2f} to {r.high:.2f}" for r in rows],
        "windows, real": [r.real_windows for r in rows],
        "simulated": [r.simulated_windows for r in rows],
        "rank among controls, %": [r.rank for r in rows],
    })  # fmt: skip


def chart(rows: Sequence[Row], figure: Any) -> None:
    """AUC of the real recording with its interval, and the AUCs of the simulated controls."""
    axes = figure.subplots()
    for y, r in enumerate(rows):
        axes.plot(r.control, [y] * len(r.control), "o", color="#999999", ms=4)
        axes.errorbar(
            r.auc,
            y,
            xerr=[[max(0.0, r.auc - r.low)], [max(0.0, r.high - r.auc)]],
            fmt="s",
            color="#b00020",
        )
    axes.set(xlabel="AUC; grey: simulated controls", xlim=(0.3, 1.02))
    axes.set_yticks(range(len(rows)), [f"{r.part or 'all'}, {r.state}" for r in rows])
    axes.axvline(0.5, color="black", lw=0.5)


STUDY = Study(
    "two-sample test of simulated fingertips against a real recording",
    grid, trial, Row, table, chart, options,
)  # fmt: skip
