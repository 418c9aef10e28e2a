"""Exports a recorded trial as CSV, or as a plot (extra `exports`), for `grasp export`."""

import csv
import io
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import asdict
from numpy.typing import NDArray

from drivers.interfaces import FINGER_NAMES
from grasp.files import save_figure
from scenarios.report.page import palette
from scenarios.report.run_record import RunRecord, read_run
from scenarios.report.run_view import bound_of, decided
from scenarios.trial.result import spelt

Floats = NDArray[np.float64]
BEGINS = "t_s,phase,"  # start of an exported table, to recognise it


def as_csv(path: Path) -> str:
    """The run as CSV, one row per control step; column names state the units, and unknown values
    are empty. Raises BadFile as ``read_run``."""
    run = read_run(path)
    columns = _columns(run)
    begins = np.array([change.t_ns * 1e-9 for change in run.phases])
    at = np.searchsorted(begins, run.t_s + 1e-9, side="right") - 1
    phases = [run.phases[i].phase if i >= 0 else "" for i in at]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["t_s", "phase", *columns])
    for i, t_s in enumerate(run.t_s):
        values = (float(column[i]) for column in columns.values())
        cells = ("" if math.isnan(value) else f"{value:.6g}" for value in values)
        writer.writerow([f"{t_s:.6f}", phases[i], *cells])
    return out.getvalue()


def _columns(run: RunRecord) -> dict[str, Floats]:
    """Columns in order, without those that the rig cannot know."""
    found: dict[str, Floats] = {
        **{name: getattr(run, name).astype(float) for name in ("armed", "masked", "registered")},
        **_by_finger("probability", run.known(run.probabilities)),
        **_by_finger("estimated_n", run.known(run.estimated_n)),
        **_by_finger("position_counts", run.fingers_counts),
        **{f"arm_{axis}_m": run.arm_m[:, i] for i, axis in enumerate("xyz")},
    }
    for i, name in enumerate(FINGER_NAMES):
        for k in range(run.counts.shape[2]):
            found[f"taxel_{name}{k}_counts"] = run.counts[:, i, k]
    if (motion := run.motion) is not None:
        for name, values in asdict(motion).items():
            found |= _by_finger(f"reported_{name}", values)
    if (truth := run.truth) is not None:
        found |= _by_finger("true_n", truth.normal_n) | _by_finger("true_shear_n", truth.shear_n)
        alone = ("height_m", "slip_m", "slip_mps", "across_m", "turn_rad")
        found |= {f"true_{name}": getattr(truth, name) for name in alone}
    return found


def _by_finger(what: str, values: Floats) -> dict[str, Floats]:
    return {f"{name}_{what}": values[:, i] for i, name in enumerate(FINGER_NAMES)}


# Pictures

COLOURS = {name: palette(f"finger{i}") for i, name in enumerate(FINGER_NAMES)}
LIMIT_COLOUR = palette("limit")
LOWERING_SHOWN_S = 0.3
NAMES_APART = 0.03  # least distance of phase names, as a share of the plot's width
SHADES = {
    "grasp.brace": "#eef3f8", "grasp.close": "#e8eff5", "grasp.settle": "#eef3f8",
    "grasp.baseline": "#e8eff5", "lift": "#e0eaf4", "compensate": "#fde3c8", "hold": "#e3f1e3",
    "lower.descend": "#f3f3f3", "lower.feel": "#fde3c8", "fault": "#f8d7d7",
}  # fmt: skip


def pyplot() -> Any:
    """pyplot for files, whatever $MPLBACKEND is: a notebook's value may not exist here."""
    os.environ["MPLBACKEND"] = "agg"
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"  # the same run gives the same file
    return plt


