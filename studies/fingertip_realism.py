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

PIECE_SAMPLES = 416  # of a data set's recordings: the length of the authors' clip, 4.2 s
LEAST_RUN = {"rest": 12, "slip": 15}  # samples; the least length of a pause or a stroke
WINDOW, HOP = {"rest": 16, "slip": 40}, {"rest": 4, "slip": 5}  # samples
EDGE = 2  # samples removed at both ends of a stroke or pause
LIVELY = 3  # input taxels of the convolutions
KERNELS, KERNEL_SAMPLES = 200, 7
PENALTIES = (1.0, 30.0, 1000.0)  # of the ridge
RESAMPLES, CONTROLS, MOST_WINDOWS, LEAST_WINDOWS = 400, 12, 600, 8
LEAST_SOURCES = 4  # recordings of the simulated side
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Task(msgspec.Struct, frozen=True):
    """One state (pause or stroke) of one part of a data set, compared with the recording."""

    recording: str
    data: str
    part: str
    state: str
    seed: int


class Row(msgspec.Struct, frozen=True):
    """How well the classifier separates real from simulated: AUC and its 95 % interval. NaN:
    too few strokes, pauses or recordings."""

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
    """Of counts (n, taxels) with labels (n,), grouped by stroke or pause."""
    edges = [0, *(np.flatnonzero(slip[1:] != slip[:-1]) + 1).tolist(), len(slip)]
    found: list[Floats] = []
    for first, end in pairwise(edges):
        if slip[first] != (state == "slip") or end - first < LEAST_RUN[state]:
            continue
        run = counts[first + EDGE : end - EDGE].astype(np.float64)
        starts = range(0, len(run) - WINDOW[state] + 1, HOP[state])
        if starts:
            found.append(np.stack([_posed(run[s : s + WINDOW[state]]) for s in starts]))
    return _grouped(enumerate(found))


def _posed(window: Floats) -> Floats:
    """Windows without their mean, the most active taxel first."""
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
    """(n, 2 kernels) features: of each random kernel the largest value and the share above zero."""
    rng = np.random.default_rng(seed)
    scale = values[:, :, :LIVELY].std(axis=(1, 2), keepdims=True)
    x = values[:, :, :LIVELY] / np.sqrt(scale + 0.2)  # half of the size stays in
    n, samples, lively = x.shape
    out = np.empty((n, 2 * KERNELS))
    for k in range(KERNELS):
        weights = rng.standard_normal((KERNEL_SAMPLES, lively)) * (rng.random(lively) < 0.6)
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


def contest(real: Windows, simulated: Windows, seed: int) -> list[Fold]:
    """What the strongest penalty gave to windows that were held out."""
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
        drawn = []
        for f in rng.integers(0, len(folds), len(folds)):
            real, simulated, source = folds[f]
            chosen = rng.choice(np.unique(source), len(np.unique(source)))
            times = np.bincount(chosen, minlength=int(source.max()) + 1)[source]
            drawn.append((real, np.repeat(simulated, times), source))
        means.append(mean_auc(drawn))
    means.sort()
    return quantile(means, 0.025), quantile(means, 0.975)


def tell_apart(clip: Windows, pieces: Sequence[tuple[int, Windows]], task: Task) -> Row:
    """Classify the recording's windows against windows of a data set, one piece per recording."""
    rng = np.random.default_rng([task.seed, 0])
    each = max(1, MOST_WINDOWS // max(1, len({source for source, _ in pieces})))
    of: dict[int, list[Floats]] = {}
    for source, piece in pieces:
        of.setdefault(source, []).extend([piece.values] if len(piece) else [])
    joined = [(source, np.concatenate(parts)) for source, parts in of.items() if parts]
    made = _grouped((s, values[rng.permutation(len(values))[:each]]) for s, values in joined)
    few = min(len(clip), len(made)) < LEAST_WINDOWS
    if few or clip.groups < 2 or made.groups < LEAST_SOURCES:
        return Row(task.part, task.state)
    folds = contest(clip, made, task.seed)
    low, high = interval(folds, rng)
    control: list[float] = []
    for index in rng.permutation(len(pieces)):
        source, other = pieces[index]
        other = Windows(other.values[: len(clip)], other.group[: len(clip)])
        if len(control) == CONTROLS or other.groups < 2 or len(other) < LEAST_WINDOWS:
            continue
        rest = made.group != source
        against = Windows(made.values[rest], made.group[rest])
        control.append(mean_auc(contest(other, against, task.seed)))
    return Row(
        task.part, task.state, mean_auc(folds), low, high, len(clip), len(made),
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
    clip = read(Path(task.recording))
    cuts = [
        (source, r.counts[first : first + PIECE_SAMPLES, 0], r.slip[first : first + PIECE_SAMPLES])
        for source, r in enumerate(strokes_by_part(task.data)[task.part])
        for first in range(0, len(r.slip) - PIECE_SAMPLES + 1, PIECE_SAMPLES)
    ]
    pieces = [(source, windows_of(counts, slip, task.state)) for source, counts, slip in cuts]
    return tell_apart(windows_of(clip.counts[:, 0], clip.slip, task.state), pieces, task)


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
