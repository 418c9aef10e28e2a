"""Stability of integrators: a short lift with pads of varying stiffness and a varying step."""

import argparse
import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import msgspec
import numpy as np

from scenarios.world.settings import Level
from studies.contact import reference
from studies.contact.comparators import Method
from studies.contact.scene import BODY, PADS, Scene, lift
from studies.physics_levels import Runner, at_level, explicit, extrapolated, other_law
from studies.runner import Study, markdown

FORCE_N = 20.0  # sum of the normal forces after closing
DAMPING_RATIO = 0.2  # of the object on its pads, at every stiffness
DURATION_S = 0.6
LOST_MM = 10.0  # a larger error counts as failed
STIFFNESS_OVER_LOAD = np.logspace(2, 8, 13)  # 1/m; rubber pads 1e3
STEPS_S = np.logspace(-5, math.log10(0.05), 14)
METHODS: dict[str, Runner] = {
    "backward Euler, return mapping (L1)": partial(at_level, Level.SLIDER),
    "the same, extrapolated from two steps": partial(extrapolated, Level.SLIDER),
    "same law, explicit Euler": partial(explicit, 1),
    "same law, RK4": partial(explicit, 4),
    "LuGre, explicit Euler": partial(other_law, Method.LUGRE_EULER),
    "LuGre, RK4": partial(other_law, Method.LUGRE_RK4),
    "LuGre, EXP2": partial(other_law, Method.LUGRE_EXP2),
    "regularised Coulomb, explicit": partial(other_law, Method.REGULAR_EXPLICIT),
}


class Task(msgspec.Struct, frozen=True):
    """Stiffness of all three pads over the normal force, 1/m, and the steps."""

    stiffness_over_load: float
    steps_s: tuple[float, ...]


class Row(msgspec.Struct, frozen=True):
    """Error of the slip distance, mm, by method and step. NaN: diverged."""

    stiffness_over_load: float
    steps_s: tuple[float, ...]
    error_mm: dict[str, tuple[float, ...]]


def scene_of(stiffness_over_load: float) -> Scene:
    """The lift with pads of this stiffness."""
    stiffness = stiffness_over_load * FORCE_N / 3
    damping = 2 * DAMPING_RATIO * math.sqrt(stiffness * BODY.mass_kg / 3)
    pads = msgspec.structs.replace(PADS, shear_stiffness_npm=stiffness, shear_damping_nspm=damping)
    return lift(pads, DURATION_S)


def trial(task: Task) -> Row:
    """Every method at every step, against the law of L1 solved to 0.1 nm."""
    scene = scene_of(task.stiffness_over_load)
    exact = reference.adaptive(scene, Level.SLIDER, 1e-10)
    errors = {
        name: tuple(float(np.linalg.norm(run(scene, h) - exact)) * 1e3 for h in task.steps_s)
        for name, run in METHODS.items()
    }
    return Row(task.stiffness_over_load, task.steps_s, errors)


def grid(args: argparse.Namespace) -> list[Task]:
    return [Task(float(x), tuple(STEPS_S.tolist())) for x in STIFFNESS_OVER_LOAD]


def failed(rows: Sequence[Row], method: str) -> float:
    """Share of the map on which a method diverges or its error exceeds 10 mm."""
    errors = np.array([row.error_mm[method] for row in rows])
    return float((~(errors <= LOST_MM)).mean())


def table(rows: Sequence[Row]) -> str:
    shares = [100.0 * failed(rows, name) for name in METHODS]
    return markdown({"method": [*METHODS], "failed, % of the map": shares})


def chart(rows: Sequence[Row], figure: Any) -> None:
    """Maps by method: colour is the error, black where the method failed."""
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm

    colours = colormaps["viridis_r"].copy()
    colours.set_over("black")
    colours.set_bad("black")
    panels = figure.subplots(2, 4, sharex=True, sharey=True)
    for axes, name in zip(panels.flat, METHODS, strict=True):
        errors = np.array([row.error_mm[name] for row in rows])
        mesh = axes.pcolormesh(
            np.array(rows[0].steps_s) * 1e3, [row.stiffness_over_load for row in rows],
            np.ma.masked_invalid(np.maximum(errors, 1e-5)), norm=LogNorm(1e-4, LOST_MM),
            cmap=colours, shading="nearest", rasterized=True,
        )  # fmt: skip
        axes.set(xscale="log", yscale="log")
        axes.set_title(f"{name}\nbroken: {failed(rows, name):.0%} of the map", fontsize=9)
    for axes in panels[1]:
        axes.set_xlabel("step, ms")
    for axes in panels[:, 0]:
        axes.set_ylabel("stiffness over load, 1/m")
    bar = figure.colorbar(mesh, ax=panels, extend="max", shrink=0.8)
    bar.set_label("error of the slip distance, mm (black: failed)")


STUDY = Study(
    "stability of integrators over step and pad stiffness",
    grid,
    trial,
    Row,
    table,
    chart,
    figure_size=(15.0, 7.0),
)