def draw_run(path: Path, out: Path) -> None:
    """Plot force, slip probability and slip distance of a run over time, with shaded phases, to
    ``out``. Raises BadFile as ``read_run``."""
    plt, run = pyplot(), read_run(path)
    figure, (force, p, slip) = plt.subplots(
        3, 1, sharex=True, figsize=(9, 6.4), height_ratios=(3, 2, 2), layout="constrained"
    )
    figure.suptitle(title(run), fontsize=10)
    limit_n = run.config.guard.force_limit_n
    known = run.truth is not None
    for i, name in enumerate(FINGER_NAMES):
        line: dict[str, Any] = {"color": COLOURS[name]}
        label = f"{name} (thumb)" if i == 0 else name
        force.plot(run.t_s, run.estimated_n[:, i], lw=0.7, alpha=0.6, label="" if known else label,
                   **line)  # fmt: skip
        if run.truth is not None:
            force.plot(run.t_s, run.truth.normal_n[:, i], lw=1.4, label=label, **line)
        p.plot(run.t_s, run.probabilities[:, i], lw=0.8, **line)
    force.axhline(limit_n, color=LIMIT_COLOUR, lw=1, ls="--", label=f"limit {limit_n:g} N")
    lines = "(thin: estimated, thick: true)" if known else "(estimated)"
    force.set_ylabel(f"grip force, N\n{lines}")
    p.set(ylabel="slip probability", ylim=(0, 1.05))
    _draw_decision(p, run)
    if run.truth is not None:
        slip.plot(run.t_s, 1e3 * run.truth.slip_m, color="black", lw=1.2)
        first, last = _shown(run)
        visible = (run.t_s >= first) & (run.t_s <= last)
        slip.set_ylim(-1.0, 1.15 * max(2.0, float(1e3 * run.truth.slip_m[visible].max())))
    slip.set(ylabel="slip, mm (true)", xlabel="time, s")
    for axes in (force, p, slip):
        _shade(axes, run, named=axes is force)
    force.legend(loc="lower right", ncols=5, fontsize=8, frameon=False)
    save_figure(figure, out, dpi=120)
    plt.close(figure)


def title(run: RunRecord) -> str:
    """Title of the plot: experiment, object, seed, detector and outcome."""
    config = run.config
    text = f"{run.scenario} of {config.object.name}, seed {run.seed}, {config.detector_name}"
    return text if run.verdict is None else f"{text}: {spelt(run.verdict.outcome)}"


def _draw_decision(axes: Any, run: RunRecord) -> None:
    """Draw the values that the decision rule compares, with its threshold."""
    rule = bound_of(run.config.rule)
    values = decided(run.config.rule, run.probabilities, run.armed, run.masked)
    what = "threshold"
    if not rule.probable:
        axes, what = axes.twinx(), "limit"
        axes.set(ylabel="summed log-odds", ylim=(0, 4 * rule.limit))
    if values.shape[1] == 1 or not rule.probable:
        axes.plot(run.t_s, values.max(axis=1), color="black", lw=1.2, label=rule.label)
    label = f"{what} {rule.limit:g}"
    axes.axhline(rule.limit, color=LIMIT_COLOUR, lw=0.8, ls=":", label=label)
    axes.legend(loc="upper right", ncols=2, fontsize=8, frameon=False)


def _shown(run: RunRecord) -> tuple[float, float]:
    begins = {change.phase: change.t_ns * 1e-9 for change in run.phases}
    end = begins.get("lower.descend", float(run.t_s[-1]) - LOWERING_SHOWN_S)
    return begins.get("grasp.brace", float(run.t_s[0])), end + LOWERING_SHOWN_S


def _shade(axes: Any, run: RunRecord, named: bool) -> None:
    """Draw phases as background, from grasp to set-down, and the onset of slip."""
    starts = [change.t_ns * 1e-9 for change in run.phases]
    first, last = _shown(run)
    axes.set_xlim(first, last)
    label_s = first - NAMES_APART * (last - first)  # position of the previous name
    for change, start, end in zip(
        run.phases, starts, [*starts[1:], float(run.t_s[-1])], strict=True
    ):
        if change.phase not in SHADES:
            continue
        axes.axvspan(start, end, color=SHADES[change.phase], lw=0, zorder=0)
        if named and start <= last:
            label_s = max(start, label_s + NAMES_APART * (last - first))
            axes.annotate(
                change.phase.rpartition(".")[2], (label_s, 1.0), xytext=(2, 2), fontsize=8,
                xycoords=("data", "axes fraction"), textcoords="offset points", rotation=40,
                annotation_clip=True,
            )  # fmt: skip
    if run.truth is not None and run.truth.onset_s is not None:
        axes.axvline(run.truth.onset_s, color=LIMIT_COLOUR, lw=0.8, label="slip begins")
