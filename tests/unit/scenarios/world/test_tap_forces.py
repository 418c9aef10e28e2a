"""Blows on a held object: across, along the closing axis, and the step of two directions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.world import contact
from scenarios.world.contact import Floats
from scenarios.world.contact_settings import ContactSettings
from tests.unit.scenarios.world.test_contact import body, forces_at, travel

GRIP = travel(59.2, 55, 55)
AT_S = 0.3


def held(mass_kg: float = 0.35, **settings: float) -> tuple[Floats, Floats]:
    p = contact.parameters(
        ContactSettings(relaxation_fraction=0.0, **settings), body(mass_kg=mass_kg)
    )
    state = contact.initial_state()
    state[contact.HEIGHT] = 0.3
    contact.advance(p, state, 0.0, AT_S, 5e-4, 0.0, 0.0, 0.0, GRIP, GRIP)
    return p, state


def struck(
    p: Floats, state: Floats, direction: int, impulse_n_s: float, step_s: float = 5e-4,
    seconds: float = 0.5,
) -> Floats:  # fmt: skip
    s = state.copy()
    s[contact.TAP_DIRECTION] = direction
    s[[contact.TAP_START_S, contact.TAP_S, contact.TAP_N_S]] = AT_S, 0.008, impulse_n_s
    contact.advance(p, s, AT_S, seconds, step_s, 0.0, 0.0, 0.0, GRIP, GRIP)
    return s


@given(
    inertia=st.floats(1e-2, 1e5), push=st.tuples(*[st.floats(-1e4, 1e4)] * 2),
    a_z=st.tuples(*[st.floats(-50, 50)] * 3), a_y=st.tuples(*[st.floats(-50, 50)] * 3),
    b=st.floats(1e-2, 1e4), cap=st.tuples(*[st.floats(0, 30)] * 3), cos=st.floats(0.3, 1.0),
)  # fmt: skip
def test_step_in_two_directions_balances_every_force_whatever_the_numbers(
    inertia: float, push: tuple[float, float], a_z: tuple[float, ...], a_y: tuple[float, ...],
    b: float, cap: tuple[float, ...], cos: float,
) -> None:  # fmt: skip
    arrays = np.array(a_z), np.array(a_y)
    z, y = contact.solve_planar(inertia, *push, cos, *arrays, b, np.array(cap))
    trial = np.stack([arrays[0] - b * z, arrays[1] - b * y])
    size = np.hypot(*trial)
    force = trial * np.minimum(1.0, np.array(cap) / np.maximum(size, 1e-300))
    rest_z = inertia * z + push[0] - cos * force[0].sum()
    rest_y = inertia * y + push[1] - force[1].sum()
    scale = 1e-6 + abs(push[0]) + abs(push[1]) + sum(cap) + sum(map(abs, a_z + a_y))
    assert math.hypot(rest_z, rest_y) < 1e-8 * scale


@given(
    push=st.floats(-1e3, 1e3), a=st.tuples(*[st.floats(-50, 50)] * 3), b=st.floats(1e-1, 1e3),
    cap=st.tuples(*[st.floats(0, 30)] * 3),
)  # fmt: skip
def test_without_a_side_load_the_planar_step_is_the_scalar_one(
    push: float, a: tuple[float, ...], b: float, cap: tuple[float, ...]
) -> None:
    scalar = contact.solve_velocity(100.0, push, np.array(a), b, np.array(cap))
    planar = contact.solve_planar(100.0, push, 0.0, 1.0, np.array(a), np.zeros(3), b, np.array(cap))
    assert planar == (pytest.approx(scalar, abs=1e-9), 0.0)


def test_side_blow_moves_the_object_across_and_lets_it_sink_by_friction_spent_sideways() -> None:
    p, state = held()
    s = struck(p, state, contact.SIDE, 0.25)
    across, sunk = s[contact.ACROSS], s[contact.SLIP] - state[contact.SLIP]
    assert 0.002 < across < 0.03
    assert 0.05 * across < sunk < across


def test_slide_across_ends_where_work_against_friction_has_used_up_the_blow() -> None:
    # short pulse, stiff pads, next to no weight: S = J^2 / (2 m mu_k sum(N))
    hard = {"shear_stiffness_npm": 1e6, "shear_damping_nspm": 200.0}
    p, state = held(mass_kg=0.02, **hard)
    s = state.copy()
    s[contact.TAP_DIRECTION] = contact.SIDE
    s[[contact.TAP_START_S, contact.TAP_S, contact.TAP_N_S]] = AT_S, 1e-4, 0.03
    contact.advance(p, s, AT_S, 0.2, 1e-5, 0.0, 0.0, 0.0, GRIP, GRIP)
    total_n = s[contact.NORMAL : contact.NORMAL + 3].sum()
    expected = 0.03**2 / (2 * 0.02 * 0.7 * total_n)
    assert s[contact.ACROSS] == pytest.approx(expected, rel=0.05)


def test_friction_of_a_finger_stays_within_its_circle() -> None:
    p, state = held()
    s = state.copy()
    s[contact.TAP_DIRECTION] = contact.SIDE
    s[[contact.TAP_START_S, contact.TAP_S, contact.TAP_N_S]] = AT_S, 0.008, 0.3
    before = s[contact.ACROSS_SPEED]
    for k in range(200):
        contact.advance(p, s, AT_S + k * 1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0, GRIP, GRIP)
        blow = contact.tap_force(s, AT_S + (k + 0.5) * 1e-4)
        across_n = 0.35 * (s[contact.ACROSS_SPEED] - before) / 1e-4 - blow
        up_n = s[contact.SHEAR : contact.SHEAR + 3].sum()
        before = s[contact.ACROSS_SPEED]
        limit = 0.8 * s[contact.NORMAL : contact.NORMAL + 3].sum()
        assert math.hypot(across_n, up_n) < limit * 1.0001


def test_equal_blows_move_it_less_far_across_than_down() -> None:
    p, state = held()
    down = struck(p, state, contact.TOP, 0.25)[contact.SLIP] - state[contact.SLIP]
    across = struck(p, state, contact.SIDE, 0.25)[contact.ACROSS]
    assert across < down  # gravity helps the one and not the other


def test_side_slide_does_not_depend_on_the_step() -> None:
    p, state = held()
    coarse = struck(p, state, contact.SIDE, 0.25, 5e-4)[contact.ACROSS]
    fine = struck(p, state, contact.SIDE, 0.25, 5e-6)[contact.ACROSS]
    assert coarse == pytest.approx(fine, rel=0.015)


def test_first_and_last_instant_of_motion_are_noted_after_a_blow_only() -> None:
    p, state = held()
    assert state[contact.MOVED_FROM_S] == contact.NOT_YET
    s = struck(p, state, contact.SIDE, 0.25)
    assert AT_S < s[contact.MOVED_FROM_S] < AT_S + 0.01
    assert 0.01 < s[contact.MOVED_UNTIL_S] - s[contact.MOVED_FROM_S] < 0.1


def test_object_struck_beyond_its_own_half_width_is_out_of_the_hand() -> None:
    p, state = held()
    s = struck(p, state, contact.SIDE, 1.5)
    assert s[contact.NORMAL : contact.NORMAL + 3].tolist() == [0.0, 0.0, 0.0]


def test_follow_through_adds_its_impulse_after_the_pulse() -> None:
    p = contact.parameters(ContactSettings(), body())
    state = contact.initial_state()
    state[contact.HEIGHT] = 1.0
    state[[contact.TAP_START_S, contact.TAP_S, contact.TAP_N_S]] = 0.01, 0.008, 0.2
    state[[contact.FOLLOW_S, contact.FOLLOW_N_S]] = 0.03, 0.05
    open_hand = travel(10, 10, 10)
    contact.advance(p, state, 0.0, 0.06, 5e-4, 0.0, 0.0, 0.0, open_hand, open_hand)
    expected = -contact.GRAVITY_MPS2 * 0.06 - 0.25 / 0.65
    assert state[contact.SPEED] == pytest.approx(expected, rel=1e-3)


def test_blow_along_the_closing_axis_loads_the_thumb_and_unloads_the_others() -> None:
    p, state = held()
    resting = forces_at(p, GRIP)
    pressed = np.zeros(3)
    width, _ = contact.width_and_slope(p, 0.0)
    contact.struck_normal_forces(p, width, GRIP, 5.0, state.copy(), pressed)
    assert pressed[0] == pytest.approx(pressed[1] + pressed[2] + 5.0)
    assert pressed[0] > resting[0]
    assert pressed[1] < resting[1]


def test_blow_harder_than_the_grip_lifts_the_object_off_the_opposing_fingers() -> None:
    p, state = held()
    pressed = np.zeros(3)
    width, _ = contact.width_and_slope(p, 0.0)
    contact.struck_normal_forces(p, width, GRIP, 40.0, state.copy(), pressed)
    assert pressed.tolist() == [pytest.approx(40.0), 0.0, 0.0]


def test_push_of_nothing_leaves_the_grip_as_it_is() -> None:
    p, state = held()
    pressed = np.zeros(3)
    width, _ = contact.width_and_slope(p, 0.0)
    contact.struck_normal_forces(p, width, GRIP, 0.0, state.copy(), pressed)
    assert pressed == pytest.approx(forces_at(p, GRIP))
