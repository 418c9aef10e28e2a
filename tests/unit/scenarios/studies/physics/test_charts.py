"""What the charts of the physics count, and what they do without MuJoCo."""

import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from scenarios.studies.physics import chart as physics_chart
from scenarios.studies.physics import mujoco_scene, stability, yardsticks
from scenarios.studies.physics.chart import PhysicsChart, ratios
from scenarios.studies.physics.yardsticks import CostPoint, measure
from scenarios.world.ladder.levels import Level


def point(curve: str, step_s: float, cost_us: float, error_mm: float) -> CostPoint:
    return CostPoint("lift", curve, step_s, cost_us, error_mm * 1e-3)


def test_a_lucky_hit_at_one_step_is_no_accuracy() -> None:
    points = [
        point("MuJoCo impratio 10", 4e-3, 10.0, 0.01), point("MuJoCo impratio 10", 2e-3, 20.0, 0.4),
        point("MuJoCo impratio 100", 2e-3, 90.0, 0.05), point("L1", 4e-3, 1.0, 0.08),
        point("LuGre EXP2", 4e-3, 0.1, 0.01),
    ]  # fmt: skip
    (found,) = ratios(points, [0.1])
    assert (found.mujoco_us, found.ladder_us) == (90.0, 1.0)
    assert ratios(points[:2] + points[3:], [0.1])[0].mujoco_us is None


def test_diverged_runs_are_drawn_and_written_as_such(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    chart = PhysicsChart([point("L1", 1e-3, 5.0, 0.1), point("LuGre RK4", 1e-3, 5.0, math.nan)], "")
    physics_chart.draw(chart, tmp_path / "chart.svg")
    assert (tmp_path / "chart.svg").stat().st_size > 1000


def test_without_mujoco_its_curves_are_left_out_and_the_chart_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(physics_chart, "find_spec", lambda name: None)
    monkeypatch.setattr(physics_chart, "jobs", lambda scene, with_mujoco: [
        (f"MuJoCo {with_mujoco}", yardsticks.at_level(Level.RIGID), 0.0)
    ])  # fmt: skip
    monkeypatch.setattr(yardsticks, "exact", lambda scene: np.zeros(2))
    chart = physics_chart.compute()
    assert chart.note == physics_chart.NO_MUJOCO
    assert {p.curve for p in chart.points} == {"MuJoCo False"}


@pytest.mark.skipif(find_spec("mujoco") is None, reason="MuJoCo is not installed")
def test_mujoco_sees_the_same_lift_but_for_its_creep() -> None:
    exact = yardsticks.exact(yardsticks.lift())
    errors = [
        float(np.linalg.norm(mujoco_scene.run(yardsticks.lift(), 2e-3, ratio) - exact))
        for ratio in (1.0, 10.0)
    ]
    assert errors[1] < 0.6e-3 < 2e-3 < errors[0]


def test_error_and_cost_of_a_method_are_measured() -> None:
    scene = yardsticks.lift()
    found = measure(scene, "L1", yardsticks.at_level(Level.SLIDER), 1e-3, yardsticks.exact(scene))
    assert 10e-6 < found.error_m < 200e-6
    assert found.cost_us > 0


def test_ladder_holds_where_explicit_methods_break() -> None:
    scene = stability.scene_of(1e6)
    exact = yardsticks.exact(scene)
    errors = {
        name: float(np.linalg.norm(run(scene, 5e-3) - exact)) * 1e3
        for name, run in stability.METHODS.items()
    }
    broken = {name for name, error in errors.items() if not error <= stability.LOST_MM}
    assert broken == {
        "same law, explicit Euler", "same law, RK4", "LuGre, explicit Euler", "LuGre, RK4",
        "regularised Coulomb, explicit",
    }  # fmt: skip
