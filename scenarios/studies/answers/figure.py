"""The picture of the study. Needs the extra `charts`."""

import math
from pathlib import Path
from typing import Any

from grasp.files import save_figure
from scenarios.studies.answers.study import BASE, POLICIES
from scenarios.studies.answers.summary import Answers, Cell

COLOURS = ("#b5432a", "#d98e04", "#1f5f99", "#9bc2a3", "#5fa06e", "#2a6b3c", "#777777")
SLIP_TOP_MM = 40.0


def draw_answers(found: Answers, out: Path) -> None:
    """Force against slip, a point a policy; below, success in harder scenes."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"
    axes_of = list(dict.fromkeys(c.axis for c in found.cells if c.axis != BASE.axis))
    figure = plt.figure(figsize=(10, 8.5 if axes_of else 5), layout="constrained")
    rows: Any = figure.subfigures(2 if axes_of else 1, 1, squeeze=False)
    _draw_force(rows[0, 0].subplots(), [c for c in found.cells if c.scene == BASE.name])
    if axes_of:
        panels = rows[1, 0].subplots(1, len(axes_of), sharey=True, squeeze=False)[0]
        for axes, axis in zip(panels, axes_of, strict=True):
            _draw_axis(axes, [c for c in found.cells if c.axis in (axis, BASE.axis)], axis)
    figure.suptitle(
        f"Answers to slip: {found.seeds} seeds of {len(found.objects)} objects, detector "
        f"{found.detector}, rig {found.rig}", fontsize=11,
    )  # fmt: skip
    save_figure(figure, out, dpi=110)
    plt.close(figure)


def _colour(policy: str) -> str:
    return COLOURS[next(i for i, p in enumerate(POLICIES) if p.name == policy)]


def _draw_force(axes: Any, cells: list[Cell]) -> None:
    for cell in cells:
        force, slip = cell.over_least, cell.slip_mm
        if force is None or slip is None or not math.isfinite(slip.p50):
            continue
        top = min(slip.p90, 2 * SLIP_TOP_MM)
        axes.errorbar(
            force.p50, slip.p50, xerr=[[force.p50 - force.p10], [force.p90 - force.p50]],
            yerr=[[slip.p50 - slip.p10], [top - slip.p50]], fmt="o", capsize=2,
            color=_colour(cell.policy), label=cell.policy,
        )  # fmt: skip
        if cell.policy in (POLICIES[0].name, POLICIES[-1].name):
            axes.axhline(slip.p50, color=_colour(cell.policy), lw=0.8, ls="--")
    axes.axvline(1.0, color="black", lw=0.9, ls=":", label="least force")
    axes.set(
        xlabel="force at the thumb over the least that carries the weight (median, 10-90 %)",
        ylabel="slip distance, mm (median, 10-90 %)", ylim=(0, SLIP_TOP_MM / 2), xlim=(0.9, None),
    )  # fmt: skip
    axes.legend(fontsize=7)


def _draw_axis(axes: Any, cells: list[Cell], axis: str) -> None:
    for policy in dict.fromkeys(c.policy for c in cells):
        line = sorted((c for c in cells if c.policy == policy), key=lambda c: c.value)
        x, y = [c.value for c in line], [c.held / c.trials for c in line]
        axes.plot(x, y, marker=".", color=_colour(policy), label=policy)
    bound = sorted({(c.value, c.feasible / c.trials) for c in cells})
    axes.plot(*zip(*bound, strict=True), color="black", lw=0.9, ls=":", label="10 N can hold")
    axes.set(xlabel=axis, ylim=(-0.03, 1.05))
    axes.set_ylabel("held" if axes.get_subplotspec().is_first_col() else "")
