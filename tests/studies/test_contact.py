"""The contact levels against closed forms and an adaptive Runge-Kutta reference."""

from typing import Any

import msgspec
import numpy as np
import pytest

from scenarios.world.contact import GRAVITY_MPS2
from scenarios.world.settings import ContactSettings, Impact, Level
from studies.contact.reference import adaptive
from studies.contact.scene import (
    BODY,
    PADS,
    Closing,
    Scene,
    grip_travel,
    lift,
    simulate,
    tap,
    vibration,
)

changed = msgspec.structs.replace
BALL = {"shape": "ellipsoid", "half_width_m": 0.0603, "half_height_m": 0.0603}


def grasped(**fields: Any) -> Scene:
    """In a 10 N grip, nothing else happening."""
    return changed(vibration(), **{"duration_s": 0.4, "shake_mps2": 0.0, **fields})


SAME = changed(BODY, friction_kinetic=0.5)  # no jump of the force as it begins to slide
TOP = changed(tap(), body=SAME)
SIDE_TAP = Impact(impulse_n_s=0.12, duration_s=8e-3, offset_m=0.04, direction="side")
SIDE = changed(TOP, tap=SIDE_TAP)


@pytest.mark.parametrize(
    "scene",
    [lift(), grasped(tap=Impact(impulse_n_s=0.2, duration_s=8e-3, offset_m=0.0)),
     lift(pads=ContactSettings()),
     changed(lift(), body=changed(BODY, **BALL, grip_height_m=0.012))],
    ids=["lift", "tap", "relaxing", "flank"],
)  # fmt: skip
def test_without_lever_and_side_load_all_levels_move_alike(scene: Scene) -> None:
    first, *others = (simulate(scene, level, 1e-3) for level in Level)
    for other in others:
        assert other == pytest.approx(first, abs=1e-9)


@pytest.mark.parametrize(
    ("scene", "level"),
    [(lift(), Level.SLIDER), (TOP, Level.SPIN), (SIDE, Level.SPIN), (TOP, Level.BRUSH)],
)
def test_extrapolated_backward_euler_agrees_with_adaptive_runge_kutta(
    scene: Scene, level: Level
) -> None:
    exact = adaptive(scene, level, 1e-11)
    found = 2 * simulate(scene, level, 5e-5) - simulate(scene, level, 1e-4)
    assert np.linalg.norm(found - exact) < 2e-6
    assert np.linalg.norm(exact) > 2e-3


def test_spin_torque_of_one_point_resists_turning_as_a_patch_does() -> None:
    impact = Impact(impulse_n_s=0.4, duration_s=8e-3, offset_m=0.02)
    spin, brush = (
        simulate(changed(tap(), tap=impact), level, 5e-4)[0] for level in (Level.SPIN, Level.BRUSH)
    )
    assert spin == pytest.approx(brush, rel=3e-3)  # without the torque: 8e-3 more
    assert brush > 0.0  # the mark moves aside as the object turns


def test_ball_held_past_its_widest_point_is_expelled_and_a_long_box_is_not() -> None:
    def moved(**what: Any) -> float:
        body = changed(BODY, mass_kg=0.05, friction_static=0.3, friction_kinetic=0.3, **what)
        closing = Closing(start_s=0.1, speed_mps=0.02, force_stop_n=10.0)
        travel = grip_travel(body, 1.0, 1.0)
        scene = grasped(body=body, travel_m=travel, closing=closing, duration_s=1.0)
        return -float(simulate(scene, Level.SLIDER, 5e-4)[1])

    assert moved(**BALL, grip_height_m=0.035) > 0.1
    assert moved(**BALL, grip_height_m=-0.005) < 0.01
    assert moved() < 0.001


def loaded(ratio: float, **fields: Any) -> Scene:
    """A held object whose weight is this share of the friction cone."""
    mass_kg = ratio * 0.5 * 20.0 / GRAVITY_MPS2
    body = changed(BODY, mass_kg=mass_kg, friction_kinetic=0.5, body_above_grip_m=0.5)
    return grasped(**{"body": body, "duration_s": 2.0, **fields})


@pytest.mark.parametrize("level", [*Level])
def test_inside_the_cone_nothing_creeps(level: Level) -> None:
    short, long = (simulate(loaded(0.99, duration_s=t), level, 1e-2) for t in (1.0, 8.0))
    assert abs(long[1] - short[1]) < 1e-12


def test_outside_the_cone_the_object_falls_at_the_rate_of_the_closed_form() -> None:
    expected = 0.5 * GRAVITY_MPS2 * (1 - 1 / 1.01) * 2.0**2
    assert -simulate(loaded(1.01), Level.SLIDER, 1e-3)[1] == pytest.approx(expected, rel=2e-3)


def test_vibration_inside_the_cone_causes_no_drift() -> None:
    stiff = changed(PADS, shear_stiffness_npm=1e5)  # the pads' own resonance far above
    first, last = (
        simulate(changed(vibration(), contact=stiff, duration_s=t), Level.SLIDER, 1e-3)[1]
        for t in (0.5, 1.5)  # whole periods
    )
    assert abs(last - first) < 1e-7


@pytest.mark.parametrize("stiffness_npm", [7e3, 1e6])
def test_steps_up_to_50_ms_stay_within_first_order_at_any_stiffness(stiffness_npm: float) -> None:
    scene = lift(changed(PADS, shear_stiffness_npm=stiffness_npm))
    exact = adaptive(scene, Level.SLIDER, 1e-9)
    for step_s in (5e-2, 8e-3, 1e-3):
        for level in (Level.SLIDER, Level.BRUSH):
            error = np.linalg.norm(simulate(scene, level, step_s) - exact)
            assert error < 0.11 * step_s, (level, step_s)  # the arm rises 0.1 m/s
