"""Pictures of a run, drawn from its recording. Needs the extra `charts`."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGER_NAMES
from grasp.messages import CONTROL, PHASES, TRUTH
from grasp.recording import RunRecording
from scenarios.trial.run_folder import open_trial

COLOURS = {"A": "#1f5f99", "B": "#c2571a", "C": "#3a7d44"}
LOWERING_SHOWN_S = 0.3
TURN_COLOUR, LEAST_TURN_DEG = "#7a4a9e", 0.1
LEAST_ACROSS_MM = 0.1
SHADES = {
    "grasp": "#eef3f8", "squeeze": "#e8eff5", "relax": "#eef3f8", "listen": "#e8eff5",
    "lift": "#e0eaf4", "compensate": "#fde3c8", "hold": "#e3f1e3", "lower": "#f3f3f3",
    "land": "#f3f3f3", "touch": "#fde3c8", "probe": "#fde3c8",
    "fault": "#f8d7d7",
}  # fmt: skip


class Series(msgspec.Struct, frozen=True):
    """Time series of a run; t_s (n,), others (n,) or (n, 3)."""

    t_s: NDArray[np.float64]
    probabilities: NDArray[np.float64]
    measured_n: NDArray[np.float64]
    true_n: NDArray[np.float64] | None
    slip_mm: NDArray[np.float64] | None
    across_mm: NDArray[np.float64] | None
    turned_deg: NDArray[np.float64] | None
    onset_s: float | None
    phases: list[tuple[float, str]]
    force_limit_n: float | None  # None where the recording does not say


def read_series(path: Path) -> Series:
    """What the figure needs of a recording; raises BadFile when it is none."""
    recording = open_trial(path)
    control = list(recording.of(CONTROL))
    truth = [message for _, message in recording.of(TRUTH)]
    return Series(
        t_s=np.array([t for t, _ in control]) * 1e-9,
        probabilities=np.array([m.probabilities for _, m in control]),
        measured_n=np.array([m.measured_n for _, m in control]),
        true_n=np.array([m.normal_n for m in truth]) if truth else None,
        slip_mm=np.array([m.slip_distance_m for m in truth]) * 1e3 if truth else None,
        across_mm=np.array([m.across_m for m in truth]) * 1e3 if truth else None,
        turned_deg=np.degrees([m.turn_rad for m in truth]) if truth else None,
        onset_s=truth[-1].slip_onset_s if truth else None,
        phases=[(t * 1e-9, m.phase) for t, m in recording.of(PHASES)],
        force_limit_n=_force_limit_n(recording),
    )


class _Limit(msgspec.Struct):
    force_limit_n: float


class _Settings(msgspec.Struct):
    guard: _Limit


def _force_limit_n(recording: RunRecording) -> float | None:
    """That the guard had in this run."""
    try:
        said = msgspec.json.decode(recording.metadata.get("config", ""), type=_Settings)
    except msgspec.MsgspecError:
        return None
    return said.guard.force_limit_n


def draw_run(path: Path, out: Path) -> None:
    """Force, slip probability and slip distance of a run over time, phases shaded, into ``out``."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    series = read_series(path)
    plt.rcParams["svg.hashsalt"] = "grasp"  # the same run gives the same file
    figure, (force, p, slip) = plt.subplots(
        3, 1, sharex=True, figsize=(9, 6), height_ratios=(3, 2, 2), layout="constrained"
    )
    _draw_force(force, series)
    for i, name in enumerate(FINGER_NAMES):
        p.plot(series.t_s, series.probabilities[:, i], color=COLOURS[name], lw=1)
    p.axhline(0.5, color="black", lw=0.6, ls=":")
    p.set_ylabel("slip probability")
    _draw_slip(slip, series)
    slip.set(ylabel="slip, mm (true)", xlabel="time, s")
    _draw_turn(slip, series)
    for axes in (force, p, slip):
        _shade(axes, series, named=axes is force)
    figure.savefig(out, metadata={"Date": None} if out.suffix == ".svg" else None, dpi=120)
    plt.close(figure)


