"""Pictures of the paper's study: window sweep and latency. Need the extra `charts`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.studies.detectors.latency import AUTHORS_MS, Latency
from scenarios.studies.detectors.variants import Trained

# The authors' published training reports, 400 epochs: accuracy by window, per cent.
AUTHORS_WINDOWS = (10, 20, 30, 40, 50, 60, 70, 80, 90, 100)
AUTHORS_ACCURACY = (81.0, 82.4, 87.3, 87.6, 88.2, 89.6, 90.1, 90.2, 90.8, 90.8)
OURS, THEIRS = "#1f5f99", "black"
BIN_MS, SHOWN_MS = 10.0, 400.0


def draw_windows(rows: Sequence[Trained], out: Path) -> None:
    """Accuracy, delay and cost against the window; a point a training, lines through the means."""
    figure, (accuracy, delay, cost) = _panels(3, (12, 3.8))
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
    _save(figure, out)


def _points(
    panel: Any, rows: Sequence[Trained], values: Sequence[float], label: str, mark: str
) -> None:
    windows = np.array([r.variant.window for r in rows])
    known = np.array(values)
    panel.plot(windows, known, mark, color=OURS, ms=4, alpha=0.6)
    every = np.unique(windows)
    means = [known[windows == w].mean() for w in every]
    panel.plot(every, means, color=OURS, lw=1, ls="-" if mark == "o" else ":", label=label)


def draw_latency(found: Latency, out: Path) -> None:
    """Histogram of the delays, and the share of slips registered by then."""
    figure, (histogram, share) = _panels(2, (10, 3.8))
    delays = np.array([np.inf if d is None else d for d in found.delays_ms])
    edges = np.arange(-2 * BIN_MS, SHOWN_MS + BIN_MS, BIN_MS) - BIN_MS / 2
    histogram.hist(delays[np.isfinite(delays)], edges, color=OURS)
    histogram.set(ylabel=f"slips, of {len(delays)}")
    ordered = np.sort(delays)
    share.step(
        np.minimum(ordered, SHOWN_MS), (np.arange(len(ordered)) + 1.0) / len(ordered),
        where="post", color=OURS,
    )  # fmt: skip
    share.set(ylabel="share of slips registered by then", ylim=(0.0, 1.02))
    for panel in (histogram, share):
        panel.axvline(AUTHORS_MS, color=THEIRS, lw=0.9, ls="--")
        panel.axvline(found.mean_ms, color=OURS, lw=0.9)
        panel.set(xlabel="delay from the label's rise, ms", xlim=(-2 * BIN_MS, SHOWN_MS))
    histogram.annotate(
        f"authors' mean, real fingertip: {AUTHORS_MS:.0f} ms", (AUTHORS_MS, 0.95),
        xycoords=("data", "axes fraction"), xytext=(4, 0), textcoords="offset points", fontsize=8,
    )  # fmt: skip
    histogram.annotate(
        f"mean of those caught: {found.mean_ms:.0f} ms", (found.mean_ms, 0.88),
        xycoords=("data", "axes fraction"), xytext=(4, 0), textcoords="offset points", fontsize=8,
        color=OURS,
    )  # fmt: skip
    _save(figure, out)


def _panels(columns: int, size: tuple[float, float]) -> tuple[Any, Any]:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"
    return plt.subplots(1, columns, figsize=size, layout="constrained")


def _save(figure: Any, out: Path) -> None:
    from matplotlib import pyplot as plt

    figure.savefig(out, metadata={"Date": None} if out.suffix == ".svg" else None, dpi=120)
    plt.close(figure)
