"""Error and processor time of every contact level, and of MuJoCo.

Times are processor times of one thread and vary between runs: use `--jobs 1` on a quiet machine.
"""

import argparse
import math
import time
from collections.abc import Callable, Iterable, Sequence
from functools import cache, partial
from importlib.util import find_spec
from typing import Any

import msgspec
import numpy as np

from grasp.cli.parser import Parser
from scenarios.world.contact import Floats
from scenarios.world.settings import Level
from studies.contact import mujoco_scene, reference, scene
from studies.contact.scene import Scene, simulate
from studies.runner import Study, markdown

Runner = Callable[[Scene, float], Floats]
SCENES = {"lift": scene.lift, "tap": scene.tap, "vibration": scene.vibration}
STEPS_S = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1e-4)
MUJOCO_STEPS_S = STEPS_S[1:-1]
MUJOCO = {"impratio 1000": 'impratio="1000"', "noslip": 'noslip_iterations="20"'}
ONE_AXIS = "MuJoCo one axis"
ERRORS_MM = (1.0, 0.5, 0.2, 0.1)  # of the cost comparison
FLOOR_MM = 1e-6  # the chart shows smaller errors as this
REPEATS = 5  # the shortest time counts
COLOURS = {
    "L1": "#1f5f99", "L3": "#8a6fb0", "L4": "#c2571a", "MuJoCo": "#888888",
}  # fmt: skip


class Task(msgspec.Struct, frozen=True):
    """A method at one step."""

    scene: str
    curve: str
    step_s: float


class Row(msgspec.Struct, frozen=True):
    """Processor time, and error of the tape mark's displacement. NaN: diverged."""

    scene: str
    curve: str
    step_s: float
    cost_us: float
    error_m: float


def at_level(level: Level, of: Scene, step_s: float) -> Floats:
    """Backward Euler."""
    return simulate(of, level, step_s)


def extrapolated(level: Level, of: Scene, step_s: float) -> Floats:
    """Two steps, extrapolated: backward Euler is of first order."""
    return 2 * simulate(of, level, 0.5 * step_s) - simulate(of, level, step_s)


def by_mujoco(option: str, of: Scene, step_s: float) -> Floats:
    return mujoco_scene.pads(of, step_s, option)


def methods() -> dict[str, tuple[Runner, Sequence[float]]]:
    """Runner and steps of each curve; MuJoCo only if installed (extra `dev`)."""
    found: dict[str, tuple[Runner, Sequence[float]]] = {}
    for level in Level:
        found[level.label] = partial(at_level, level), STEPS_S
        found[f"{level.label} extrapolated"] = partial(extrapolated, level), STEPS_S
    if find_spec("mujoco") is not None:
        for name, option in MUJOCO.items():
            found[f"MuJoCo {name}"] = partial(by_mujoco, option), MUJOCO_STEPS_S
        found[ONE_AXIS] = mujoco_scene.one_axis, MUJOCO_STEPS_S
    return found


@cache
def exact(name: str) -> Floats:
    """The reference: adaptive, with 12 x 12 brush points if the object turns."""
    of = SCENES[name]()
    if of.tap is not None:
        return reference.adaptive(of, Level.BRUSH, 1e-10, 12)
    return reference.adaptive(of, Level.SLIDER, 1e-12)


def trial(task: Task) -> Row:
    """Error and cost. The first run, which may compile, is not timed."""
    of, run = SCENES[task.scene](), methods()[task.curve][0]
    error_m = float(np.linalg.norm(run(of, task.step_s) - exact(task.scene)))
    least = math.inf
    for _ in range(REPEATS):
        start = time.thread_time()
        run(of, task.step_s)
        least = min(least, time.thread_time() - start)
    return Row(task.scene, task.curve, task.step_s, least * 1e6, error_m)


def options(parser: Parser) -> None:
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=[*SCENES])
    parser.add_argument("--curves", nargs="+", choices=methods(), default=[*methods()])


def grid(args: argparse.Namespace) -> list[Task]:
    known = methods()
    return [
        Task(name, curve, step_s)
        for name in args.scenes
        for curve in args.curves
        if curve != ONE_AXIS or SCENES[name]().tap is None
        for step_s in known[curve][1]
    ]


def cheapest(rows: Iterable[Row], prefix: str, error_mm: float) -> Row | None:
    """The cheapest row within that error, of the curves with that prefix; ``ONE_AXIS`` counts only
    for itself. All smaller steps of its curve must be within the error too, which excludes
    accidental hits."""
    curves: dict[str, list[Row]] = {}
    for row in rows:
        if row.curve.startswith(prefix) and (row.curve != ONE_AXIS or prefix == ONE_AXIS):
            curves.setdefault(row.curve, []).append(row)
    good = [
        row
        for curve in curves.values()
        for row in curve
        if all(r.error_m * 1e3 <= error_mm for r in curve if r.step_s <= row.step_s)
    ]
    return min(good, key=lambda row: row.cost_us, default=None)


def table(rows: Sequence[Row]) -> str:
    """Costs at equal error."""
    found = []
    for name in dict.fromkeys(row.scene for row in rows):
        here = [row for row in rows if row.scene == name]
        for error_mm in ERRORS_MM:
            theirs, ours = cheapest(here, "MuJoCo", error_mm), cheapest(here, "L", error_mm)
            times = theirs.cost_us / ours.cost_us if theirs and ours else None
            found.append((name, error_mm, *_cells(theirs), *_cells(ours), times))
    names = ("scene", "error at most, mm", "MuJoCo", "µs", "level", "µs ", "times cheaper")
    return markdown(dict(zip(names, zip(*found, strict=True), strict=True)))


def _cells(row: Row | None) -> tuple[str, float | None]:
    if row is None:
        return "not reached", None
    return f"{row.curve}, {row.step_s * 1e3:g} ms", row.cost_us


def chart(rows: Sequence[Row], figure: Any) -> None:
    """Error over processor time, one panel per scene."""
    scenes = list(dict.fromkeys(row.scene for row in rows))
    panels = figure.subplots(1, len(scenes), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, scenes, strict=True):
        here = [row for row in rows if row.scene == name]
        for curve in dict.fromkeys(row.curve for row in here):
            _plot(axes, curve, [row for row in here if row.curve == curve])
        axes.set(xscale="log", yscale="log", title=name, xlabel="processor time of a scene, µs")
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("error of the tape mark, mm")
    panels[0].set_ylim(0.5 * FLOOR_MM, 300.0)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, fontsize=8, frameon=False)


def _plot(axes: Any, curve: str, rows: Sequence[Row]) -> None:
    shown = [row for row in rows if math.isfinite(row.error_m)]
    dashed = "extrapolated" in curve or curve == ONE_AXIS
    axes.plot(
        [row.cost_us for row in shown], [max(row.error_m * 1e3, FLOOR_MM) for row in shown],
        color=COLOURS[curve.split(maxsplit=1)[0]], label=curve, lw=1.1, ms=3.5,
        ls="--" if dashed else (":" if curve.endswith("noslip") else "-"),
        marker="s" if curve.startswith("MuJoCo") else "o",
    )  # fmt: skip


STUDY = Study(
    "error against processor time of every contact level, and of MuJoCo",
    grid, trial, Row, table, chart, options, figure_size=(15.0, 6.5),
)  # fmt: skip
