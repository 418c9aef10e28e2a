"""The paper's tables of detection, its figures beside ours.

Theirs are of a real fingertip, ours of a simulated one: two columns, no contest.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from detector.scores.evaluation import WARM_UP_SAMPLES, Evaluation, Streamed
from detector.scores.metrics import confusion

# accuracy, precision, recall, F1, each weighted over both classes, per cent
PAPER_METHODS = {
    "psd": (57.4, 57.9, 57.4, 57.5),
    "freq-cnn-paper": (86.0, 86.0, 86.0, 86.0),
    "tcn-paper": (91.3, 91.4, 91.4, 91.4),
}
SURFACES = ("planar", "sphere", "cylinder-y", "cylinder-x")
# weighted F1 of the TCN, per cent, a column a surface
PAPER_CELLS = {
    ("primary", 0.05): (92.5, 88.8, 78.7, 94.0),
    ("primary", 0.075): (94.9, 88.0, 90.0, 90.3),
    ("primary", 0.1): (95.7, 84.5, 87.8, 92.1),
    ("oblique", 0.05): (94.0, 88.9, 87.1, 93.2),
    ("oblique", 0.075): (96.6, 89.3, 93.7, 92.2),
    ("oblique", 0.1): (96.4, 88.6, 93.5, 93.4),
    ("rotation", 0.0): (84.6, 74.5, 84.0, 86.1),
}
STATEMENT = (
    "The paper's figures are of a real fingertip, ours of a simulated one: they cannot be compared "
    "with one another, only within their column."
)


def methods_table(sheets: Sequence[Evaluation]) -> str:
    """Table II as Markdown: a row a detector, `theirs | ours`."""
    lines = [
        "| detector | accuracy | precision | recall | F1 |",
        "|---|---|---|---|---|",
    ]
    for s in sheets:
        ours = [100 * v for v in (s.accuracy, s.weighted_precision, s.accuracy, s.weighted_f1)]
        theirs: Sequence[float | None] = PAPER_METHODS.get(s.detector, (None,) * 4)
        cells = [
            f"{'–' if t is None else format(t, '.1f')} / {o:.1f}"
            for t, o in zip(theirs, ours, strict=True)
        ]
        lines.append(f"| `{s.detector}` | {' | '.join(cells)} |")
    return "\n".join([*lines, "", f"Paper / ours, per cent. {STATEMENT}"])


def cell_f1(
    streams: Sequence[Streamed], threshold: float, first_sample: int = WARM_UP_SAMPLES
) -> dict[tuple[str, float, str], float]:
    """Weighted F1 of every (motion, commanded speed, surface) that occurs."""
    parts: dict[tuple[str, float, str], list[Streamed]] = {}
    for s in streams:
        known = s.recording.metadata
        if known is not None and known.set == "slide":
            key = (str(known.motion), round(known.speed_mps, 3), known.surface)
            parts.setdefault(key, []).append(s)
    found: dict[tuple[str, float, str], float] = {}
    for key, chosen in parts.items():
        p = np.concatenate([s.probabilities.max(axis=1)[first_sample:] for s in chosen])
        labels = np.concatenate([s.labels[first_sample:] for s in chosen])
        found[key] = confusion(p > threshold, labels).weighted_f1
    return found


def cells_table(name: str, cells: Mapping[tuple[str, float, str], float]) -> str:
    """Table III as Markdown: F1 by motion, speed and surface, `theirs / ours`."""
    lines = [
        f"| `{name}` | {' | '.join(SURFACES)} |",
        "|---|" + "---|" * len(SURFACES),
    ]
    for (motion, speed), theirs in PAPER_CELLS.items():
        row = []
        for surface, t in zip(SURFACES, theirs, strict=True):
            ours = cells.get((motion, speed, surface))
            row.append(f"{t:.1f} / {'–' if ours is None else format(100 * ours, '.1f')}")
        what = f"{motion} {100 * speed:g} cm/s" if speed else f"{motion} 1 rad/s"
        lines.append(f"| {what} | {' | '.join(row)} |")
    return "\n".join([*lines, "", "Weighted F1, paper's TCN / this detector, per cent."])
