"""`grasp chart physics`: error against cost for every level, integrator and step, in one run."""

from collections.abc import Callable, Iterable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from grasp.files import save_figure
from scenarios.studies.physics import mujoco_scene, yardsticks
from scenarios.studies.physics.yardsticks import CostPoint, Runner
from scenarios.world.contact import Floats
from scenarios.world.ladder import reference
from scenarios.world.ladder.comparators import Method
from scenarios.world.ladder.scene import Scene
from scenarios.world.world_settings import Level

STEPS_S = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1e-4)
MUJOCO_STEPS_S = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
TOLERANCES_M = (1e-6, 1e-8, 1e-10)
FLOOR_MM = 1e-6  # errors below are drawn here
NO_MUJOCO = "MuJoCo is not installed (extra `dev`): its curves are left out"
COLOURS = {
    "L0": "#000000", "L1": "#1f5f99", "L2": "#3a7d44", "L3": "#8a6fb0", "L4": "#c2571a",
    "LuGre": "#b5a000", "regularised": "#b00020", "explicit": "#7fb2d9", "adaptive": "#009999",
    "MuJoCo": "#888888",
}  # fmt: skip


class PhysicsChart(msgspec.Struct, frozen=True):
    """All points of one run. note: what was left out, and why; empty if nothing was."""

    points: list[CostPoint]
    note: str


def compute(progress: Callable[[str, int, int], None] | None = None) -> PhysicsChart:
    """Run every method on every yardstick, one thread, times of this machine."""
    with_mujoco = find_spec("mujoco") is not None
    points: list[CostPoint] = []
    scenes = (yardsticks.lift(), yardsticks.tap(), yardsticks.vibration())
    todo = [(scene, *job) for scene in scenes for job in jobs(scene, with_mujoco)]
    truth: dict[str, Floats] = {}
    for done, (scene, curve, run, step_s) in enumerate(todo):
        if progress is not None:
            progress(f"{scene.name}: {curve}", done, len(todo))
        if scene.name not in truth:
            truth[scene.name] = yardsticks.exact(scene)
        repeats = 3 if curve.startswith("MuJoCo") else 5
        points.append(yardsticks.measure(scene, curve, run, step_s, truth[scene.name], repeats))
    return PhysicsChart(points, "" if with_mujoco else NO_MUJOCO)


def jobs(scene: Scene, with_mujoco: bool) -> Iterable[tuple[str, Runner, float]]:
    """Name of the curve, what runs it and the step (s; metres of tolerance if adaptive)."""
    yield "L0 exact", yardsticks.at_level(Level.RIGID), 0.0
    for level in (Level.SLIDER, Level.POINTS, Level.SPIN, Level.BRUSH):
        for step_s in STEPS_S:
            yield f"L{int(level)}", yardsticks.at_level(level), step_s
            yield f"L{int(level)} extrapolated", yardsticks.extrapolated(level), step_s
    best = Level.SLIDER if scene.name != "tap" else Level.BRUSH
    for step_s in STEPS_S:
        yield "explicit Euler", yardsticks.explicit(1, best), step_s
        yield "explicit RK4", yardsticks.explicit(4, best), step_s
    for tolerance_m in TOLERANCES_M:
        yield "adaptive Runge-Kutta", partial(_adaptive, best), tolerance_m
    for method, name in (
        (Method.LUGRE_RK4, "LuGre RK4"), (Method.LUGRE_EXP2, "LuGre EXP2"),
        (Method.REGULAR_IMPLICIT, "regularised implicit"),
    ):  # fmt: skip
        for step_s in STEPS_S:
            yield name, yardsticks.other_law(method), step_s
    if with_mujoco:
        for impratio in (1, 10, 100):
            for step_s in MUJOCO_STEPS_S:
                yield f"MuJoCo impratio {impratio}", partial(_mujoco, impratio), step_s


def _adaptive(level: Level, scene: Scene, tolerance_m: float) -> Floats:
    return np.array(reference.adaptive(scene, level, tolerance_m).mark_m)


def _mujoco(impratio: float, scene: Scene, step_s: float) -> Floats:
    return mujoco_scene.run(scene, step_s, impratio)


class Ratio(msgspec.Struct, frozen=True):
    """Cheapest MuJoCo run at most so far off, and the cheapest run of the ladder that is too."""

    scene: str
    error_mm: float
    mujoco_us: float | None
    mujoco: str
    ladder_us: float
    ladder: str


