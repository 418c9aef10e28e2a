"""L1 to L4 under a hand that moves: one interface, rotation where a level has it."""

import copy
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.world import laws
from scenarios.world.blow import Blow
from scenarios.world.contact import (
    FINGERS,
    Contact,
    Floats,
    PadFrames,
    parameters,
)
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.scene_terms import PullSettings
from scenarios.world.world_settings import Level
from tests.unit.scenarios.world.test_contact import body, lift, squeeze, travel

COMPLIANT = (Level.SLIDER, Level.POINTS, Level.SPIN, Level.BRUSH)
TURNING = COMPLIANT[1:]
PADS = ContactSettings()


def lifted(contact: Contact, grip: Floats, seconds: float = 0.6) -> Contact:
    """From the table at 0.5 m/s2 up to 0.1 m/s, by steps of a control period."""
    contact.place()
    v = 0.0
    for k in range(round(seconds / 0.01)):
        v1 = min(0.1, v + 0.005)
        contact.advance(k * 0.01, 0.01, (v + v1) / 2 * 0.01, v, v1, grip, grip)
        v = v1
    return contact


def held(level: Level, blow_level: Level | None = None, **fields: object) -> tuple[Contact, Floats]:
    what = body(mass_kg=0.35, **fields)
    contact = Contact(PADS, what, level, blow_level)
    contact.place()
    contact.state[laws.HEIGHT] = 1.0
    grip = np.array(squeeze(what, PADS, 5.0, 5.0))
    contact.advance(0.0, 0.3, 0.0, 0.0, 0.0, grip, grip)
    return contact, grip


def struck(blow: Blow, level: Level, blow_level: Level | None = None, **fields: object) -> Floats:
    contact, grip = held(level, blow_level, **fields)
    contact.strike(blow, 0.3)
    contact.advance(0.3, 0.4, 0.0, 0.0, 0.0, grip, grip)
    return contact.state


def blow(direction: str = "side", offset_m: float = 0.04, impulse_n_s: float = 0.2) -> Blow:
    return Blow(
        impulse_n_s=impulse_n_s, duration_s=0.008, direction=direction,  # type: ignore[arg-type]
        offset_m=offset_m,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("grip", "expected"),
    [
        ((55, 55, 55), ("0x1.7b7db8779bfcfp-6", "0x1.63afee0b0ec1cp-4", "0x1.221b65575d9f1p+3")),
        (
            (55, 55.3, 54.8),
            ("0x1.7a834749d1e93p-6", "0x1.63ee8a5681470p-4", "0x1.24d4293266200p+3"),
        ),
    ],
)
def test_slider_level_gives_the_numbers_it_gave_before_the_levels_were_one(
    grip: tuple[float, float, float], expected: tuple[str, ...]
) -> None:
    # slip distance, height and thumb's force of a lift, as an implementation of L1 alone had them
    s = lift(parameters(PADS, body()), 5e-4, travel(*grip))
    found = [s[i] for i in (laws.SLIP, laws.HEIGHT, laws.NORMAL)]
    assert found == pytest.approx([float.fromhex(text) for text in expected], rel=1e-12)


@settings(max_examples=20)
@given(
    mass_kg=st.floats(0.1, 0.9), friction=st.floats(0.4, 1.0), kept=st.floats(0.6, 1.0),
    count=st.floats(54.5, 60.0),
)  # fmt: skip
def test_centred_lift_is_the_same_at_every_compliant_level(
    mass_kg: float, friction: float, kept: float, count: float
) -> None:
    what = body(mass_kg=mass_kg, friction_static=friction, friction_kinetic=kept * friction)
    grip = travel(count, count, count)
    states = [lifted(Contact(PADS, what, level), grip).state for level in COMPLIANT]
    same = (laws.HEIGHT, laws.SLIP, laws.SPEED, laws.NORMAL, laws.SHEAR, laws.SLIP_SPEED)
    for other in states[1:]:
        assert other[list(same)] == pytest.approx(states[0][list(same)], rel=1e-6, abs=1e-8)
        assert abs(other[laws.TURN]) < 1e-9
        assert other[laws.ONSET_S] == pytest.approx(states[0][laws.ONSET_S], abs=6e-4)


@pytest.mark.parametrize("level", TURNING)
def test_blow_above_the_grip_turns_the_object_over_and_one_below_turns_it_back(
    level: Level,
) -> None:
    over, under = (struck(blow(offset_m=at), level) for at in (0.04, -0.04))
    assert over[laws.TURN] < -0.02  # from upwards to across
    assert under[laws.TURN] > 0.02
    assert over[laws.ACROSS] > 0.0 and over[laws.SLIP] > 0.0


