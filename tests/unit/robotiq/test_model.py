"""What the modelled hand does: the traps of the manual, and the physics of a motor that stops."""

import math
from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.robotiq.model import FREE, FingerLoads, GripperModel, HandSettings
from drivers.robotiq.protocol import AxisCommand, CommandRegisters, StatusRegisters

MS = 1_000_000
PERIOD = 10 * MS
QUICK = HandSettings(activation_s=0.1, mode_change_s=0.1)


def command(
    a: int = 0,
    b: int | None = None,
    c: int | None = None,
    *,
    speed: int = 255,
    force: int = 0,
    **bits: bool | int,
) -> CommandRegisters:
    """A request of an active hand; individual when B and C are given."""
    individual = b is not None and c is not None
    bits = {"activate": True, "go_to": True, "individual_fingers": individual, **bits}
    axes = [AxisCommand(position or 0, speed, force) for position in (a, b, c)]
    return CommandRegisters(a=axes[0], b=axes[1], c=axes[2], **bits)


class Hand:
    """A model with springs in front of its fingers, stepped at 1 kHz."""

    def __init__(self, hand: HandSettings = QUICK, *, active: bool = True) -> None:
        self.model = GripperModel(hand, 0, active=active)
        self.now_ns = 0
        self.stiffness = np.zeros(3)
        self.touch = np.zeros(3)
        self.outside = np.zeros(3)
        self.peak_n = np.zeros(3)

    def put(self, stiffness_npm: float, touch_m: float) -> None:
        self.stiffness[:], self.touch[:] = stiffness_npm, touch_m

    def write(self, registers: CommandRegisters) -> None:
        self.model.write(0, registers.to_registers(), self.now_ns)

    def force_n(self) -> np.ndarray:
        return np.maximum(0.0, self.stiffness * (self.model.travel_m - self.touch))

    def run(self, ms: int) -> StatusRegisters:
        for _ in range(ms):
            force = self.stiffness * (self.model.travel_m - self.touch)
            self.now_ns += MS
            self.model.advance(self.now_ns, FingerLoads(force, self.stiffness, self.outside))
            self.peak_n = np.maximum(self.peak_n, self.force_n())
        return self.status()

    def status(self) -> StatusRegisters:
        return StatusRegisters.from_registers(self.model.read(self.now_ns))

    def rest(self) -> StatusRegisters:
        for _ in range(1000):
            self.run(10)
            if not self.model.moving:
                return self.status()
        raise AssertionError("the hand did not come to rest")

    def grip(self, force: int = 0) -> StatusRegisters:
        """Close on rigid objects until all fingers have met them."""
        self.put(5000.0, 0.03)
        self.write(command(255, force=force))
        return self.rest()


def detections(status: StatusRegisters) -> list[int]:
    return [axis.detection for axis in status.fingers]


# Activation


def test_nothing_moves_before_activation_and_fault_07_says_so() -> None:
    hand = Hand(active=False)
    hand.write(CommandRegisters(go_to=True, a=AxisCommand(255, 255, 255)))
    status = hand.run(300)
    assert (status.active, status.fault, status.a.position) == (False, 0x07, 6)


def test_activation_takes_its_time_and_ends_ready_and_open() -> None:
    hand = Hand(HandSettings(), active=False)
    hand.write(CommandRegisters(activate=True))
    assert hand.run(20).to_bytes()[:2].hex() == "1100"
    assert hand.run(2500).a.position > 60, "activation closes the hand on the way"
    assert not hand.run(3400).ready
    assert hand.run(100).to_bytes()[:2].hex() == "3100"
    assert hand.status().a.position == 6


def test_a_motion_asked_during_activation_is_delayed_with_fault_05() -> None:
    hand = Hand(active=False)
    hand.write(command(60))
    status = hand.run(50)
    assert (status.fault, status.go_to) == (0x05, False)
    status = hand.rest()
    assert (status.fault, status.a.position, status.stopped) == (0, 60, 3)


def test_a_booting_hand_shows_fault_09_and_takes_up_nothing() -> None:
    hand = Hand(msgspec.structs.replace(QUICK, boot_s=0.5), active=False)
    hand.write(CommandRegisters(activate=True))
    status = hand.run(400)
    assert (status.fault, status.active) == (0x09, False)
    assert hand.run(400).ready


