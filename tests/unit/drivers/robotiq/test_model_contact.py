"""Model of the hand: contact, motion and force."""

import msgspec
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.robotiq.model.gripper import FREE, GripperModel
from tests.unit.drivers.robotiq.hand import MS, QUICK, Hand, command, detections

# Contact


def test_contact_stops_each_finger_by_itself_at_its_own_count() -> None:
    hand = Hand()
    hand.stiffness[:], hand.touch[:] = 5000.0, (0.14, 0.13, 0.12)
    hand.write(command(255))
    partly = hand.run(1250)
    assert 0 in detections(partly) and 2 in detections(partly)
    assert partly.stopped == 0, "gSTA is 0 while any finger moves"
    status = hand.rest()
    assert detections(status) == [2, 2, 2]
    assert status.stopped == 2
    assert status.a.position > status.b.position > status.c.position
    assert [axis.current for axis in status.fingers] == [0, 0, 0]


def test_after_contact_a_close_at_equal_or_lower_force_does_nothing() -> None:
    hand = Hand()
    hand.grip(force=20)
    where = hand.model.travel_m
    for position, force in ((254, 20), (200, 0), (255, 20), (240, 19)):
        hand.write(command(position, force=force))
        status = hand.rest()
        assert detections(status) == [2, 2, 2], (position, force)
        assert status.a.echo == position, "it is received all the same"
        assert np.array_equal(hand.model.travel_m, where)


def test_a_higher_force_closes_further_from_contact() -> None:
    for position in [255, 200]:
        hand = Hand()
        hand.grip(force=0)
        before = hand.force_n()
        hand.write(command(position, force=80))
        hand.rest()
        assert (hand.force_n() > before + 10).all(), position


# Motion and force


@settings(deadline=None, max_examples=25)
@given(st.lists(st.integers(1, 40), min_size=1, max_size=40), st.integers(0, 255))
def test_advancing_in_any_pieces_gives_the_same_hand(pieces: list[int], target: int) -> None:
    whole, parts = (GripperModel(QUICK, 0, active=True) for _ in range(2))
    for model in (whole, parts):
        model.write(0, command(target).to_registers(), 0)
    now_ns = 0
    for piece in pieces:
        now_ns += piece * MS + 12_345
        parts.advance(now_ns, FREE)
    whole.advance(now_ns, FREE)
    assert np.array_equal(whole.travel_m, parts.travel_m)
    assert np.array_equal(whole.velocity_mps, parts.velocity_mps)
    assert whole.read(now_ns) == parts.read(now_ns)


def close_from_contact(
    mass: float, stiffness: float, preload: float = 2.0, **changes: float | bool
) -> float:
    """Peak force of a finger that starts pressed on an object with ``preload`` newtons."""
    base = msgspec.structs.replace(QUICK, tip_mass_kg=mass, **changes)
    hand = Hand(base)
    hand.stiffness[0] = stiffness
    hand.touch[0] = hand.model.travel_m[0] - preload / stiffness
    hand.write(command(255, 6, 6))
    hand.rest()
    return float(hand.peak_n[0])


MASSES = (0.05, 0.1, 0.2, 1.0)


def test_overshoot_from_contact_grows_with_inertia_and_obeys_the_energy_bound() -> None:
    for stiffness in [600.0, 1100.0, 2500.0, 10000.0]:
        peaks = [close_from_contact(mass, stiffness) for mass in MASSES]
        assert peaks == sorted(peaks), stiffness
        assert peaks[0] > 10.0, stiffness
        assert peaks[-1] < 2 * 10.0 - 2.0, "work of the clamped motor bounds the peak"
