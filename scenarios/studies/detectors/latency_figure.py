"""The picture of latency. Needs the extra `charts`."""

from pathlib import Path

import numpy as np

from scenarios.studies.detectors.figures import panels, save
from scenarios.studies.detectors.latency import AUTHORS_MS, Latency

OURS, THEIRS = "#1f5f99", "black"
BIN_MS, SHOWN_MS = 10.0, 400.0


def draw_latency(found: Latency, out: Path) -> None:
    """Histogram of the delays, and the share of slips registered by then."""
    figure, (histogram, share) = panels(2, (10, 3.8))
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
        theirs = f"authors' mean, real fingertip: {AUTHORS_MS:.0f} ms"
        panel.axvline(AUTHORS_MS, color=THEIRS, lw=0.9, ls="--", label=theirs)
        ours = f"mean of those caught: {found.mean_ms:.0f} ms"
        panel.axvline(found.mean_ms, color=OURS, lw=0.9, label=ours)
        panel.set(xlabel="delay from the label's rise, ms", xlim=(-2 * BIN_MS, SHOWN_MS))
    histogram.legend(fontsize=8, frameon=False)
    figure.suptitle(
        f"How late slip is registered: {found.detector}, {found.rule}, label {found.label}",
        fontsize=11,
    )
    save(figure, out)
