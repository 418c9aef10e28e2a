"""Contact and grip force: the longest gap in the air, the filtered grip, force over the limit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp.control.contact_estimator import ContactEstimator, Stiffness
from tests.unit.grasp.builders import observation

TICK = 10_000_000
CONTACT_N = 0.3
NOTHING, GRIP = (0.0, 1.0, 0.0), (3.0, 1.0, 1.0)
WEAK = (0.1, 0.1, 0.1)


def after(
    *forces_n: tuple[float, float, float], airborne: bool = True, **changes: object
) -> ContactEstimator:
    """Contact estimate after these samples, in N for fingers A, B and C."""
    contact = ContactEstimator(CONTACT_N)
    for n, force_n in enumerate(forces_n):
        contact.update(observation(n * TICK, estimated_n=force_n, **changes), airborne)
    return contact


def test_contact_of_the_thumb_is_lost_after_its_time() -> None:
    assert not after(GRIP, *[NOTHING] * 4).thumb_lost
    assert after(GRIP, *[NOTHING] * 5).thumb_lost


def test_thumb_whose_fingertip_shows_nothing_is_not_lost_while_both_others_press_in_the_air() -> (
    None
):
    pressed = (0.0, CONTACT_N, CONTACT_N)
    assert not after(GRIP, *[pressed] * 9, airborne=True).thumb_lost
    assert after(GRIP, *[pressed] * 9, airborne=False).thumb_lost
    assert after(GRIP, *[(0.0, 5.0, 0.0)] * 9, airborne=True).thumb_lost


def test_contact_at_any_finger_means_the_object_is_not_lost() -> None:
    assert not after(GRIP, *[NOTHING] * 9).lost
    assert after(GRIP, *[WEAK] * 5).lost
    assert not after(GRIP, *[WEAK] * 4).lost


def test_contact_begins_at_the_least_force() -> None:
    assert not after(*[(0.0, 0.0, CONTACT_N)] * 9).lost
    assert not after(*[(CONTACT_N, 0.0, 0.0)] * 9).thumb_lost


def test_unresponsive_taxels_give_no_contact_without_others() -> None:
    assert after(GRIP, *[GRIP] * 5, responsive_n=(0.0, 0.1, 0.1)).thumb_lost
    assert not after(GRIP, *[GRIP] * 5, responsive_n=WEAK).thumb_lost


@pytest.mark.parametrize(("airborne", "gap_ns"), [(True, 3 * TICK), (False, 0)])
def test_longest_gap_is_measured_only_in_the_air(airborne: bool, gap_ns: int) -> None:
    forces = (GRIP, *[NOTHING] * 3, GRIP, NOTHING, GRIP)
    assert after(*forces, airborne=airborne).longest_gap_ns == gap_ns


def test_grip_force_follows_a_step_within_its_time_constant() -> None:
    """The thumb's force is half the sum of all fingers."""
    assert after(*[GRIP] * 4).grip_n == pytest.approx(1.05, abs=0.01)
    assert after(*[GRIP] * 40).grip_n == pytest.approx(2.5, abs=0.02)


def test_overload_starts_when_force_leaves_the_limit() -> None:
    contact = after(GRIP)
    for n in range(1, 5):
        contact.update(observation(n * TICK, estimated_n=GRIP, overloaded=True), airborne=True)
    assert contact.overload_ns == 4 * TICK


@given(rise_n=st.floats(-20, 60), per_count_n=st.floats(0.1, 8))
def test_counts_within_a_rise_are_maximal(rise_n: float, per_count_n: float) -> None:
    counts = Stiffness(per_count_n).counts_within(rise_n)
    assert counts * per_count_n <= max(0.0, rise_n) * (1 + 1e-12)
    assert (counts + 1) * per_count_n > rise_n
