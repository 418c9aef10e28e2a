"""Impacts on a held object, from the side and at any step length."""

import pytest

from scenarios.world import laws
from scenarios.world.contact import Floats, initial_state, parameters
from scenarios.world.settings import ContactSettings
from tests.unit.scenarios.world.test_contact import body, fresh_pads, travel

GRIP = travel(59.2, 55, 55)
AT_S = 0.3


Scene = tuple[Floats, Floats, Floats]  # parameters, state, elements


def held_object(mass_kg: float = 0.35, **settings: float) -> Scene:
    p = parameters(ContactSettings(relaxation_fraction=0.0, **settings), body(mass_kg=mass_kg))
    state, pads = initial_state(), fresh_pads()
    state[laws.HEIGHT] = 0.3
    laws.advance(p, state, pads, 0.0, AT_S, 5e-4, 0.0, 0.0, 0.0, GRIP, GRIP)
    return p, state, pads


def state_after_impact(
    scene: Scene, direction: int, impulse_n_s: float, step_s: float = 5e-4, seconds: float = 0.5
) -> Floats:
    p, s, pads = (part.copy() for part in scene)
    s[laws.TAP_DIRECTION] = direction
    s[[laws.TAP_START_S, laws.TAP_S, laws.TAP_N_S]] = AT_S, 0.008, impulse_n_s
    laws.advance(p, s, pads, AT_S, seconds, step_s, 0.0, 0.0, 0.0, GRIP, GRIP)
    return s


def test_side_impact_moves_the_object_across_and_down() -> None:
    """Friction used across is missing upwards."""
    p, state, pads = held_object()
    s = state_after_impact((p, state, pads), laws.SIDE, 0.25)
    across, sunk = s[laws.ACROSS], s[laws.SLIP] - state[laws.SLIP]
    assert 0.002 < across < 0.03
    assert 0.05 * across < sunk < across


@pytest.mark.parametrize("step_s", [1e-4, 1e-3, 5e-3, 0.05])
@pytest.mark.parametrize("duration_s", [0.001, 0.016])
def test_any_step_length_delivers_the_full_impulse(step_s: float, duration_s: float) -> None:
    p = parameters(ContactSettings(impact_step_s=step_s), body())
    state, pads, open_hand = initial_state(), fresh_pads(), travel(10, 10, 10)
    state[laws.HEIGHT], state[laws.TAP_DIRECTION] = 1.0, laws.SIDE
    state[[laws.TAP_START_S, laws.TAP_S, laws.TAP_N_S]] = 0.0031, duration_s, 0.2
    state[[laws.FOLLOW_S, laws.FOLLOW_N_S]] = 0.03, 0.05
    for k in range(5):
        laws.advance(p, state, pads, k * 0.01, 0.01, 0.05, 0.0, 0.0, 0.0, open_hand, open_hand)
    assert state[laws.ACROSS_SPEED] * 0.65 == pytest.approx(0.25, rel=1e-9)
