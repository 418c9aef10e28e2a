"""The modelled hand: contact, motion and force."""

import math
from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.robotiq.model.gripper import FREE, FingerLoads, GripperModel, HandSettings
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


def test_one_finger_short_and_two_at_target_is_gsta_1() -> None:
    hand = Hand()
    hand.stiffness[0], hand.touch[0] = 5000.0, 0.03
    hand.write(command(100, 90, 90))
    status = hand.rest()
    assert (detections(status), status.stopped) == ([2, 3, 3], 1)


def test_contact_while_opening_is_reported_as_such() -> None:
    hand = Hand()
    hand.write(command(100))
    hand.rest()
    hand.outside[:] = 50.0
    hand.write(command(0))
    assert detections(hand.rest()) == [1, 1, 1]


def test_after_contact_while_opening_an_opening_at_equal_force_does_nothing() -> None:
    hand = Hand()
    hand.write(command(100))
    hand.rest()
    hand.outside[:] = 50.0
    hand.write(command(0))
    stood = hand.rest().a.position
    hand.outside[:] = 0.0
    hand.write(command(10))
    assert hand.rest().a.position == stood
    hand.write(command(10, force=20))
    assert hand.rest().a.position == 10


def test_the_grip_is_kept_when_the_motor_is_off() -> None:
    hand = Hand()
    hand.grip()
    force = hand.force_n()
    assert (force > 9.9).all()
    hand.run(2000)
    assert np.array_equal(hand.force_n(), force)


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


def test_after_contact_a_request_at_the_reported_count_does_not_loosen_the_grip() -> None:
    hand = Hand()
    status = hand.grip()
    force = hand.force_n()
    hand.write(command(*(axis.position for axis in status.fingers)))
    assert detections(hand.rest()) == [2, 2, 2]
    assert np.array_equal(hand.force_n(), force)


@pytest.mark.parametrize("position", [255, 200])
def test_more_force_pushes_on_from_contact(position: int) -> None:
    hand = Hand()
    hand.grip(force=0)
    before = hand.force_n()
    hand.write(command(position, force=80))
    hand.rest()
    assert (hand.force_n() > before + 10).all()


def test_the_opposite_direction_leaves_contact() -> None:
    hand = Hand()
    hand.grip()
    hand.write(command(0))
    status = hand.rest()
    assert (status.a.position, status.stopped) == (6, 3)


def test_rgto_cleared_and_set_pushes_again() -> None:
    hand = Hand()
    hand.grip()
    hand.touch += 0.0015  # the object gave way: the grip is lost
    assert (hand.force_n() < 6).all()
    hand.write(command(255, go_to=False))
    hand.rest()
    hand.write(command(255))
    assert hand.rest().stopped == 2
    assert (hand.force_n() > 9.9).all()


def test_a_grip_by_position_is_not_latched() -> None:
    hand = Hand()
    hand.put(2500.0, 0.0755)
    hand.write(command(100))
    status = hand.rest()
    assert detections(status) == [3, 3, 3]
    assert (hand.force_n() < 5).all()
    hand.write(command(255))
    assert hand.rest().stopped == 2
    assert (hand.force_n() > 9.9).all()


def test_contact_made_while_a_request_is_on_its_way_latches_that_request() -> None:
    hand = Hand(msgspec.structs.replace(QUICK, command_latency_s=0.15, debounce_s=0.02))
    hand.put(5000.0, 0.03)
    hand.write(command(200))
    for _ in range(600):
        hand.run(1)
        if (hand.force_n() > 9.5).all():
            break
    hand.write(command(230))
    assert detections(hand.run(12)) == [0, 0, 0]
    hand.rest()
    assert detections(hand.status()) == [2, 2, 2]
    assert (hand.peak_n < 12.5).all()


def test_a_thin_object_may_be_reported_as_at_target() -> None:
    hand = Hand(msgspec.structs.replace(QUICK, misses_contact=True))
    status = hand.grip()
    assert (detections(status), status.stopped) == ([3, 3, 3], 3)
    assert status.a.position < 60


# Motion and force

MAXIMUM_MPS = 0.022 + 0.000345 * 255


def test_fingers_do_not_pass_their_target() -> None:
    hand = Hand()
    most = 0.0
    hand.write(command(100))
    for _ in range(1500):
        hand.run(1)
        most = max(most, float(hand.model.travel_m.max()))
    assert most <= 100 * hand.model.settings.m_per_count + 1e-12
    assert hand.status().a.position == 100


def test_full_travel_takes_the_time_of_the_speed() -> None:
    hand = Hand()
    hand.write(command(240))
    hand.run(int(1e3 * 0.77e-3 * 234 / MAXIMUM_MPS))
    assert hand.model.moving
    hand.run(150)
    assert hand.status().stopped == 3


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


