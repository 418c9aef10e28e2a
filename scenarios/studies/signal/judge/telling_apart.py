"""Can one tell pieces of a data set from the real clip? The stronger of two classifiers tries.

Short windows within pauses, or within strokes, each taxel's level removed and the taxels in the
order of their liveliness: neither force nor place gives anything away, only how the signal moves.
One classifier is a logistic on a window's statistics, the other a ridge on random convolutions
(Dempster, Petitjean and Webb 2020: ROCKET), largest value and share above zero of each. What is
tested was not trained on: the real side is split by stroke or pause, the simulated by recording.

One recording differs from a hundred others even where all come from one simulation (it has one
surface, one load, one pad), so the same is done with simulated pieces in the real clip's place: the
control. What the clip's AUC is worth is its rank among those.
"""

from collections.abc import Sequence
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.scores.metrics import auc
from detector.scores.quantiles import quantile
from scenarios.studies.signal.judge.figures import lag_one
from scenarios.studies.signal.judge.pieces import Kind, Piece

WINDOW = {"pause": 16, "stroke": 40}  # samples: as long as the clip's pauses and strokes allow
HOP = {"pause": 4, "stroke": 5}
EDGE = 2  # samples off a stroke's or pause's ends: the label's own
LIVELY = 3  # taxels that the convolutions look at
KERNELS = 200
KERNEL_SAMPLES = 7
PENALTIES = (1.0, 30.0, 1000.0)
LOGISTIC_PENALTY, NEWTON_STEPS = 3.0, 12
RESAMPLES = 400
LEAST_WINDOWS = 8
Floats = NDArray[np.float64]
State = Literal["rest", "slip"]
KINDS: dict[State, Kind] = {"rest": "pause", "slip": "stroke"}


class Windows(msgspec.Struct, frozen=True, eq=False):
    """Windows (n, samples, taxels) and whence: the run of a clip, or the recording of a set."""

    values: Floats
    group: NDArray[np.intp]


class Apart(msgspec.Struct, frozen=True):
    """How well the stronger classifier tells the two apart: AUC, and its 95 % interval."""

    state: State
    auc: float
    low: float
    high: float
    stronger: str
    real_windows: int
    simulated_windows: int
    control: list[float]  # AUC of simulated pieces in the clip's place, rising

    @property
    def rank(self) -> float | None:
        """Percent of the control that is told apart less well than the clip; ties count half."""
        if not self.control:
            return None
        below = sum(0.5 * (c == self.auc) + (c < self.auc) for c in self.control)
        return 100.0 * below / len(self.control)


def windows_of(piece: Piece, state: State) -> list[Floats]:
    """One array (n, samples, taxels) for each pause or stroke that is long enough."""
    kind = KINDS[state]
    length, hop = WINDOW[kind], HOP[kind]
    found = []
    for run in piece.of(kind):
        inner = run[EDGE : len(run) - EDGE]
        starts = range(0, len(inner) - length + 1, hop)
        if starts:
            found.append(np.stack([_posed(inner[s : s + length]) for s in starts]))
    return found


def _posed(window: Floats) -> Floats:
    """Level removed, the liveliest taxel first."""
    level = window - window.mean(axis=0)
    order = np.argsort(-np.diff(level, axis=0).std(axis=0), kind="stable")
    out: Floats = level[:, order]
    return out


def real_windows(piece: Piece, state: State) -> Windows:
    """Grouped by stroke or pause."""
    parts = windows_of(piece, state)
    if not parts:
        return Windows(np.zeros((0, 0, 0)), np.zeros(0, np.intp))
    return Windows(np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(p) for p in parts]))


