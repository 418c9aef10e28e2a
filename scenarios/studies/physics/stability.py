"""`grasp chart stability`: at which step and stiffness does a method still hold a lift together?"""

import math
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from grasp.files import save_figure
from scenarios.studies.physics import yardsticks
from scenarios.studies.physics.yardsticks import Runner
from scenarios.world.contact import Floats
from scenarios.world.ladder import reference
from scenarios.world.ladder.comparators import Method
from scenarios.world.ladder.scene import Scene
from scenarios.world.world_settings import Level

FORCE_N = 20.0  # sum of the normal forces after closing
DAMPING_RATIO = 0.2  # of the object on its pads, at every stiffness; 0.2 at 8 kN/m and 12 N s/m
DURATION_S = 0.6
LOST_MM = 10.0  # an error above this counts as broken
STIFFNESS_OVER_LOAD = np.logspace(2, 8, 13)  # 1/m: pads 1e3 on rubber, 5e7 at 0.02 N on 1e6 N/m
STEPS_S = np.logspace(-5, math.log10(0.05), 14)
METHODS: dict[str, Runner] = {
    "backward Euler, return mapping (L1)": yardsticks.at_level(Level.SLIDER),
    "the same, extrapolated from two steps": yardsticks.extrapolated(Level.SLIDER),
    "same law, explicit Euler": yardsticks.explicit(1, Level.SLIDER),
    "same law, RK4": yardsticks.explicit(4, Level.SLIDER),
    "LuGre, explicit Euler": yardsticks.other_law(Method.LUGRE_EULER),
    "LuGre, RK4": yardsticks.other_law(Method.LUGRE_RK4),
    "LuGre, EXP2": yardsticks.other_law(Method.LUGRE_EXP2),
    "regularised Coulomb, explicit": yardsticks.other_law(Method.REGULAR_EXPLICIT),
}


class StabilityMap(msgspec.Struct, frozen=True):
    """Errors in mm, NaN where a method diverged: (methods, stiffnesses, steps)."""

    methods: list[str]
    stiffness_over_load: list[float]
    steps_s: list[float]
    error_mm: list[list[list[float]]]

    def broken(self) -> dict[str, float]:
        """Share of the map on which a method diverges or is off by more than 10 mm."""
        errors = np.array(self.error_mm)
        bad = ~(errors <= LOST_MM)
        return dict(zip(self.methods, bad.mean(axis=(1, 2)).tolist(), strict=True))


def scene_of(stiffness_over_load: float) -> Scene:
    """A short lift whose pads have this stiffness, all three together, over the normal force."""
    stiffness = stiffness_over_load * FORCE_N / 3
    damping = 2 * DAMPING_RATIO * math.sqrt(stiffness * yardsticks.BODY.mass_kg / 3)
    pads = msgspec.structs.replace(
        yardsticks.PADS, shear_stiffness_npm=stiffness, shear_damping_nspm=damping
    )
    return yardsticks.lift(pads, DURATION_S)


def compute(progress: Callable[[str, int, int], None] | None = None) -> StabilityMap:
    """Every method at every step and stiffness, against the law of L1 to a tolerance of 0.1 nm."""
    scenes = [scene_of(float(x)) for x in STIFFNESS_OVER_LOAD]
    exact = [np.array(reference.adaptive(s, Level.SLIDER, 1e-10).mark_m) for s in scenes]
    errors = []
    for done, (name, run) in enumerate(METHODS.items()):
        if progress is not None:
            progress(name, done, len(METHODS))
        errors.append([_row(run, s, e) for s, e in zip(scenes, exact, strict=True)])
    return StabilityMap(list(METHODS), STIFFNESS_OVER_LOAD.tolist(), STEPS_S.tolist(), errors)


def _row(run: Runner, scene: Scene, exact: Floats) -> list[float]:
    return [float(np.linalg.norm(run(scene, float(h)) - exact)) * 1e3 for h in STEPS_S]


def draw(found: StabilityMap, out: Path) -> None:
    """A map a method: colour is the error, black where it broke."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.colors import LogNorm

    plt.rcParams["svg.hashsalt"] = "grasp"
    figure, panels = plt.subplots(2, 4, figsize=(15, 7), sharex=True, sharey=True,
                                  layout="constrained")  # fmt: skip
    colours = plt.get_cmap("viridis_r").copy()
    colours.set_over("black")
    colours.set_bad("black")
    broken = found.broken()
    for axes, name, errors in zip(panels.flat, found.methods, found.error_mm, strict=True):
        z = np.ma.masked_invalid(np.maximum(np.array(errors), 1e-5))
        mesh = axes.pcolormesh(
            np.array(found.steps_s) * 1e3, found.stiffness_over_load, z,
            norm=LogNorm(1e-4, LOST_MM), cmap=colours, shading="nearest", rasterized=True,
        )  # fmt: skip
        axes.set(xscale="log", yscale="log")
        axes.set_title(f"{name}\nbroken: {broken[name]:.0%} of the map", fontsize=9)
    for axes in panels[1]:
        axes.set_xlabel("step, ms")
    for axes in panels[:, 0]:
        axes.set_ylabel("stiffness over load, 1/m")
    figure.suptitle("Which step breaks which method, and its error where it does not", fontsize=11)
    bar = figure.colorbar(mesh, ax=panels, extend="max", shrink=0.8)
    bar.set_label("error of the slip distance, mm (black: broken)")
    save_figure(figure, out, dpi=110)
    plt.close(figure)
