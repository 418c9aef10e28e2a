"""What detectors endure, as curves. Needs the extra `charts`."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from grasp.files import save_figure
from scenarios.studies.detectors.figures import in_colour
from scenarios.studies.detectors.robustness import AMOUNTS, PAD, STIFFER, UNITS, WHOLE, Endured

FIGURES = (
    ("accuracy", "accuracy a sample, %", 100.0),
    ("delay_ms", "p90 delay, ms\n(600 and more: a miss)", 1.0),
    ("false_per_min", "false a minute, hand", 1.0),
    ("far_share", "blows of 2 mm\nwithin 100 ms, %", 100.0),
)
BROKEN = ("dead", "stuck", "swapped", PAD)  # drawn side by side in one column
LATEST_MS = 600.0  # a miss is drawn there


def draw_robustness(found: Mapping[str, Sequence[Endured]], out: Path) -> None:
    """A row a figure, a column a perturbation; a line a detector."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"
    curves = [kind for kind in AMOUNTS if kind not in BROKEN]
    figure, panels = plt.subplots(
        len(FIGURES), len(curves) + 1, figsize=(15, 8.5), sharey="row", layout="constrained"
    )
    for row, (key, title, scale) in zip(panels, FIGURES, strict=True):
        row[0].set_ylabel(title, fontsize=8)
        for (_, every), colour in in_colour(found.items()):
            for panel, kind in zip(row, curves, strict=False):
                at = {WHOLE.get(kind, 0.0): every[0]}
                at |= {e.amount: e for e in every if e.kind == kind}
                panel.plot(sorted(at), [_value(at[a], key, scale) for a in sorted(at)], "o-",
                           color=colour, ms=3, lw=1)  # fmt: skip
            which = {"nothing": every[0]} | {e.kind: e for e in every if e.kind in BROKEN}
            row[-1].plot(
                list(which), [_value(e, key, scale) for e in which.values()], "o", color=colour,
                ms=4,
            )  # fmt: skip
        for panel in row:
            panel.tick_params(labelsize=7)
    for panel, kind in zip(panels[-1], curves, strict=False):
        panel.set_xlabel(f"{kind}, {UNITS[kind]}", fontsize=8)
    for panel in panels[:-1].ravel():
        panel.tick_params(labelbottom=False)
    panels[-1][-1].set_xlabel(f"a taxel of 18;\nthe pad {STIFFER:g} times as stiff", fontsize=8)
    panels[-1][-1].tick_params(axis="x", labelrotation=45)
    figure.suptitle("What detectors endure: one thing wrong at a time", fontsize=11)
    _legend(figure, found)
    save_figure(figure, out, dpi=120)
    plt.close(figure)


def _value(e: Endured, key: str, scale: float) -> float:
    if key == "delay_ms":
        return math.nan if e.delay_ms is None else min(e.delay_ms.p90, LATEST_MS)
    value: float | None = getattr(e, key)
    return math.nan if value is None else scale * value


def _legend(figure: Any, found: Mapping[str, Sequence[Endured]]) -> None:
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], color=c) for _, c in in_colour(found)]
    figure.legend(lines, list(found), loc="outside lower center", ncols=len(found), fontsize=8)
