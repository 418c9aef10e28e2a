"""The five levels: one interface, agreement where they must agree, and with another method."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.world import laws
from scenarios.world.contact import GRAVITY_MPS2
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder import rigid
from scenarios.world.ladder.levels import simulate
from scenarios.world.ladder.reference import adaptive
from scenarios.world.ladder.scene import Closing, Grip, Scene, squeeze
from scenarios.world.world_settings import Level
from tests.unit.scenarios.world.ladder.ladder_scenes import SOFT, body, changed, held, lift, tap

AWAY = {"centre_aside_m": -0.004, "centre_above_m": 0.02}
COMPLIANT = (Level.SLIDER, Level.POINTS, Level.SPIN, Level.BRUSH)


def extrapolated(scene: Scene, level: Level, step_s: float) -> np.ndarray:
    coarse, fine = (simulate(scene, level, h).mark_m for h in (step_s, step_s / 2))
    return 2 * np.array(fine) - np.array(coarse)


def test_rigid_lift_is_the_closed_form_of_the_survey() -> None:
    assert simulate(lift(), Level.RIGID, 1.0).slip_m == pytest.approx(23.266913e-3, abs=1e-9)


def test_rigid_tap_of_vanishing_length_is_the_impulse_limit() -> None:
    # S = J^2 / (2 m (mu Sum N - m g))
    limit_m = 0.2**2 / (2 * 0.3 * (0.5 * 20.0 - 0.3 * GRAVITY_MPS2))
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
        (held(tap=tap(0.02), body=body(**AWAY, friction_kinetic=0.5)), Level.POINTS),
        (
            held(tap=tap(0.04, "side", 0.12), body=body(**AWAY, friction_kinetic=0.5)),
            Level.POINTS,
        ),
        (lift(body=body(**AWAY)), Level.POINTS),
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
    turned = simulate(lift(body=body(centre_aside_m=0.005)), Level.POINTS, 1e-3)
    mirrored = simulate(lift(body=body(centre_aside_m=-0.005)), Level.POINTS, 1e-3)
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
    work = np.column_stack([a, b, caps, arm])
    taken = laws.solve_planar(v, inertia, push, work, np.empty((6, 3)))
    assert taken < laws.NEWTON_LIMIT
    r = np.stack([v[0] - v[2] * arm[:, 1], v[1] + v[2] * arm[:, 0], v[2] * arm[:, 2]], axis=1)
    f = a - b[:, None] * r
    size = np.maximum(np.linalg.norm(f, axis=1), 1e-300)
    f *= np.minimum(1.0, caps / size)[:, None]
    torque = arm[:, 0] * f[:, 1] - arm[:, 1] * f[:, 0] + arm[:, 2] * f[:, 2]
    left = inertia * v + push - [f[:, 0].sum(), f[:, 1].sum(), torque.sum()]
    scale = np.abs(push).sum() + caps.sum() + np.abs(inertia * v).sum()
    assert np.abs(left).max() < 1e-8 * scale