def ratios(
    points: list[CostPoint], errors_mm: Iterable[float] = (1.0, 0.5, 0.2, 0.1)
) -> list[Ratio]:
    """Cost at equal error. A level counts only if halving its step keeps it as good: a lucky hit
    at one step is no accuracy. mujoco_us None: MuJoCo does not get there."""
    found = []
    for scene in dict.fromkeys(p.scene for p in points):
        here = [p for p in points if p.scene == scene]
        for error_mm in errors_mm:
            mujoco = _cheapest(here, "MuJoCo", error_mm)
            ladder = _cheapest(here, "L", error_mm)
            if ladder is not None:
                found.append(
                    Ratio(
                        scene,
                        error_mm,
                        mujoco.cost_us if mujoco else None,
                        _name(mujoco),
                        ladder.cost_us,
                        _name(ladder),
                    )
                )
    return found


def _cheapest(points: list[CostPoint], prefix: str, error_mm: float) -> CostPoint | None:
    curves: dict[str, list[CostPoint]] = {}
    for p in points:
        if p.curve.startswith(prefix) and not p.curve.startswith("LuGre"):
            curves.setdefault(p.curve, []).append(p)
    good = []
    for curve in curves.values():
        for p in curve:
            finer = [q for q in curve if q.step_s <= p.step_s]
            if all(q.error_m * 1e3 <= error_mm for q in finer):
                good.append(p)
    return min(good, key=lambda p: p.cost_us, default=None)


def _name(point: CostPoint | None) -> str:
    if point is None:
        return "none"
    return point.curve + (f", {point.step_s * 1e3:g} ms" if point.step_s else "")


def table(chart: PhysicsChart) -> str:
    """Costs at equal error, as a table in Markdown."""
    rows = ["| scene | error at most, mm | MuJoCo | µs | ladder | µs | times cheaper |",
            "|---|---|---|---|---|---|---|"]  # fmt: skip
    for r in ratios(chart.points):
        theirs = f"{r.mujoco} | {r.mujoco_us:.0f}" if r.mujoco_us else "does not get there | -"
        times = f"{r.mujoco_us / r.ladder_us:.0f}" if r.mujoco_us else "-"
        rows.append(
            f"| {r.scene} | {r.error_mm:g} | {theirs} | {r.ladder} | {r.ladder_us:.0f} | {times} |"
        )
    return "\n".join([*rows, chart.note] if chart.note else rows)


def draw(chart: PhysicsChart, out: Path) -> None:
    """Three panels, error over cost, into ``out`` (.svg, .png or .pdf)."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"
    scenes = list(dict.fromkeys(p.scene for p in chart.points))
    figure, panels = plt.subplots(1, len(scenes), figsize=(15, 6.5), sharey=True, squeeze=False)
    for axes, scene in zip(panels[0], scenes, strict=True):
        curves = dict.fromkeys(p.curve for p in chart.points if p.scene == scene)
        for curve in curves:
            _plot(axes, curve, [p for p in chart.points if (p.scene, p.curve) == (scene, curve)])
        axes.set(xscale="log", yscale="log", title=scene, xlabel="processor time of a scene, µs")
        axes.grid(alpha=0.3)
    panels[0, 0].set_ylabel("error of the tape mark, mm")
    panels[0, 0].set_ylim(0.5 * FLOOR_MM, 300.0)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=6, fontsize=8, frameon=False)
    figure.suptitle("Error of contact models against what they cost", fontsize=11)
    if chart.note:
        figure.text(0.5, 0.94, chart.note, ha="center", fontsize=9, color="#b00020")
    figure.tight_layout(rect=(0, 0.11, 1, 0.96))
    save_figure(figure, out, dpi=110)
    plt.close(figure)


def _plot(axes: Any, curve: str, points: list[CostPoint]) -> None:
    shown = [p for p in points if np.isfinite(p.error_m)]
    colour = COLOURS[curve.split(maxsplit=1)[0]]
    dashed = "extrapolated" in curve or "RK4" in curve or curve.endswith(" 10")
    marker = "*" if len(points) == 1 else ("s" if curve.startswith("MuJoCo") else "o")
    axes.plot(
        [p.cost_us for p in shown], [max(p.error_m * 1e3, FLOOR_MM) for p in shown],
        color=colour, ls="--" if dashed else (":" if curve.endswith("100") else "-"), lw=1.1,
        marker=marker, ms=11 if marker == "*" else 3.5, label=curve,
    )  # fmt: skip
