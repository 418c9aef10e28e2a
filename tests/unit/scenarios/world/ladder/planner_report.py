"""How often the planner misses its tolerance, and what it costs against always the reference."""

import time
from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from scenarios.world.contact import Floats
from scenarios.world.ladder.levels import simulate
from scenarios.world.ladder.planner import Tolerance, plan, reference
from scenarios.world.ladder.scene import Scene
from scenarios.world.world_settings import Level

TRUTH_STEP_S, TRUTH_POINTS = 2e-4, 12  # extrapolated from this step and its half
WARM = 20  # plans: enough of them to come by every level
MAKER = Callable[[np.random.Generator], Scene]


class Tally(msgspec.Struct, frozen=True):
    """One tolerance over many scenes."""

    tolerance_m: float
    levels: list[int]  # how often each level was chosen
    misses: int
    reference_misses: int
    worst_m: float
    cost_s: float  # processor time of all plans, answers included
    reference_cost_s: float


def truth(scene: Scene) -> Floats:
    """Displacement of the tape mark by a brush of 12 x 12 points a finger."""
    coarse, fine = (
        np.array(simulate(scene, Level.BRUSH, step_s, TRUTH_POINTS).mark_m)
        for step_s in (TRUTH_STEP_S, 0.5 * TRUTH_STEP_S)
    )
    exact: Floats = 2 * fine - coarse
    return exact


def tally(scenes: Sequence[Scene], truths: Sequence[Floats], tolerance_m: float) -> Tally:
    """Plan every scene and run the reference on it; first plans, which compile, are not timed."""
    tolerance = Tolerance(slip_m=tolerance_m)
    levels, misses, late, worst = [0] * 5, 0, 0, 0.0
    costs = np.zeros(2)
    for scene in scenes[:WARM]:
        plan(scene, tolerance)
    for scene, exact in zip(scenes, truths, strict=True):
        begin = time.thread_time()
        found = plan(scene, tolerance)
        middle = time.thread_time()
        full = reference(scene, tolerance)
        costs += middle - begin, time.thread_time() - middle
        error = float(np.linalg.norm(np.array(found.answer.mark_m) - exact))
        levels[found.level] += 1
        worst = max(worst, error)
        misses += error > tolerance_m
        late += float(np.linalg.norm(np.array(full.mark_m) - exact)) > tolerance_m
    return Tally(tolerance_m, levels, misses, late, worst, float(costs[0]), float(costs[1]))


def scenes_of(make: MAKER, count: int, seed: int) -> list[Scene]:
    rng = np.random.default_rng(seed)
    return [make(rng) for _ in range(count)]


def table(name: str, tallies: Sequence[Tally]) -> str:
    """Rows in Markdown: tolerance, choices, misses, cost."""
    rows = []
    for t in tallies:
        count = sum(t.levels)
        chosen = " | ".join(str(n) for n in t.levels)
        rows.append(
            f"| {name} | {t.tolerance_m * 1e3:g} | {chosen} | {t.misses} | {t.worst_m * 1e3:.2f} "
            f"| {t.cost_s / count * 1e3:.2f} | {t.reference_cost_s / count * 1e3:.2f} "
            f"| {t.cost_s / t.reference_cost_s:.2f} |"
        )
    return "\n".join(rows)
