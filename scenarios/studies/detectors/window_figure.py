"""The picture of the window sweep. Needs the extra `charts`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.studies.detectors.figures import panels, save
from scenarios.studies.detectors.variants import Trained

# The authors' published training reports, 400 epochs: accuracy by window, per cent.
AUTHORS_WINDOWS = (10, 20, 30, 40, 50, 60, 70, 80, 90, 100)
AUTHORS_ACCURACY = (81.0, 82.4, 87.3, 87.6, 88.2, 89.6, 90.1, 90.2, 90.8, 90.8)
OURS, THEIRS = "#1f5f99", "black"


def draw_windows(rows: Sequence[Trained], out: Path) -> None:
    """Accuracy, delay and cost against the window; a point a training, lines through the means."""
    figure, (accuracy, delay, cost) = panels(3, (12, 3.8))
    accuracy.plot(
        AUTHORS_WINDOWS, AUTHORS_ACCURACY, color=THEIRS, lw=0.8, ls="--",
        label="authors, real fingertip, 400 epochs",
    )  # fmt: skip
    _points(accuracy, rows, [100 * r.accuracy for r in rows], "ours, simulated", "o")
    _points(delay, rows, [r.delay_ms.p50 if r.delay_ms else np.nan for r in rows], "median", "o")
    _points(delay, rows, [r.delay_ms.p90 if r.delay_ms else np.nan for r in rows], "90 %", "^")
    _points(cost, rows, [r.compute_us or np.nan for r in rows], "", "o")
    accuracy.set(ylabel="accuracy a sample, %")
    delay.set(ylabel="delay with the paper's rule, ms")
    cost.set(ylabel="one update of a finger, µs (median)")
    cost.set_ylim(bottom=0.0)
    for panel in (accuracy, delay, cost):
        panel.set_xlabel("window, samples of 10 ms")
    for panel in (accuracy, delay):
        panel.legend(fontsize=8, frameon=False)
    figure.suptitle("What a longer window is worth: the paper's network", fontsize=11)
    save(figure, out)


def _points(
    panel: Any, rows: Sequence[Trained], values: Sequence[float], label: str, mark: str
) -> None:
    windows = np.array([r.variant.window for r in rows])
    known = np.array(values)
    panel.plot(windows, known, mark, color=OURS, ms=4, alpha=0.6)
    every = np.unique(windows)
    means = [known[windows == w].mean() for w in every]
    panel.plot(every, means, color=OURS, lw=1, ls="-" if mark == "o" else ":", label=label)
