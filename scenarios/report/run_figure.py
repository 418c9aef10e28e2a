"""Pictures of a run, drawn from its recording. Needs the extra `charts`."""

from pathlib import Path
from typing import Any

import numpy as np

from drivers.interfaces import FINGER_NAMES
from grasp.files import save_figure
from scenarios.report.run_decision import decided
from scenarios.report.run_record import RunRecord, read_run
from scenarios.trial.result import spelt

COLOURS = {"A": "#1f5f99", "B": "#c2571a", "C": "#3a7d44"}
LIMIT_COLOUR, TURN_COLOUR = "#b00020", "#7a4a9e"
LOWERING_SHOWN_S = 0.3
LEAST_TURN_DEG = 0.1
LEAST_ACROSS_MM = 0.1
NAMES_APART = 0.03  # of phases, as a share of what is shown: less and they would overlap
SHADES = {
    "grasp.brace": "#eef3f8", "grasp.close": "#e8eff5", "grasp.settle": "#eef3f8",
    "grasp.baseline": "#e8eff5", "lift": "#e0eaf4", "compensate": "#fde3c8", "hold": "#e3f1e3",
    "lower.descend": "#f3f3f3", "lower.feel": "#fde3c8", "fault": "#f8d7d7",
}  # fmt: skip


def draw_run(path: Path, out: Path) -> None:
    """Force, slip probability and slip distance of a run over time, phases shaded, into ``out``.
    Raises BadFile as ``read_run``."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    run = read_run(path)
    plt.rcParams["svg.hashsalt"] = "grasp"  # the same run gives the same file
    figure, (force, p, slip) = plt.subplots(
        3, 1, sharex=True, figsize=(9, 6.4), height_ratios=(3, 2, 2), layout="constrained"
    )
    figure.suptitle(title(run), fontsize=10)
    _draw_force(force, run)
    _draw_decision(p, run)
    _draw_slip(slip, run)
    slip.set(ylabel="slip, mm (true)", xlabel="time, s")
    _draw_turn(slip, run)
    for axes in (force, p, slip):
        _shade(axes, run, named=axes is force)
    force.legend(loc="lower right", ncols=5, fontsize=8, frameon=False)
    save_figure(figure, out, dpi=120)
    plt.close(figure)


def title(run: RunRecord) -> str:
    """What was run, and what came of it."""
    told = f"{run.scenario} of {run.told.object.name}, seed {run.seed}, {run.told.detector_name}"
    if run.verdict is None:
        return told
    return f"{told}: {spelt(run.verdict.outcome)}"


def _draw_force(axes: Any, run: RunRecord) -> None:
    for i, name in enumerate(FINGER_NAMES):
        label = f"{name} (thumb)" if i == 0 else name
        felt = None if run.truth is not None else label
        axes.plot(run.t_s, run.felt_n[:, i], color=COLOURS[name], lw=0.7, alpha=0.6, label=felt)
        if run.truth is not None:
            axes.plot(run.t_s, run.truth.normal_n[:, i], color=COLOURS[name], lw=1.4, label=label)
    limit_n = run.told.guard.force_limit_n
    axes.axhline(limit_n, color=LIMIT_COLOUR, lw=1, ls="--", label=f"limit {limit_n:g} N")
    known = "(thin: felt, thick: true)" if run.truth is not None else "(felt)"
    axes.set_ylabel(f"grip force, N\n{known}")


def _draw_decision(axes: Any, run: RunRecord) -> None:
    """Probabilities, and what the rule made of them beside what it had to pass."""
    by_rule = decided(run.told.rule, run.probabilities, run.armed, run.masked)
    for i, name in enumerate(FINGER_NAMES):
        axes.plot(run.t_s, run.probabilities[:, i], color=COLOURS[name], lw=0.8)
    axes.set(ylabel="slip probability", ylim=(0, 1.05))
    judged, what = axes, "threshold"
    if not by_rule.probable:
        judged, what = axes.twinx(), "limit"
        judged.set(ylabel="summed log-odds", ylim=(0, 4 * by_rule.limit))
    if by_rule.values.shape[1] == 1:
        judged.plot(run.t_s, by_rule.values, color="black", lw=1.2, label=by_rule.label)
    elif not by_rule.probable:
        for i, name in enumerate(FINGER_NAMES):
            judged.plot(run.t_s, by_rule.values[:, i], color=COLOURS[name], lw=1.2, ls="--")
    label = f"{what} {by_rule.limit:g}"
    judged.axhline(by_rule.limit, color=LIMIT_COLOUR, lw=0.8, ls=":", label=label)
    judged.legend(loc="upper right", ncols=2, fontsize=8, frameon=False)


def _draw_slip(axes: Any, run: RunRecord) -> None:
    """How far the object slid down through the fingers, and aside where it did."""
    if run.truth is None:
        return
    down_mm, across_mm = 1e3 * run.truth.slip_m, 1e3 * run.truth.across_m
    axes.plot(run.t_s, down_mm, color="black", lw=1.2, label="down")
    first, last = _shown(run)
    seen = (run.t_s >= first) & (run.t_s <= last)
    least, most = -1.0, max(2.0, float(down_mm[seen].max()))
    aside = across_mm[seen]
    if np.abs(aside).max() >= LEAST_ACROSS_MM:
        axes.plot(run.t_s, across_mm, color="black", lw=1.2, ls="--", label="aside")
        axes.legend(loc="upper left", fontsize=8, frameon=False)
        least, most = min(least, 1.15 * float(aside.min())), max(most, float(aside.max()))
    axes.set_ylim(least, 1.15 * most)


def _draw_turn(slip: Any, run: RunRecord) -> None:
    """Rotation in the hand, on a scale of its own, where there is any."""
    turned = None if run.truth is None else np.degrees(run.truth.turn_rad)
    if turned is None or np.abs(turned).max() < LEAST_TURN_DEG:
        return
    axes = slip.twinx()
    axes.plot(run.t_s, turned, color=TURN_COLOUR, lw=1.2)
    axes.set_ylabel("turned, deg (true)", color=TURN_COLOUR)


def _shown(run: RunRecord) -> tuple[float, float]:
    begins = {change.phase: change.t_ns * 1e-9 for change in run.phases}
    end = begins.get("lower.descend", float(run.t_s[-1]) - LOWERING_SHOWN_S)
    return begins.get("grasp.brace", float(run.t_s[0])), end + LOWERING_SHOWN_S


def _shade(axes: Any, run: RunRecord, named: bool) -> None:
    """Phases as background, from the grasp until the object is set down, and when slip began."""
    starts = [change.t_ns * 1e-9 for change in run.phases]
    first, last = _shown(run)
    axes.set_xlim(first, last)
    beside = first - NAMES_APART * (last - first)  # of the name before
    for change, start, end in zip(
        run.phases, starts, [*starts[1:], float(run.t_s[-1])], strict=True
    ):
        if change.phase not in SHADES:
            continue
        axes.axvspan(start, end, color=SHADES[change.phase], lw=0, zorder=0)
        if named and start <= last:
            beside = max(start, beside + NAMES_APART * (last - first))
            axes.annotate(
                change.phase.rpartition(".")[2], (beside, 1.0), xytext=(2, 2), fontsize=8,
                xycoords=("data", "axes fraction"), textcoords="offset points", rotation=40,
                annotation_clip=True,
            )  # fmt: skip
    if run.truth is not None and run.truth.onset_s is not None:
        axes.axvline(run.truth.onset_s, color=LIMIT_COLOUR, lw=0.8, label="slip begins")
