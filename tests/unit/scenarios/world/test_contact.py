"""The contact law against closed forms, brute force and the limit of small steps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.world import laws
from scenarios.world.contact import (
    Floats,
    elements,
    finger_stiffness,
    initial_state,
    parameters,
)
from scenarios.world.objects import GraspObject
from scenarios.world.settings import HALF_APERTURE_M, ContactSettings, Level

COUNT_M = 0.00077


def body(**changes: object) -> GraspObject:
    plain = {
        "name": "test", "grip_counts": (55, 55, 55), "mass_kg": 0.65, "friction_static": 0.8,
        "friction_kinetic": 0.7, "wall_stiffness_npm": 2e5, "half_width_m": 0.0356,
    }  # fmt: skip
    return GraspObject(**{**plain, **changes})  # type: ignore[arg-type]


def fresh_pads() -> Floats:
    return elements(Level.SLIDER)


def travel(a: float, b: float, c: float) -> Floats:
    return np.array([a, b, c]) * COUNT_M


def grip_travel(grasped: GraspObject, b_n: float, c_n: float) -> Floats:
    """Travel (3,) at which B and C press with b_n and c_n and the thumb with their sum."""
    k = finger_stiffness(grasped)
    return HALF_APERTURE_M - grasped.half_width_m + np.array([b_n + c_n, b_n, c_n]) / k


def forces_at(p: Floats, positions: Floats, state: Floats | None = None) -> Floats:
    out = np.zeros(3)
    state = initial_state() if state is None else state
    width, _ = laws.width_and_slope(p, state[laws.SLIP])
    laws.normal_forces(p, width, positions, state, out)
    return out


def test_a_short_object_far_from_the_middle_is_pressed_like_a_long_one() -> None:
    forces = []
    for above_m in (0.035, 0.2):
        state = initial_state()
        state[laws.LATERAL] = -0.03
        short = body(half_width_m=0.02, body_above_grip_m=above_m, wall_stiffness_npm=1e3)
        p = parameters(ContactSettings(), short)
        forces.append(forces_at(p, np.array([0.0955, 0.0295, 0.0295]), state).tolist())
    assert forces[0] == forces[1] and forces[0][0] > 1.0


def lift(
    p: Floats, step_s: float, positions: Floats, seconds: float = 1.2, speed: float = 0.1
) -> Floats:
    """State after an arm that accelerates at 0.5 m/s2 to `speed`, fingers closing at 0.3 s."""
    state, pads = initial_state(), fresh_pads()
    v = 0.0
    for k in range(round(seconds / 0.01)):
        v1 = min(speed, v + 0.005)
        closing = 1.0 if k >= 30 else 0.0
        start = positions + closing * np.array([min((k - 30) * 0.6e-3, 3.2e-3), 0, 0])
        end = positions + closing * np.array([min((k - 29) * 0.6e-3, 3.2e-3), 0, 0])
        rise = (v + v1) / 2 * 0.01
        laws.advance(p, state, pads, k * 0.01, 0.01, step_s, rise, v, v1, start, end)
        v = v1
    return state


def test_thumb_carries_the_sum_of_the_opposing_fingers() -> None:
    p = parameters(ContactSettings(), body())
    forces = forces_at(p, travel(56, 55, 55.4))
    assert forces.min() > 0
    assert forces[0] == pytest.approx(forces[1] + forces[2], rel=1e-12)


@given(
    mass_per_step=st.floats(1e-2, 1e5), push=st.floats(-1e4, 1e4),
    a=st.tuples(*[st.floats(-50, 50)] * 3), b=st.floats(1e-3, 1e4),
    cap=st.tuples(*[st.floats(0, 30)] * 3),
)  # fmt: skip
def test_step_equation_is_solved_exactly_for_any_values(
    mass_per_step: float, push: float, a: tuple[float, ...], b: float, cap: tuple[float, ...]
) -> None:
    v = laws.solve_vertical(mass_per_step, push, np.array(a), b, np.array(cap))
    forces = np.clip(np.array(a) - b * v, -np.array(cap), np.array(cap))
    scale = abs(mass_per_step * v) + abs(push) + sum(cap) + max(map(abs, a))
    scale += 1e-9
    assert abs(mass_per_step * v + push - forces.sum()) < 1e-9 * scale, v


def test_object_held_within_its_friction_cone_does_not_creep() -> None:
    # 10 N at the thumb carries 2 x 10 x 0.8 = 16 N of the 6.4 N weight.
    p = parameters(ContactSettings(relaxation_fraction=0.0), body())
    state, pads = initial_state(), fresh_pads()
    positions = travel(59.2, 55, 55)
    for k in range(10):  # lift it off the table
        laws.advance(p, state, pads, k * 0.01, 0.01, 5e-4, 5e-4, 0.05, 0.05, positions, positions)
    laws.advance(p, state, pads, 0.1, 1.0, 5e-4, 0.0, 0.0, 0.0, positions, positions)
    settled = state[laws.HEIGHT]
    laws.advance(p, state, pads, 1.1, 20.0, 5e-4, 0.0, 0.0, 0.0, positions, positions)
    assert abs(state[laws.HEIGHT] - settled) < 1e-9
    assert state[laws.ONSET_S] == laws.NOT_YET


def test_slip_distance_converges_with_smaller_steps_and_the_default_step_is_close() -> None:
    p = parameters(ContactSettings(), body())
    slips = [lift(p, h, travel(55, 55, 55))[laws.SLIP] for h in (2e-3, 1e-3, 5e-4, 1e-4, 2e-5)]
    errors = [abs(s - slips[-1]) for s in slips[:-1]]
    assert errors == sorted(errors, reverse=True)
    assert errors[2] < 1e-4
    assert slips[-1] > 0.005  # and it did slip