def test_clearing_ract_resets_and_setting_it_activates_anew() -> None:
    hand = Hand()
    hand.write(command(100))
    hand.run(300)
    hand.write(CommandRegisters())
    status = hand.run(20)
    assert (status.active, status.initialization, detections(status)) == (False, 0, [0, 0, 0])
    where = hand.model.travel_m
    assert np.array_equal(hand.run(100) and hand.model.travel_m, where)


# Registers and refresh


def test_requests_are_taken_up_and_status_is_sampled_on_refresh_ticks_only() -> None:
    hand = Hand(msgspec.structs.replace(QUICK, tick_phase_s=0.005))
    hand.run(6)
    hand.write(command(100))
    assert hand.run(8).a.echo == 0, "tick at 15 ms has not come"
    assert hand.run(1).a.echo == 100
    held = hand.run(60).to_bytes()
    assert hand.run(9).to_bytes() == held, "held between ticks"
    assert hand.run(1).to_bytes() != held


def test_before_the_echo_the_status_still_tells_of_the_motion_before() -> None:
    hand = Hand()
    hand.write(command(50))
    hand.rest()
    hand.write(command(200))
    stale = hand.run(1)
    assert (stale.a.echo, stale.a.detection, stale.stopped) == (50, 3, 3)
    assert detections(hand.run(10)) == [0, 0, 0]


def test_between_take_up_and_motion_the_status_says_moving_while_nothing_moves() -> None:
    hand = Hand(msgspec.structs.replace(QUICK, command_latency_s=0.05))
    hand.write(command(200))
    status = hand.run(54)
    assert (status.a.echo, status.stopped, status.a.detection) == (200, 0, 0)
    assert not hand.model.velocity_mps.any()
    assert hand.run(3) and hand.model.velocity_mps.all()


def test_a_short_write_leaves_the_other_bytes_in_force() -> None:
    hand = Hand()
    hand.write(command(80, 70, 60, force=9))
    hand.rest()
    hand.model.write(1, (90,), hand.now_ns)
    status = hand.rest()
    assert [axis.position for axis in status.fingers] == [90, 70, 60]


@pytest.mark.parametrize("first, count", [(8, 1), (0, 9), (-1, 2), (0, 0)])
def test_registers_that_do_not_exist_are_a_value_error(first: int, count: int) -> None:
    with pytest.raises(ValueError, match="do not exist"):
        Hand().model.write(first, (0,) * count, 0)


def test_in_simple_mode_only_finger_a_echoes_and_the_scissor_rests_at_137() -> None:
    hand = Hand()
    hand.write(command(120))
    status = hand.rest()
    assert [axis.echo for axis in status.axes] == [120, 0, 0, 0]
    assert [axis.position for axis in status.fingers] == [120] * 3
    assert (status.scissor.position, status.scissor.detection) == (137, 3)


def test_switching_to_individual_fingers_with_stale_targets_makes_them_jump() -> None:
    hand = Hand()
    hand.write(command(150))
    hand.rest()
    hand.write(command(150, 0, 0))
    status = hand.rest()
    assert [axis.position for axis in status.fingers] == [150, 6, 6]
    assert [axis.echo for axis in status.fingers] == [150, 0, 0]


def test_the_open_frame_of_the_manual_comes_out_whole() -> None:
    hand = Hand(msgspec.structs.replace(QUICK, offset_counts=(1, 0, 0)))
    hand.write(command(60))
    hand.rest()
    hand.write(command(0))
    assert hand.rest().to_bytes().hex() == "f9ff00000700000600000600" + "00890000"


def test_software_limits_replace_the_request_and_still_report_at_target() -> None:
    hand = Hand()
    hand.write(command(255))
    status = hand.rest()
    assert (status.a.echo, status.a.position, status.stopped) == (255, 240, 3)


def test_the_closing_frame_shows_running_currents_that_fall_to_zero_at_rest() -> None:
    hand = Hand()
    hand.write(command(255))
    status = hand.run(200)
    assert status.to_bytes()[:4].hex() == "39c000ff"
    assert all(11 <= axis.current <= 16 for axis in status.fingers)
    assert [axis.current for axis in hand.rest().fingers] == [0, 0, 0]