def simulated_windows(
    made: Sequence[Piece], state: State, most: int, rng: np.random.Generator
) -> Windows:
    """At most so many, as evenly over the recordings as they go; grouped by recording."""
    of: dict[int, list[Floats]] = {}
    for piece in made:
        of.setdefault(piece.source, []).extend(windows_of(piece, state))
    whole = {source: np.concatenate(parts) for source, parts in of.items() if parts}
    if not whole:
        return Windows(np.zeros((0, 0, 0)), np.zeros(0, np.intp))
    each = max(1, most // len(whole))
    values, group = [], []
    for source, rows in whole.items():
        chosen = rng.permutation(len(rows))[:each]
        values.append(rows[chosen])
        group.append(np.full(len(chosen), source))
    return Windows(np.concatenate(values), np.concatenate(group))


def window_statistics(values: Floats) -> Floats:
    """(n, features) of windows (n, samples, taxels): sizes as logarithms, shapes as they are."""
    rows = []
    for window in values:
        changes = np.diff(window, axis=0)
        sizes = np.sqrt((changes**2).mean(axis=0)) + 0.2
        busy = changes[:, :2]
        second = np.sqrt((np.diff(busy, axis=0) ** 2).mean()) / np.sqrt((busy**2).mean() + 0.04)
        spread = np.linalg.svd(changes - changes.mean(axis=0), compute_uv=False) ** 2
        amplitude = np.abs(np.fft.rfft(window[:, :2], axis=0))[1:].mean(axis=1)
        bands = [np.log(part.mean() + 1.0) for part in np.array_split(amplitude, 5)]
        pair = (busy[:, 0] * busy[:, 1]).mean() / (sizes[0] * sizes[1])
        common = np.log(np.abs(changes.sum(axis=1)).mean() + 0.2)
        rows.append([
            *np.log(sizes), *np.log(window.std(axis=0) + 0.2)[:3], second, lag_one(busy + 1e-6),
            spread[0] / max(spread.sum(), 1e-9), pair, *bands, common,
            np.log(np.abs(busy).max() + 0.2),
        ])  # fmt: skip
    out: Floats = np.nan_to_num(np.array(rows))
    return out


def convolved(values: Floats, seed: int) -> Floats:
    """(n, 2 kernels) features of windows (n, samples, taxels): of each random kernel, the largest
    value and the share of values above zero."""
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


def _standardised(train: Floats, test: Floats) -> tuple[Floats, Floats]:
    mean, std = train.mean(axis=0), train.std(axis=0) + 1e-9
    return (train - mean) / std, (test - mean) / std


def _balance(label: NDArray[np.bool_]) -> Floats:
    """Weights (n,) with which either class counts as much as the other, one on average."""
    share = label.mean()
    out: Floats = np.where(label, 0.5 / share, 0.5 / (1.0 - share))
    return out


def logistic_scores(train: Floats, label: NDArray[np.bool_], test: Floats) -> Floats:
    """Log odds (m,) of a penalised logistic regression, by Newton's method."""
    a, b = _standardised(train, test)
    a, b = np.c_[a, np.ones(len(a))], np.c_[b, np.ones(len(b))]
    weight, penalty = _balance(label), LOGISTIC_PENALTY * np.eye(a.shape[1])
    penalty[-1, -1] = 1e-6
    beta = np.zeros(a.shape[1])
    for _ in range(NEWTON_STEPS):
        p = 1.0 / (1.0 + np.exp(-np.clip(a @ beta, -30.0, 30.0)))
        gradient = a.T @ (weight * (p - label)) + penalty @ beta
        curvature = (a * (weight * p * (1.0 - p))[:, None]).T @ a + penalty
        beta -= np.linalg.solve(curvature, gradient)
    out: Floats = b @ beta
    return out


def ridge_scores(train: Floats, label: NDArray[np.bool_], test: Floats) -> list[Floats]:
    """Scores (m,) of a weighted ridge regression on +-1, for each penalty."""
    a, b = _standardised(train, test)
    weight = _balance(label)
    root = np.sqrt(weight)[:, None]
    u, s, vt = np.linalg.svd(a * root, full_matrices=False)
    target = u.T @ (root[:, 0] * np.where(label, 1.0, -1.0))
    return [b @ (vt.T @ (s / (s**2 + c) * target)) for c in PENALTIES]


class _Scored(msgspec.Struct, frozen=True, eq=False):
    """Of each fold: scores of the real and of the simulated windows that were held out."""

    real: list[Floats]
    simulated: list[Floats]
    source: list[NDArray[np.intp]]

    def auc(self) -> float:
        values = [_auc(r, s) for r, s in zip(self.real, self.simulated, strict=True)]
        return float(np.average(values, weights=[len(r) for r in self.real]))

    def interval(self, rng: np.random.Generator) -> tuple[float, float]:
        """95 %, folds (strokes or pauses) and recordings drawn anew."""
        means = []
        for _ in range(RESAMPLES):
            values, sizes = [], []
            for f in rng.integers(0, len(self.real), len(self.real)):
                sources = np.unique(self.source[f])
                drawn = rng.choice(sources, len(sources))
                times = np.bincount(drawn, minlength=sources.max() + 1)[self.source[f]]
                values.append(_auc(self.real[f], np.repeat(self.simulated[f], times)))
                sizes.append(len(self.real[f]))
            means.append(float(np.average(values, weights=sizes)))
        means.sort()
        return quantile(means, 0.025), quantile(means, 0.975)


def _auc(real: Floats, simulated: Floats) -> float:
    label = np.r_[np.ones(len(real), bool), np.zeros(len(simulated), bool)]
    value = auc(np.r_[real, simulated], label)
    return 0.5 if value is None else value


def _contest(real: Windows, simulated: Windows, seed: int) -> tuple[str, _Scored]:
    """The stronger classifier, and what it gave to the windows that were held out."""
    runs = np.unique(real.group)
    fold_of_run = {int(run): k for k, run in enumerate(runs)}
    sources = np.unique(simulated.group)
    shuffled = np.random.default_rng([seed, 1]).permutation(sources)
    fold_of_source = {int(s): k % len(runs) for k, s in enumerate(shuffled)}
    values = np.concatenate([real.values, simulated.values])
    label = np.r_[np.ones(len(real.values), bool), np.zeros(len(simulated.values), bool)]
    fold = np.array(
        [fold_of_run[int(g)] for g in real.group]
        + [fold_of_source[int(g)] for g in simulated.group]
    )
    features = {"statistics": window_statistics(values), "convolutions": convolved(values, seed)}
    names = ["statistics"] + [f"convolutions ({c:g})" for c in PENALTIES]
    scored = {name: _Scored([], [], []) for name in names}
    for k in range(len(runs)):
        train, test = fold != k, fold == k
        if not (label & test).any() or not (~label & test).any():
            continue
        x = features["statistics"]
        every = [logistic_scores(x[train], label[train], x[test])]
        x = features["convolutions"]
        every += ridge_scores(x[train], label[train], x[test])
        for name, scores in zip(names, every, strict=True):
            scored[name].real.append(scores[label[test]])
            scored[name].simulated.append(scores[~label[test]])
            scored[name].source.append(simulated.group[fold[len(real.group) :] == k])
    best = max(names, key=lambda name: scored[name].auc())
    return best, scored[best]


def tell_apart(
    clip: Piece, made: Sequence[Piece], state: State, controls: int = 12, most: int = 600,
    seed: int = 0,
) -> Apart | None:  # fmt: skip
    """None where clip or set have too few windows, or the clip less than two strokes or pauses."""
    rng = np.random.default_rng([seed, 0])
    real, simulated = real_windows(clip, state), simulated_windows(made, state, most, rng)
    if min(len(real.values), len(simulated.values)) < LEAST_WINDOWS:
        return None
    if len(np.unique(real.group)) < 2 or len(np.unique(simulated.group)) < 4:
        return None
    name, scored = _contest(real, simulated, seed)
    low, high = scored.interval(rng)
    control: list[float] = []
    for index in rng.permutation(len(made)):
        other = real_windows(made[index], state)
        if len(control) == controls:
            break
        if len(np.unique(other.group)) < 2 or len(other.values) < LEAST_WINDOWS:
            continue
        other = Windows(other.values[: len(real.values)], other.group[: len(real.values)])
        if len(np.unique(other.group)) < 2:
            continue
        rest = simulated.group != made[index].source
        against = Windows(simulated.values[rest], simulated.group[rest])
        control.append(_contest(other, against, seed)[1].auc())
    return Apart(
        state, scored.auc(), low, high, name, len(real.values), len(simulated.values),
        sorted(control),
    )  # fmt: skip