def test_a_hand_at_rest_may_be_skipped_over_in_one_step() -> None:
    hand = Hand()
    hand.run(30)
    assert not hand.model.moving
    hand.model.advance(3600 * 1000 * MS)
    hand.now_ns = 3600 * 1000 * MS
    hand.write(command(30))
    assert hand.model.moving
    assert hand.rest().a.position == 30


def test_moving_covers_a_request_that_still_waits_in_the_latency() -> None:
    hand = Hand(msgspec.structs.replace(QUICK, command_latency_s=0.15))
    hand.run(30)
    hand.write(command(7))
    hand.run(100)
    assert hand.model.moving


def test_a_load_stops_a_finger_but_never_drives_it_back() -> None:
    hand = Hand()
    hand.write(command(200))
    hand.run(300)
    least = hand.model.travel_m
    hand.stiffness[:] = 0
    for _ in range(100):
        hand.now_ns += MS
        hand.model.advance(hand.now_ns, FingerLoads(np.full(3, 500.0), np.zeros(3)))
        assert (hand.model.travel_m >= least).all()
        least = hand.model.travel_m


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


@pytest.mark.parametrize("stiffness", [600.0, 1100.0, 2500.0, 10000.0])
def test_overshoot_from_contact_grows_with_inertia_and_obeys_the_energy_bound(
    stiffness: float,
) -> None:
    peaks = [close_from_contact(mass, stiffness) for mass in MASSES]
    assert peaks == sorted(peaks)
    assert peaks[0] > 10.0
    assert peaks[-1] < 2 * 10.0 - 2.0, "work of the clamped motor bounds the peak"


def test_overshoot_after_a_free_run_is_speed_times_the_impedance() -> None:
    for mass in MASSES[:3]:
        peak = close_from_contact(mass, 10000.0, preload=-200.0)
        assert peak == pytest.approx(10 + MAXIMUM_MPS * math.sqrt(10000.0 * mass), abs=0.2)


def test_at_the_gap_speed_of_two_closing_sides_the_peaks_are_15_20_and_32_newtons() -> None:
    """220 mm/s from a 20 mm gap on 10 N/mm, for 0.05, 0.2 and 1 kg."""
    two_sides = {"least_speed_mps": 0.044, "speed_step_mps": 0.00069}
    peaks = [close_from_contact(m, 10000.0, -200.0, **two_sides) for m in (0.05, 0.2, 1.0)]
    assert peaks == pytest.approx([15, 20, 32], abs=1.0)


def test_slow_closing_overshoots_less() -> None:
    slow = {"speed_step_mps": 1e-5, "least_speed_mps": 0.022}
    assert close_from_contact(0.2, 10000.0, **slow) < close_from_contact(0.2, 10000.0)


def test_without_the_current_clamp_the_debounce_alone_decides_the_peak() -> None:
    peaks = [
        close_from_contact(0.1, 2500.0, current_clamp=False, debounce_s=debounce)
        for debounce in (0.001, 0.01, 0.02, 0.03)
    ]
    assert peaks == sorted(peaks)
    assert peaks[0] < 11 and peaks[2] > 14


def test_a_start_up_override_lets_the_whole_closing_run_at_the_override_force() -> None:
    soft = close_from_contact(0.1, 2500.0, override_s=0.0)
    overridden = close_from_contact(0.1, 10000.0, override_s=0.1, override_n=30.0)
    assert soft < 12 < 30 < overridden < 36


def test_force_bytes_map_to_the_true_force_of_the_hand() -> None:
    curved = HandSettings(force_exponent=2.0)
    assert (curved.force_n(0), curved.force_n(255)) == (10.0, 60.0)
    assert curved.force_n(128) < HandSettings().force_n(128)


@pytest.mark.parametrize(
    "bad",
    [
        {"tip_mass": 1.0},
        {"tip_mass_kg": 100.0},
        {"refresh_hz": 50},
        {"offset_counts": [9, 0, 0]},
        {"least_force_n": 20.0, "most_force_n": 15.0},
    ],
)
def test_settings_out_of_range_do_not_load(bad: dict[str, object]) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(bad, HandSettings)


def test_two_hundred_hertz_halves_the_wait_for_take_up() -> None:
    waits = []
    for hz in (100, 200):
        hand = Hand(msgspec.structs.replace(QUICK, refresh_hz=hz, tick_phase_s=0.0))
        hand.run(11)
        hand.write(command(90))
        waits.append(_wait(lambda hand=hand: hand.run(1).a.echo == 90))
    assert waits == [9, 4]


def _wait(done: Callable[[], bool]) -> int:
    return next(n for n in range(1, 100) if done())