def test_speed_and_force_zero_are_the_minimum_not_nothing() -> None:
    hand = Hand()
    hand.write(command(100, speed=0, force=0))
    hand.run(500)
    assert hand.model.velocity_mps == pytest.approx([0.022] * 3, rel=1e-3)
    assert hand.rest().a.position == 100


def test_a_new_speed_acts_at_once_but_starts_nothing() -> None:
    hand = Hand()
    hand.write(command(200, speed=0))
    hand.run(300)
    hand.write(command(200, speed=255))
    hand.run(250)
    assert hand.model.velocity_mps[0] == pytest.approx(0.11, rel=0.02)
    hand.rest()
    hand.write(command(200, speed=0))
    assert detections(hand.run(100)) == [3, 3, 3]


def test_nothing_moves_without_rgto_and_clearing_it_stops() -> None:
    hand = Hand()
    hand.write(command(200, go_to=False))
    assert hand.rest().a.position == 6
    hand.write(command(200))
    hand.run(300)
    hand.write(command(200, go_to=False))
    status = hand.rest()
    assert not status.go_to
    assert 6 < status.a.position < 200


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


# Modes, faults, release


def test_a_mode_change_opens_first_and_delays_motion_with_fault_06() -> None:
    hand = Hand(HandSettings())
    hand.write(command(120))
    hand.rest()
    hand.write(command(120, mode=1))
    status = hand.run(1500)
    assert (status.initialization, status.fault, status.go_to) == (2, 0x06, False)
    assert status.a.position == 6
    status = hand.rest()
    assert (status.initialization, status.mode, status.a.position) == (3, 1, 120)
    assert status.scissor.position == 200


def test_the_individual_scissor_follows_its_own_bytes() -> None:
    hand = Hand()
    hand.write(command(6, individual_scissor=True))
    hand.rest()
    spread = msgspec.structs.replace(
        command(6, individual_scissor=True), scissor=AxisCommand(37, 255, 0)
    )
    hand.write(spread)
    assert hand.run(100).scissor.detection == 0
    status = hand.rest()
    assert (status.scissor.echo, status.scissor.position, status.scissor.detection) == (37, 37, 3)


def test_in_scissor_mode_the_one_position_drives_the_scissor_and_the_fingers_stay() -> None:
    hand = Hand()
    hand.write(command(137, mode=3))
    hand.rest()
    hand.write(command(200, mode=3))
    status = hand.rest()
    assert (status.scissor.position, status.a.position) == (200, 6)


def test_auto_release_opens_slowly_to_the_stops_and_ends_in_fault_0f() -> None:
    hand = Hand()
    hand.write(command(100))
    hand.rest()
    hand.write(command(100, auto_release=True))
    status = hand.run(500)
    assert (status.fault, status.go_to, status.initialization) == (0x0B, False, 0)
    assert hand.model.velocity_mps == pytest.approx([-0.022] * 3, rel=1e-3)
    status = hand.rest()
    assert (status.fault, status.a.position) == (0x0F, 0)
    hand.write(command(100))
    assert hand.run(300).fault == 0x0F
    hand.write(CommandRegisters())
    assert hand.run(20).fault == 0


@pytest.mark.parametrize("code, imc", [(0x0D, 1), (0x0E, 2), (0x0F, 0)])
def test_a_major_fault_stops_the_hand_until_ract_is_cleared(code: int, imc: int) -> None:
    hand = Hand()
    hand.write(command(255))
    hand.run(300)
    hand.model.inject_fault(code)
    status = hand.run(20)
    assert (status.fault, status.initialization, status.go_to) == (code, imc, False)
    assert not hand.model.velocity_mps.any()
    hand.write(command(0))
    hand.model.inject_fault(0)
    assert hand.run(100).fault == code
    hand.write(CommandRegisters())
    assert hand.run(20).fault == 0


def test_a_minor_fault_is_shown_and_taken_back() -> None:
    hand = Hand()
    hand.model.inject_fault(0x0A)
    assert hand.run(20).fault == 0x0A
    hand.model.inject_fault(0)
    assert hand.run(20).fault == 0


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
