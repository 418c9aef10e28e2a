"""How sure a figure is: 95 % bootstrap intervals over what is independent of one another.

Samples of one stroke are no independent witnesses. Of a data set whole recordings are drawn, of a
single recording whole strokes and pauses.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from detector.scores.events import Judgement
from detector.scores.metrics import Floats, Labels, Ranking
from detector.scores.quantiles import quantile

Interval = tuple[float, float]
LOW, HIGH = 0.025, 0.975
RESAMPLES_OF_A_SET, RESAMPLES_OF_A_RECORDING = 300, 1000


def stroke_intervals(
    probabilities: Floats, labels: Labels, threshold: float, seed: int = 0
) -> dict[str, Interval]:
    """AUC and accuracy of one recording; nothing with fewer than two strokes or two pauses."""
    block = np.concatenate([[0], np.cumsum(labels[1:] != labels[:-1])])
    is_slip = labels[np.unique(block, return_index=True)[1]]
    strokes, pauses = np.flatnonzero(is_slip), np.flatnonzero(~is_slip)
    if min(len(strokes), len(pauses)) < 2:
        return {}
    rng = np.random.default_rng(seed)
    drawn = [
        np.concatenate([rng.choice(kind, len(kind)) for kind in (strokes, pauses)])
        for _ in range(RESAMPLES_OF_A_RECORDING)
    ]
    return _of_samples(probabilities, labels, threshold, block, drawn)


def recording_intervals(
    parts: Sequence[tuple[Floats, Labels]],
    judged: Sequence[Judgement],
    threshold: float,
    seed: int = 0,
) -> dict[str, Interval]:
    """AUC, accuracy, recall, false events a minute and median delay of several recordings."""
    rng = np.random.default_rng(seed)
    drawn = [rng.integers(0, len(parts), len(parts)) for _ in range(RESAMPLES_OF_A_SET)]
    block = np.repeat(np.arange(len(parts)), [len(labels) for _, labels in parts])
    p, labels = (np.concatenate(column) for column in zip(*parts, strict=True))
    found = _of_samples(p, labels, threshold, block, drawn)
    false, missed, slips, static_s = (
        np.array([f(j) for j in judged], np.float64)
        for f in (
            lambda j: j.false, lambda j: j.missed, lambda j: len(j.delays_ms), lambda j: j.static_s,
        )
    )  # fmt: skip
    if static_s.all():
        rates = [60.0 * false[d].sum() / static_s[d].sum() for d in drawn]
        found["false_events_per_min"] = _interval(rates)
    if slips.all():
        found["event_recall"] = _interval([1 - missed[d].sum() / slips[d].sum() for d in drawn])
    if slips.any():
        delays = [np.concatenate([judged[i].delays_ms for i in d]) for d in drawn]
        found["delay_ms_p50"] = _interval([quantile(np.sort(d), 0.5) for d in delays if len(d)])
    return found


def _of_samples(
    probabilities: Floats,
    labels: Labels,
    threshold: float,
    block: NDArray[np.intp],
    drawn: Sequence[NDArray[np.intp]],
) -> dict[str, Interval]:
    """AUC and accuracy with each sample as heavy as its block was drawn often."""
    blocks = int(block[-1]) + 1
    right = np.bincount(block, (probabilities > threshold) == labels)
    size = np.bincount(block)
    ranking = Ranking(probabilities, labels)
    accuracies, areas = [], []
    for d in drawn:
        times = np.bincount(d, minlength=blocks).astype(np.float64)
        accuracies.append(float((right * times).sum() / (size * times).sum()))
        area = ranking.auc(times[block])
        if area is not None:
            areas.append(area)
    found = {"accuracy": _interval(accuracies)}
    if areas:
        found["auc"] = _interval(areas)
    return found


def _interval(values: Sequence[float]) -> Interval:
    ordered = sorted(values)
    return quantile(ordered, LOW), quantile(ordered, HIGH)
