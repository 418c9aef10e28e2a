"""What the thumb has felt: contact, its longest gap in the air, its level, force over the limit."""

import pytest

from grasp.controller_settings import ControllerSettings
from grasp.felt import Felt
from tests.unit.grasp.builders import seen

TICK = 10_000_000
NOTHING, GRIP = (0.0, 1.0, 1.0), (3.0, 1.0, 1.0)


def felt(*forces_n: tuple[float, float, float], airborne: bool = True, **told: object) -> Felt:
    """One sample each."""
    tracker = Felt(ControllerSettings())
    for n, force_n in enumerate(forces_n):
        tracker.take(seen(n * TICK, measured_n=force_n, **told), airborne)
    return tracker


def test_contact_is_the_thumbs_alone_and_lost_after_its_time() -> None:
    tracker = felt(GRIP, *[NOTHING] * 5)
    assert not tracker.contact_lost(5 * TICK - 1)
    assert tracker.contact_lost(5 * TICK)


def test_a_hand_that_feels_something_at_any_finger_has_not_lost_what_it_holds() -> None:
    assert not felt(GRIP, *[NOTHING] * 9).nothing_felt(9 * TICK)
    assert felt(GRIP, *[(0.1, 0.1, 0.1)] * 5).nothing_felt(5 * TICK)
    assert not felt(GRIP, *[(0.1, 0.1, 0.1)] * 5).nothing_felt(5 * TICK - 1)


def test_what_is_felt_counts_from_the_force_of_a_contact_on() -> None:
    least_n = ControllerSettings().contact_n
    assert not felt(*[(0.0, 0.0, least_n)] * 9).nothing_felt(9 * TICK)
    assert not felt(*[(least_n, 0.0, 0.0)] * 9).contact_lost(9 * TICK)


def test_force_of_taxels_that_cannot_tell_is_no_contact_unless_others_feel_something() -> None:
    assert felt(GRIP, *[GRIP] * 5, felt_n=(0.0, 0.1, 0.1)).contact_lost(5 * TICK)
    assert not felt(GRIP, *[GRIP] * 5, felt_n=(0.1, 0.1, 0.1)).contact_lost(5 * TICK)


@pytest.mark.parametrize(("airborne", "gap_ns"), [(True, 3 * TICK), (False, 0)])
def test_longest_gap_counts_in_the_air_alone(airborne: bool, gap_ns: int) -> None:
    forces = (GRIP, *[NOTHING] * 3, GRIP, NOTHING, GRIP)
    assert felt(*forces, airborne=airborne).gap_ns == gap_ns


def test_level_of_the_grip_follows_a_step_within_the_time_in_which_pads_relax() -> None:
    """The thumb bears what all fingers measure, half of it."""
    assert felt(*[GRIP] * 4).level_n == pytest.approx(1.05, abs=0.01)
    assert felt(*[GRIP] * 40).level_n == pytest.approx(2.5, abs=0.02)


def test_overload_lasts_since_force_was_last_within_the_limit() -> None:
    tracker = felt(GRIP)
    tracker.take(seen(TICK, measured_n=GRIP, overloaded=True), airborne=True)
    assert tracker.overload_ns(4 * TICK) == 4 * TICK
