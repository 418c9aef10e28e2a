"""The picture of the reaction study. Needs the extra `charts`."""

import math
from pathlib import Path
from typing import Any

from detector.scores.quantiles import Quantiles
from grasp.files import save_figure
from scenarios.studies.reaction.summary import LatencyCurve, ReactionSummary

COLOURS = {
    "ball": "#b5432a", "foam": "#d98e04", "football": "#7a5195",
    "box": "#1f5f99", "cardboard": "#8c6d31", "can": "#3a7d44",
}  # fmt: skip
HUMAN_MS, HUMAN_SPREAD_MS = 74.0, 9.0  # reflex to slip: Johansson and Westling 1984; paper: ~75
PAPER_MS = 134.0  # paper, section IV-D: slip to decision, the hand not included
SLIP_TOP_MM = 60.0


def draw_reaction(summary: ReactionSummary, out: Path) -> None:
    """Success and median slip over reaction latency, a column a closing speed; below, what faster
    detectors are worth."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"
    speeds = sorted({curve.speed_mps for curve in summary.curves})
    figure = plt.figure(figsize=(3.2 * len(speeds) + 1.2, 9.5), layout="constrained")
    rows: Any = figure.subfigures(2, 1, height_ratios=(2, 1))
    axes = rows[0].subplots(2, len(speeds), sharex=True, sharey="row", squeeze=False)
    for column, speed in enumerate(speeds):
        _draw_speed(axes[:, column], summary, speed)
    axes[0, 0].set_ylabel("held")
    axes[1, 0].set_ylabel("slip distance, mm\nmedian, band 10-90 %; lost = off the top")
    curves = len(dict.fromkeys(curve.object for curve in summary.curves))
    lines, labels = axes[0, 0].get_legend_handles_labels()
    axes[0, -1].legend(lines[:curves], labels[:curves], fontsize=7, loc="lower left")
    axes[1, -1].legend(lines[curves:], labels[curves:], fontsize=7, loc="upper left")
    held = all(each.success == 1.0 for each in summary.faster)
    rows[1].suptitle(
        f"What a faster detector is worth{': all are held with each' if held else ''}", fontsize=10
    )
    _draw_faster(rows[1], summary, held)
    figure.suptitle(
        f"What a millisecond is worth: profile {summary.profile}, {summary.seeds} seeds, simulated",
        fontsize=11,
    )
    save_figure(figure, out, dpi=110)
    plt.close(figure)


def _draw_speed(axes: Any, summary: ReactionSummary, speed: float) -> None:
    success, slip = axes
    for curve in summary.curves:
        if curve.speed_mps == speed:
            _draw_curve(success, slip, curve)
    success.set(title=f"fingers close at {speed * 1e3:.0f} mm/s", ylim=(-0.03, 1.05))
    slip.set(xlabel="slip onset to the fingers' first motion, ms", ylim=(0, SLIP_TOP_MM))
    for each in axes:
        _draw_marks(each, summary)


def _draw_curve(success: Any, slip: Any, curve: LatencyCurve) -> None:
    colour = COLOURS.get(curve.object)
    t = [p.latency_ms for p in curve.points]
    success.plot(t, [p.success for p in curve.points], color=colour, marker=".", label=curve.object)
    low = [_mm(p.slip_mm.p10) for p in curve.points]
    high = [_mm(p.slip_mm.p90) for p in curve.points]
    slip.fill_between(t, low, high, color=colour, alpha=0.12, lw=0)
    slip.plot(t, [_mm(p.slip_mm.p50) for p in curve.points], color=colour, marker=".")


def _mm(value: float) -> float:
    return min(value, 2 * SLIP_TOP_MM)


def _draw_marks(axes: Any, summary: ReactionSummary) -> None:
    axes.axvspan(HUMAN_MS - HUMAN_SPREAD_MS, HUMAN_MS + HUMAN_SPREAD_MS, color="#00000018", lw=0)
    axes.axvline(HUMAN_MS, color="black", lw=0.6, ls=":", label="human reflex, 74 ± 9 ms")
    axes.axvline(PAPER_MS, color="#b00020", lw=0.9, ls="--", label="paper, to the decision: 134 ms")
    found = [q.p50 for q in summary.reaction_latency_ms.values() if q is not None]
    ours = [p50 for p50 in found if math.isfinite(p50)]
    if ours:
        label = f"{summary.detector}, this hand: {min(ours):.0f}-{max(ours):.0f} ms"
        axes.axvspan(min(ours), max(ours), color="#1f5f9922", lw=0, label=label)


def _draw_faster(figure: Any, summary: ReactionSummary, all_held: bool) -> None:
    """Success and slip distance; where all are held, that is no picture."""
    axes = figure.subplots(1, 1 if all_held else 2, squeeze=False)[0]
    slip = axes[-1]
    factors = sorted({each.factor for each in summary.faster})
    names = list(dict.fromkeys(each.object for each in summary.faster))
    width = 0.8 / max(1, len(factors))
    for i, factor in enumerate(factors):
        got = {each.object: each for each in summary.faster if each.factor == factor}
        at = [k + (i - (len(factors) - 1) / 2) * width for k in range(len(names))]
        shade = ("#b8c7d9", "#5d8ab5", "#153f6b")[min(i, 2)]
        label = f"{summary.detector} as it is" if factor == 1 else f"{factor:g} times as fast"
        if not all_held:
            axes[0].bar(at, [got[n].success for n in names], width, color=shade)
            axes[0].set_ylabel("held")
        slips = [got[n].slip_mm for n in names]
        slip.bar(at, [_mm(s.p50) for s in slips], width, color=shade, label=label)
        slip.errorbar(
            at, [_mm(s.p50) for s in slips], _spread(slips), fmt="none", ecolor="black", lw=0.7
        )
    tops = [_mm(each.slip_mm.p90) for each in summary.faster]
    slip.set_ylim(0, min(SLIP_TOP_MM, 1.15 * max(tops, default=SLIP_TOP_MM)))
    slip.set_ylabel("slip distance, mm (10-50-90 %)")
    slip.legend(fontsize=7, loc="upper right")
    for each in axes:
        each.set_xticks(range(len(names)), names)


def _spread(slips: list[Quantiles]) -> list[list[float]]:
    low = [max(0.0, _mm(s.p50) - _mm(s.p10)) for s in slips]
    high = [max(0.0, _mm(s.p90) - _mm(s.p50)) for s in slips]
    return [[x if math.isfinite(x) else 0.0 for x in part] for part in (low, high)]
