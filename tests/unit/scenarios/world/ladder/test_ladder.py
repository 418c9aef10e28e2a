"""The five levels: one interface, agreement where they must agree, and with another method."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.world import contact
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder import compliant, rigid
from scenarios.world.ladder.levels import Level, compliant_parameters, simulate
from scenarios.world.ladder.reference import adaptive
from scenarios.world.ladder.scene import Closing, Grip, Plane, Scene, squeeze
from tests.unit.scenarios.world.ladder.ladder_scenes import SOFT, body, changed, held, lift, tap

AWAY = Plane(centre_of_mass_y_m=-0.004, centre_of_mass_z_m=0.02)
COMPLIANT = (Level.SLIDER, Level.POINTS, Level.SPIN, Level.BRUSH)


def extrapolated(scene: Scene, level: Level, step_s: float) -> np.ndarray:
    coarse, fine = (simulate(scene, level, h).mark_m for h in (step_s, step_s / 2))
    return 2 * np.array(fine) - np.array(coarse)


def test_rigid_lift_is_the_closed_form_of_the_survey() -> None:
    assert simulate(lift(), Level.RIGID, 1.0).slip_m == pytest.approx(23.266913e-3, abs=1e-9)


def test_rigid_tap_of_vanishing_length_is_the_impulse_limit() -> None:
    # S = J^2 / (2 m (mu Sum N - m g))
    limit_m = 0.2**2 / (2 * 0.3 * (0.5 * 20.0 - 0.3 * contact.GRAVITY_MPS2))
    slips = [
        simulate(held(tap=tap(duration_s=d)), Level.RIGID, 1.0).slip_m for d in (1e-2, 1e-3, 1e-5)
    ]
    errors = [limit_m - s for s in slips]
    assert errors == sorted(errors, reverse=True)
    assert slips[-1] == pytest.approx(limit_m, rel=1e-3)


BALL = {"shape": "ellipsoid", "half_width_m": 0.0603, "half_height_m": 0.0603}
RELAXING = ContactSettings()
FLANK = lift(contact=RELAXING, body=body(**BALL, grip_height_m=0.012))


@pytest.mark.parametrize(
    "scene", [lift(), held(tap=tap()), lift(contact=RELAXING), FLANK],
    ids=["lift", "tap", "relaxing", "flank"],
)  # fmt: skip
def test_without_lever_and_side_load_all_compliant_levels_move_alike(scene: Scene) -> None:
    slips = [simulate(scene, level, 1e-3) for level in COMPLIANT]
    for other in slips[1:]:
        assert other.z_m == pytest.approx(slips[0].z_m, abs=1e-9)
        assert abs(other.turn_rad) < 1e-9


@pytest.mark.parametrize(
    ("scene", "level"),
    [
        (lift(), Level.SLIDER), (held(tap=tap(0.02)), Level.POINTS),
        (held(tap=tap(0.04, "side", 0.12)), Level.SPIN),
        (held(tap=tap(0.02)), Level.BRUSH),
        (held(tap=tap(0.02), plane=AWAY), Level.POINTS),
        (held(tap=tap(0.04, "side", 0.12), plane=AWAY), Level.POINTS),
        (lift(plane=AWAY), Level.POINTS),
    ],
)  # fmt: skip
def test_backward_euler_extrapolated_meets_adaptive_runge_kutta(scene: Scene, level: Level) -> None:
    exact = adaptive(scene, level, 1e-11)
    error = np.linalg.norm(extrapolated(scene, level, 1e-4) - np.array(exact.mark_m))
    assert error < 2e-6
    assert exact.slip_m > 2e-3


def test_error_of_backward_euler_halves_with_the_step() -> None:
    exact = adaptive(lift(), Level.SLIDER, 1e-11).slip_m
    errors = [abs(simulate(lift(), Level.SLIDER, h).slip_m - exact) for h in (2e-3, 1e-3, 5e-4)]
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("shape", [{}, {**BALL, "grip_height_m": 0.02}], ids=["straight", "ball"])
def test_slider_level_is_the_law_that_the_lift_runs_on(shape: dict[str, object]) -> None:
    # the production kernel, told the same path of hand and fingers step by step; pads relax
    what, pads, h = body(**shape), ContactSettings(), 5e-4
    first = squeeze(what, pads, 1.0, 1.0)
    closing = Closing(start_s=0.3, speed_mps=5e-3, force_stop_n=60.0)
    scene = lift(
        contact=pads, body=what, duration_s=0.5, grip=Grip(travel_m=first, closing=closing)
    )
    p, s = contact.parameters(pads, what), contact.initial_state()
    travel = np.array(first)
    for k in range(1000):
        t0, t1 = k * h, (k + 1) * h
        v0, v1 = min(0.5 * t0, 0.1), min(0.5 * t1, 0.1)
        travel[0] = first[0] + 5e-3 * max(0.0, t1 - 0.3)
        contact.advance(p, s, t0, h, h, h * (v0 + v1) / 2, v0, v1, travel, travel)
    ours = simulate(scene, Level.SLIDER, h)
    assert -ours.z_m == pytest.approx(s[contact.SLIP], abs=1e-9)
    assert ours.normal_n == pytest.approx(s[contact.NORMAL : contact.NORMAL + 3], rel=1e-9)
    assert ours.slip_m > 0.01


@given(
    travel=st.tuples(*[st.floats(0.03, 0.06)] * 3), slip=st.floats(-0.05, 0.2),
    height=st.floats(-0.03, 0.03), ball=st.booleans(),
)  # fmt: skip
def test_normal_forces_are_those_of_the_production_law(
    travel: tuple[float, float, float], slip: float, height: float, ball: bool
) -> None:
    what = body(**BALL, grip_height_m=height) if ball else body()
    p = contact.parameters(SOFT, what)
    expected, s = np.zeros(3), np.zeros(compliant.STATE_SIZE)
    width, slope = contact.width_and_slope(p, slip)
    contact.normal_forces(p, width, np.array(travel), contact.initial_state(), expected)
    s[compliant.TRAVEL : compliant.TRAVEL + 3] = travel
    assert compliant.width_and_slope(p, slip) == (width, slope)
    compliant.normal_forces(p, s, width)
    assert s[compliant.NORMAL : compliant.NORMAL + 3].tolist() == expected.tolist()


def test_parameters_of_the_levels_begin_with_those_of_the_production_law() -> None:
    assert compliant.P_INERTIA == contact.PARAMETER_SIZE
    assert len(compliant_parameters(lift())) == compliant.PARAMETER_SIZE


def test_fingers_stop_one_at_a_time_at_their_own_force() -> None:
    thumb = simulate(lift(), Level.SLIDER, 0.05)
    assert thumb.normal_n == pytest.approx((10.0, 5.0, 5.0), abs=1e-9)
    grip = lift().grip
    all_close = changed(grip, closing=changed(grip.closing, fingers="all", speed_mps=0.01))
    opposed = simulate(lift(grip=all_close), Level.SLIDER, 1e-4)
    # each motor stops at 10 N; self-locking, the thumb carries what the other two go on to press
    assert opposed.normal_n == pytest.approx((20.0, 10.0, 10.0), rel=1e-3)
    exact = rigid.grip_forces(lift(grip=all_close)).force_n[-1]
    assert opposed.normal_n == pytest.approx(exact, rel=1e-3)


def test_ball_held_past_its_widest_point_is_expelled_by_closing_fingers_and_a_long_box_is_not() -> (
    None
):
    def closed(what: dict[str, object]) -> float:
        thing = body(mass_kg=0.05, friction_static=0.3, friction_kinetic=0.3, **what)
        closing = Closing(start_s=0.1, speed_mps=0.02, force_stop_n=10.0)
        grip = Grip(travel_m=squeeze(thing, SOFT, 1.0, 1.0), closing=closing)
        outcomes = [
            simulate(held(body=thing, grip=grip, duration_s=1.0), level, 5e-4)
            for level in (Level.SLIDER, Level.POINTS, Level.BRUSH)
        ]
        assert len({o.held for o in outcomes}) == 1
        return outcomes[0].normal_n[0]

    assert closed({**BALL, "grip_height_m": 0.035}) == 0.0
    assert closed({**BALL, "grip_height_m": -0.005}) == pytest.approx(10.0)
    assert closed({}) == pytest.approx(10.0)


def test_weight_beside_the_grip_turns_the_object_while_it_slides() -> None:
    turned = simulate(lift(plane=Plane(centre_of_mass_y_m=0.005)), Level.POINTS, 1e-3)
    mirrored = simulate(lift(plane=Plane(centre_of_mass_y_m=-0.005)), Level.POINTS, 1e-3)
    assert turned.turn_rad < -1e-3  # clockwise: the weight is on the right
    assert mirrored.turn_rad == pytest.approx(-turned.turn_rad, rel=1e-6)


def test_patches_resist_turning_and_points_do_not() -> None:
    turns = [
        abs(simulate(held(tap=tap(0.02, impulse_n_s=0.4)), level, 5e-4).turn_rad)
        for level in (Level.POINTS, Level.SPIN, Level.BRUSH)
    ]
    assert turns[0] > turns[2] > 0.0
    assert abs(turns[1] - turns[2]) < abs(turns[0] - turns[2])


def test_rigid_level_refuses_what_it_does_not_know() -> None:
    with pytest.raises(ValueError, match="flanks"):
        simulate(lift(contact=ContactSettings()), Level.RIGID, 1.0)
    with pytest.raises(ValueError, match="straight"):
        adaptive(lift(contact=ContactSettings()), Level.SLIDER, 1e-9)


def test_object_left_alone_on_the_table_stays_there() -> None:
    open_hand = lift(grip=Grip(travel_m=(0.01, 0.01, 0.01)))
    for level in COMPLIANT:
        assert simulate(open_hand, level, 1e-3).z_m == pytest.approx(-0.15, abs=1e-12)


@given(
    seed=st.integers(0, 2**32 - 1), count=st.integers(1, 40), stiffness=st.floats(1e-1, 1e5),
    weight=st.floats(1e-3, 1e5), cap=st.floats(0.0, 30.0),
)  # fmt: skip
def test_planar_step_equation_is_solved_whatever_the_numbers(
    seed: int, count: int, stiffness: float, weight: float, cap: float
) -> None:
    rng = np.random.default_rng(seed)
    inertia = weight * np.array([1.0, 1.0, rng.uniform(1e-4, 1e-2)])
    push, v = rng.normal(0.0, 10.0, 3) * [1.0, 1.0, 0.05], rng.normal(0.0, 1.0, 3)
    a, arm = rng.normal(0.0, 5.0, (count, 3)), rng.normal(0.0, 0.03, (count, 3))
    b, caps = stiffness * rng.uniform(0.1, 1.0, count), cap * rng.uniform(0.0, 1.0, count)
    taken = compliant.solve_velocity(v, inertia, push, a, b, caps, arm, np.empty((6, 3)))
    assert taken < compliant.NEWTON_LIMIT
    r = np.stack([v[0] - v[2] * arm[:, 1], v[1] + v[2] * arm[:, 0], v[2] * arm[:, 2]], axis=1)
    f = a - b[:, None] * r
    size = np.maximum(np.linalg.norm(f, axis=1), 1e-300)
    f *= np.minimum(1.0, caps / size)[:, None]
    torque = arm[:, 0] * f[:, 1] - arm[:, 1] * f[:, 0] + arm[:, 2] * f[:, 2]
    left = inertia * v + push - [f[:, 0].sum(), f[:, 1].sum(), torque.sum()]
    scale = np.abs(push).sum() + caps.sum() + np.abs(inertia * v).sum()
    assert np.abs(left).max() < 1e-8 * scale