def _draw_force(axes: Any, series: Series) -> None:
    for i, name in enumerate(FINGER_NAMES):
        axes.plot(series.t_s, series.measured_n[:, i], color=COLOURS[name], lw=0.7, alpha=0.6)
        if series.true_n is not None:
            axes.plot(series.t_s, series.true_n[:, i], color=COLOURS[name], lw=1.4, label=f"{name}")
    if (limit_n := series.force_limit_n) is not None:
        axes.axhline(limit_n, color="#b00020", lw=1, ls="--", label=f"limit {limit_n:g} N")
    axes.set_ylabel("grip force, N\n(thin: felt, thick: true)")
    axes.legend(loc="lower right", ncols=4, fontsize=8, frameon=False)


def _draw_slip(axes: Any, series: Series) -> None:
    """How far the object slid down through the fingers, and aside where it did."""
    if series.slip_mm is None or series.across_mm is None:
        return
    axes.plot(series.t_s, series.slip_mm, color="black", lw=1.2, label="down")
    first, last = _shown(series)
    seen = (series.t_s >= first) & (series.t_s <= last)
    least, most = -1.0, max(2.0, float(series.slip_mm[seen].max()))
    aside = series.across_mm[seen]
    if np.abs(aside).max() >= LEAST_ACROSS_MM:
        axes.plot(series.t_s, series.across_mm, color="black", lw=1.2, ls="--", label="aside")
        axes.legend(loc="upper left", fontsize=8, frameon=False)
        least, most = min(least, 1.15 * float(aside.min())), max(most, float(aside.max()))
    axes.set_ylim(least, 1.15 * most)


def _draw_turn(slip: Any, series: Series) -> None:
    """Rotation in the hand, on a scale of its own, where there is any."""
    turned = series.turned_deg
    if turned is None or np.abs(turned).max() < LEAST_TURN_DEG:
        return
    axes = slip.twinx()
    axes.plot(series.t_s, turned, color=TURN_COLOUR, lw=1.2)
    axes.set_ylabel("turned, deg (true)", color=TURN_COLOUR)


def _shown(series: Series) -> tuple[float, float]:
    begins = {name: t for t, name in series.phases}
    end = begins.get("lower", float(series.t_s[-1]) - LOWERING_SHOWN_S)
    return begins.get("grasp", float(series.t_s[0])), end + LOWERING_SHOWN_S


def _shade(axes: Any, series: Series, named: bool) -> None:
    """Phases as background, from the grasp until the object is set down."""
    starts = [t for t, _ in series.phases] + [float(series.t_s[-1])]
    axes.set_xlim(*_shown(series))
    for (start, name), end in zip(series.phases, starts[1:], strict=True):
        if name in SHADES:
            axes.axvspan(start, end, color=SHADES[name], lw=0, zorder=0)
            if named:
                axes.annotate(
                    name, (start, 1.0), xycoords=("data", "axes fraction"), xytext=(2, 2),
                    textcoords="offset points", fontsize=8, rotation=20, annotation_clip=True,
                )  # fmt: skip
    if series.onset_s is not None:
        axes.axvline(series.onset_s, color="#b00020", lw=0.8)


def draw_clips(
    out: Path,
    clips: list[tuple[str, NDArray[np.float64], NDArray[np.int16], NDArray[np.bool_]]],
) -> None:
    """Counts of one fingertip over time, one clip under the other, slip shaded: each a title,
    (n,) times, (n, 6) counts and (n,) labels."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"
    figure, rows = plt.subplots(
        len(clips), 1, sharex=True, sharey=True, squeeze=False, figsize=(9, 2.4 * len(clips)),
        layout="constrained",
    )  # fmt: skip
    for axes, (title, t_s, counts, slip) in zip(rows[:, 0], clips, strict=True):
        for i in range(counts.shape[1]):
            axes.plot(t_s, counts[:, i], lw=1, label=f"taxel {i}")
        axes.fill_between(
            t_s, 0, 1, where=slip, transform=axes.get_xaxis_transform(), color="#eeeeee", zorder=0
        )
        axes.set(ylabel="counts over rest", title=title)
    rows[0, 0].legend(ncols=6, fontsize=8, frameon=False)
    rows[-1, 0].set(xlabel="time, s; shaded: labelled slip")
    figure.savefig(out, metadata={"Date": None} if out.suffix == ".svg" else None, dpi=120)
    plt.close(figure)
