"""The planner drops only what a scene can do without, and keeps its tolerance."""

import math

import numpy as np
import pytest

from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder.experiments import SCENES, World
from scenarios.world.ladder.levels import simulate
from scenarios.world.ladder.planner import Tolerance, indicators, plan
from scenarios.world.ladder.scene import Vibration
from scenarios.world.world_settings import Level
from tests.unit.scenarios.world.ladder.ladder_scenes import body, held, lift, tap
from tests.unit.scenarios.world.ladder.planner_report import scenes_of, truth
from tests.unit.scenarios.world.ladder.random_scenes import random_lift, random_tap

MM = Tolerance(slip_m=1e-3)


def test_centred_lift_is_rigid_at_a_millimetre_and_compliant_when_asked_for_more() -> None:
    assert plan(lift(), MM).level is Level.RIGID
    assert plan(lift(), Tolerance(slip_m=1e-4)).level is Level.SLIDER


def test_relaxing_pads_are_beyond_the_rigid_level() -> None:
    found = plan(lift(contact=ContactSettings()), Tolerance(slip_m=0.02))
    assert found.level is Level.SLIDER
    assert "L0 is not admitted" in "\n".join(found.lines())


def test_levels_that_agree_because_both_omit_the_rotation_are_not_believed() -> None:
    scene = held(tap=tap(0.04))
    rigid, slider = (simulate(scene, level, 1e-4) for level in (Level.RIGID, Level.SLIDER))
    assert math.dist(rigid.mark_m, slider.mark_m) < 0.7e-3  # agreement, and both are wrong
    assert math.dist(rigid.mark_m, truth(scene)) > 2e-3
    assert plan(scene, MM).level >= Level.SPIN


def test_a_tighter_tolerance_takes_a_fuller_level_and_a_smaller_step() -> None:
    scene = held(tap=tap(0.03, impulse_n_s=0.3))
    loose, tight = (plan(scene, Tolerance(slip_m=t)).answer for t in (5e-3, 2e-5))
    assert tight.level > loose.level
    assert tight.step_s < loose.step_s
    assert tight.step_error <= 0.5


def test_tolerance_on_rotation_counts_too() -> None:
    scene = held(tap=tap(0.02, impulse_n_s=0.3))
    assert plan(scene, Tolerance(slip_m=0.1)).level is Level.SLIDER
    assert plan(scene, Tolerance(slip_m=0.1, rotation_rad=1e-3)).level > Level.SLIDER


@pytest.mark.parametrize("make", [random_tap, random_lift])
def test_answers_keep_their_tolerance(make: object) -> None:
    for scene in scenes_of(make, 6, seed=11):  # type: ignore[arg-type]
        found = plan(scene, Tolerance(slip_m=5e-4))
        assert math.dist(found.answer.mark_m, truth(scene)) < 5e-4


def test_indicators_are_the_numbers_they_are_named_after() -> None:
    what = body(mass_kg=0.3, friction_static=0.5)
    shaken = Vibration(acceleration_mps2=9.81, frequency_hz=21.0)
    facts = indicators(held(body=what, vibration=shaken))
    assert facts.load_ratio == pytest.approx(0.3 * 2 * 9.81 / (0.5 * 20.0))
    # three pads of 7 kN/m under 0.3 kg: 42 Hz
    assert facts.frequency_ratio == pytest.approx(0.5, rel=0.01)
    assert not facts.turns
    aside = indicators(held(body=body(centre_aside_m=0.01)))
    assert aside.turns
    assert indicators(held(tap=tap(0.0, "side"))).sideways


@pytest.mark.parametrize(("hz", "acceleration", "level"), [
    (4.0, 4.0, Level.RIGID),  # slow and well inside the cone
    (21.0, 4.0, Level.SLIDER),  # half of the pads' resonance
    (4.0, 21.0, Level.SLIDER),  # slow, but 0.92 of the cone
])  # fmt: skip
def test_vibration_is_rigid_only_far_from_resonance_and_cone(
    hz: float, acceleration: float, level: Level
) -> None:
    shaken = Vibration(acceleration_mps2=acceleration, frequency_hz=hz)
    scene = held(body=body(friction_kinetic=0.5), vibration=shaken, duration_s=1.0)
    assert plan(scene, MM).level is level


def test_every_scene_of_the_command_line_can_be_planned() -> None:
    for build in SCENES.values():
        found = plan(build(World(object=body())), Tolerance(slip_m=2e-3))
        assert found.lines()[-2].startswith("choice: L")
        assert np.isfinite(found.answer.slip_m)


def test_peak_force_of_a_plan_is_the_force_stop() -> None:
    assert plan(lift(), MM).answer.peak_force_n == pytest.approx(10.0)
