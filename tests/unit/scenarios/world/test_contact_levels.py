"""Contact levels with a moving hand: one interface, rotation from L3 on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.world import laws
from scenarios.world.contact import (
    FINGERS,
    Contact,
    Floats,
)
from scenarios.world.settings import ContactSettings, Impact, Level
from tests.unit.scenarios.world.test_contact import body, grip_travel, travel

TURNING = (Level.SPIN, Level.BRUSH)
PADS = ContactSettings()


def lifted(contact: Contact, grip: Floats, seconds: float = 0.6) -> Contact:
    """Lift from the table at 0.5 m/s2 up to 0.1 m/s, in steps of a control period."""
    contact.place()
    v = 0.0
    for k in range(round(seconds / 0.01)):
        v1 = min(0.1, v + 0.005)
        contact.advance(k * 0.01, 0.01, (v + v1) / 2 * 0.01, v, v1, grip, grip)
        v = v1
    return contact


def in_grip(
    level: Level, impact_level: Level | None = None, **fields: object
) -> tuple[Contact, Floats]:
    grasped = body(mass_kg=0.35, **fields)
    contact = Contact(PADS, grasped, level, impact_level)
    contact.place()
    contact.state[laws.HEIGHT] = 1.0
    grip = np.array(grip_travel(grasped, 5.0, 5.0))
    contact.advance(0.0, 0.3, 0.0, 0.0, 0.0, grip, grip)
    return contact, grip


def state_after_impact(
    impact: Impact, level: Level, impact_level: Level | None = None, **fields: object
) -> Floats:
    contact, grip = in_grip(level, impact_level, **fields)
    contact.strike(impact, 0.3)
    contact.advance(0.3, 0.4, 0.0, 0.0, 0.0, grip, grip)
    return contact.state


def impact(direction: str = "side", offset_m: float = 0.04, impulse_n_s: float = 0.2) -> Impact:
    return Impact(
        impulse_n_s=impulse_n_s, duration_s=0.008, direction=direction,  # type: ignore[arg-type]
        offset_m=offset_m,
    )  # fmt: skip


@settings(max_examples=20)
@given(
    mass_kg=st.floats(0.1, 0.9), friction=st.floats(0.4, 1.0), kept=st.floats(0.6, 1.0),
    count=st.floats(54.5, 60.0),
)  # fmt: skip
def test_centred_lift_is_the_same_at_every_level(
    mass_kg: float, friction: float, kept: float, count: float
) -> None:
    grasped = body(mass_kg=mass_kg, friction_static=friction, friction_kinetic=kept * friction)
    grip = travel(count, count, count)
    states = [lifted(Contact(PADS, grasped, level), grip).state for level in Level]
    same = (laws.HEIGHT, laws.SLIP, laws.SPEED, laws.NORMAL, laws.SHEAR, laws.SLIP_SPEED)
    for other in states[1:]:
        assert other[list(same)] == pytest.approx(states[0][list(same)], rel=1e-6, abs=1e-8)
        assert abs(other[laws.TURN]) < 1e-9
        assert other[laws.ONSET_S] == pytest.approx(states[0][laws.ONSET_S], abs=6e-4)


@pytest.mark.parametrize("level", TURNING)
def test_impacts_above_and_below_the_grip_turn_the_object_in_opposite_directions(
    level: Level,
) -> None:
    above, below = (state_after_impact(impact(offset_m=at), level) for at in (0.04, -0.04))
    assert above[laws.TURN] < -0.02  # from upwards to across
    assert below[laws.TURN] > 0.02
    assert above[laws.ACROSS] > 0.0 and above[laws.SLIP] > 0.0


def advance(contact: Contact, grip: Floats, start_s: float, seconds: float) -> Floats:
    """Advance in steps of a control period, the hand at rest."""
    for k in range(round(seconds / 0.01)):
        contact.advance(start_s + 0.01 * k, 0.01, 0.0, 0.0, 0.0, grip, grip)
    return contact.state


def test_contact_level_is_that_before_the_impact_again_once_the_object_is_at_rest() -> None:
    (switching, grip), (constant, _) = in_grip(Level.SLIDER, Level.BRUSH), in_grip(Level.BRUSH)
    for contact in (switching, constant):
        contact.strike(impact(), 0.3)
        advance(contact, grip, 0.3, 0.5)
        assert contact.level is Level.BRUSH
        advance(contact, grip, 0.8, 3.0)
    assert (switching.level, constant.level) == (Level.SLIDER, Level.BRUSH)
    alike = [laws.SLIP, laws.ACROSS, laws.TURN, *range(laws.NORMAL, laws.NORMAL + FINGERS)]
    assert switching.state[alike] == pytest.approx(constant.state[alike], abs=2e-4)
    assert constant.state[laws.TURN] < -0.02