def test_slider_level_moves_across_and_turns_nothing() -> None:
    s = struck(blow(), Level.SLIDER)
    assert s[laws.ACROSS] > 1e-3
    assert s[laws.TURN] == s[laws.TURN_RATE] == s[laws.SPIN] == 0.0


def test_rotation_about_a_pad_that_holds_on_is_noted_as_motion() -> None:
    # so weak that no pad but the light ones lets go
    s = struck(blow("top", 0.03, 0.1), Level.SPIN)
    assert abs(s[laws.TURN]) > 0.005
    assert 0.3 < s[laws.MOVED_FROM_S] < 0.32
    still = struck(blow("top", 0.03, 0.002), Level.SPIN)
    assert still[laws.MOVED_FROM_S] == laws.NOT_YET


@pytest.mark.parametrize("level", TURNING)
def test_going_on_at_a_fuller_level_from_a_blow_on_is_as_having_been_there(level: Level) -> None:
    from_the_start, later = struck(blow(), level), struck(blow(), Level.SLIDER, level)
    for of in (laws.ACROSS, laws.SLIP, laws.TURN):
        assert later[of] == pytest.approx(from_the_start[of], rel=2e-3, abs=2e-5)


def after(contact: Contact, grip: Floats, start_s: float, seconds: float) -> Floats:
    """On by steps of a control period, the hand at rest."""
    for k in range(round(seconds / 0.01)):
        contact.advance(start_s + 0.01 * k, 0.01, 0.0, 0.0, 0.0, grip, grip)
    return contact.state


def test_object_that_stands_after_a_blow_goes_on_at_the_level_before_it() -> None:
    (falls_back, grip), (stays, _) = held(Level.SLIDER, Level.BRUSH), held(Level.BRUSH)
    for contact in (falls_back, stays):
        contact.strike(blow(), 0.3)
        after(contact, grip, 0.3, 0.5)
        assert contact.level is Level.BRUSH
        after(contact, grip, 0.8, 3.0)
    assert (falls_back.level, stays.level) == (Level.SLIDER, Level.BRUSH)
    alike = [laws.SLIP, laws.ACROSS, laws.TURN, *range(laws.NORMAL, laws.NORMAL + FINGERS)]
    assert falls_back.state[alike] == pytest.approx(stays.state[alike], abs=2e-4)
    assert stays.state[laws.TURN] < -0.02


@pytest.mark.parametrize("rate", [laws.TURN_RATE, laws.ACROSS_SPEED])
def test_object_that_has_not_come_to_rest_stays_at_the_level_of_its_blow(rate: int) -> None:
    contact, grip = held(Level.SLIDER, Level.BRUSH)
    contact.strike(blow(), 0.3)
    for k in range(6):  # it swings: slow at each end, and on again
        after(contact, grip, 0.4 + 0.4 * k, 0.4)
        contact.state[rate] += 0.05
    assert contact.level is Level.BRUSH


def test_second_blow_is_followed_at_its_level_again() -> None:
    contact, grip = held(Level.SLIDER, Level.SPIN)
    for start_s in (0.3, 4.3):
        contact.strike(blow(), start_s)
        assert contact.level is Level.SPIN
        turned_rad = contact.state[laws.TURN]
        assert after(contact, grip, start_s, 4.0)[laws.TURN] < turned_rad - 0.02
        assert contact.level is Level.SLIDER


def test_world_without_an_object_lets_time_pass() -> None:
    contact = Contact(PADS, body())
    before = contact.state.copy()
    contact.advance(0.0, 0.1, 0.01, 0.1, 0.1, travel(55, 55, 55), travel(56, 56, 56))
    assert (contact.state == before).all()


@pytest.mark.parametrize("level", COMPLIANT)
def test_object_that_hangs_still_hangs_still_at_a_fuller_level(level: Level) -> None:
    contact, grip = held(Level.SLIDER, level, added_mass_kg=0.55)  # 8.8 N; its pads can bear 16
    before = contact.state.copy()
    contact.strike(blow("top", impulse_n_s=0.0), 0.3)
    for k in range(50):
        contact.advance(0.3 + k * 1e-3, 1e-3, 0.0, 0.0, 0.0, grip, grip)
        pulls = contact.state[laws.SHEAR : laws.SHEAR + FINGERS]
        assert pulls.sum() == pytest.approx(0.9 * laws.GRAVITY_MPS2, rel=0.01)
    assert contact.state[laws.SLIP] == pytest.approx(before[laws.SLIP], abs=2e-6)


def test_cell_does_not_go_on_at_a_lesser_level() -> None:
    # it would keep on turning whatever turned when the blow fell
    with pytest.raises(ValueError, match="L1 is less than L4"):
        Contact(PADS, body(), Level.BRUSH, Level.SLIDER)


@pytest.mark.parametrize("direction", ["top", "side"])
def test_blow_lands_beside_the_grip_wherever_the_object_is_by_then(direction: str) -> None:
    def spun(moved_m: float) -> float:
        contact = Contact(PADS, body(mass_kg=0.35), Level.SPIN)
        contact.place()
        contact.state[laws.HEIGHT] = 10.0
        contact.state[laws.COM_RISE if direction == "side" else laws.COM_ACROSS] = moved_m
        contact.strike(blow(direction, 0.04), 0.0)
        contact.advance(0.0, 0.1, 0.0, 0.0, 0.0, np.zeros(FINGERS), np.zeros(FINGERS))
        return float(contact.state[laws.TURN_RATE])

    assert spun(0.01) == pytest.approx(0.75 * spun(0.0))  # its weight is so much nearer
    assert spun(0.04) == pytest.approx(0.0, abs=1e-9)


def test_object_put_in_place_anew_begins_at_the_level_before_a_blow() -> None:
    contact, grip = held(Level.SLIDER, Level.BRUSH)
    contact.strike(blow(), 0.3)
    assert contact.level is Level.BRUSH
    contact.place()
    assert contact.level is Level.SLIDER
    again = lifted(contact, grip).state
    assert again == pytest.approx(lifted(held(Level.SLIDER)[0], grip).state)


def test_copy_of_a_contact_goes_its_own_way() -> None:
    contact, grip = held(Level.SPIN)
    other = copy.deepcopy(contact)
    other.strike(blow(), 0.3)
    other.advance(0.3, 0.1, 0.0, 0.0, 0.0, grip, grip)
    assert other.state[laws.TURN] != contact.state[laws.TURN] == pytest.approx(0.0, abs=1e-9)
    assert np.shares_memory(other.normal_n, other.state)


def test_pads_feel_a_rotation_each_in_its_own_frame() -> None:
    contact, _ = held(Level.SPIN)
    s = contact.state.copy()
    before = contact.felt(s, PadFrames.at(0.0))
    s[laws.TURN] += 0.1
    motion, turn, _ = (now - was for now, was in zip(contact.felt(s, PadFrames.at(0.0)), before,
                                                     strict=True))  # fmt: skip
    assert turn == pytest.approx([-0.1, 0.1, 0.1])  # the pads face each other
    half = 0.5 * PADS.finger_spacing_m
    assert motion[:, 0] == pytest.approx([0.0, -half * 0.1, half * 0.1])  # x is upwards
    assert motion[:, 1] == pytest.approx([0.0] * FINGERS)


def test_rotation_and_displacement_over_a_pad_agree_with_rigid_motion() -> None:
    # the same rotation seen as a velocity field: a point above B's middle moves with it
    contact, _ = held(Level.SPIN)
    s = contact.state.copy()
    s[laws.TURN], s[laws.SLIP], s[laws.ACROSS] = 0.02, 0.0, 0.0
    motion, turn, _ = contact.felt(s, PadFrames.at(0.0))
    places = [0.0, -0.5 * PADS.finger_spacing_m, 0.5 * PADS.finger_spacing_m]
    side = [1.0, -1.0, -1.0]
    for i in range(FINGERS):
        r = np.array([0.01, 0.005])  # in the pad's frame: up, and across as it sees it
        rotated = np.array([-turn[i] * r[1], turn[i] * r[0]]) + motion[i]
        up, across = r[0], places[i] + side[i] * r[1]
        expected = np.array([0.02 * across, -0.02 * up * side[i]])
        assert rotated == pytest.approx(expected, abs=1e-12)


def test_uneven_fingers_turn_an_object_that_is_pulled_out_of_them() -> None:
    def turned(b_n: float, c_n: float) -> float:
        what = body(mass_kg=0.35)
        contact, grip = Contact(PADS, what, Level.SPIN), np.array(squeeze(what, PADS, b_n, c_n))
        contact.place()
        contact.state[laws.HEIGHT] = 1.0
        contact.pull(PullSettings(force_n=20.0, ramp_s=0.01, lasts_s=0.03), 0.1)
        contact.advance(0.0, 0.3, 0.0, 0.0, 0.0, grip, grip)
        assert contact.state[laws.SLIP] > 1e-3
        return float(contact.state[laws.TURN])

    assert turned(6.0, 4.0) < -math.radians(0.2)  # the firmer finger B stays behind
    assert turned(4.0, 6.0) == pytest.approx(-turned(6.0, 4.0), rel=1e-6)


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
