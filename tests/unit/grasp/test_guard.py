"""The force guard: admitted commands, sampled densely around the limit."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ConfigError
from drivers.interfaces import Counts3, Vector3
from grasp.control.commands import CloseToLimit, HoldFingers, MoveFingers, OpenFingers
from grasp.control.contact_estimator import Stiffness
from grasp.control.grip_measure import READ_NS
from grasp.control.guard import RISEN_M, TOUCHED_N, ForceGuard, GuardSettings, limit_in_words
from tests.unit.grasp.builders import arm, gripper, observation

M_PER_COUNT = 0.00077
RIGID = Stiffness(2500.0 * M_PER_COUNT)
NO_FORCE = (0.0, 0.0, 0.0)
FIRST_N = (2.0, 1.0, 1.0)  # of a first grasp
ALL = (True, True, True)
AROUND_THE_LIMIT = [9.0, 9.9, math.nextafter(10, 0), 10.0, math.nextafter(10, 11), 10.1, 11, 60.0]


def guard(travel_bound: bool = False, **changes: object) -> ForceGuard:
    settings = msgspec.structs.replace(GuardSettings(), **changes)
    stiffness = Stiffness(settings.contact_stiffness_npm * M_PER_COUNT)
    return ForceGuard(settings, 10.0, stiffness, travel_bound=travel_bound)


def close(force_n: float = 10.0, speed: float = 0.11, limit: int = 255) -> CloseToLimit:
    return CloseToLimit(force_n, ALL, (limit, limit, limit), speed)


@pytest.mark.parametrize("requested_n", AROUND_THE_LIMIT)
def test_no_force_above_the_limit_is_admitted(requested_n: float) -> None:
    admitted = guard().admit(close(requested_n), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseToLimit)
    assert admitted.force_limit_n == min(requested_n, 10.0)
    moved = guard().admit(MoveFingers((60, 60, 60), 0.05, requested_n), gripper(), NO_FORCE)
    assert isinstance(moved, MoveFingers)
    assert moved.force_n == min(requested_n, 10.0)


@pytest.mark.parametrize("mode", ["every_finger", "each_motor"])
def test_after_the_first_grasp_b_and_c_close_only_where_each_motor_has_the_limit(mode: str) -> None:
    guarded, beyond = guard(limit_mode=mode), MoveFingers((56, 57, 58), 0.02, 10.0)
    hand = gripper(positions=(55, 55, 55))
    assert guarded.admit(beyond, hand, NO_FORCE) == beyond
    guarded.set_first_grasp((55, 55, 55), FIRST_N)
    admitted = guarded.admit(beyond, hand, FIRST_N)
    assert isinstance(admitted, MoveFingers)
    held = mode == "every_finger"
    assert admitted.targets_counts == ((56, 55, 55) if held else (56, 57, 58))


def test_first_stage_of_a_closing_stays_one() -> None:
    for more in (False, True):
        requested = msgspec.structs.replace(close(), first_stage=more)
        admitted = guard().admit(requested, gripper(), NO_FORCE)
        assert isinstance(admitted, CloseToLimit)
        assert admitted.first_stage is more


def test_calibration_that_cannot_keep_the_limit_is_refused_with_the_remedy() -> None:
    with pytest.raises(ConfigError) as caught:
        ForceGuard(GuardSettings(), least_force_n=15.0, stiffness=RIGID)
    assert "15 N" in caught.value.message
    assert "calibration" in caught.value.remedy
    assert "controller.grip_force_n >= 15" in caught.value.remedy


def test_least_force_equal_to_the_limit_is_accepted() -> None:
    ForceGuard(GuardSettings(), least_force_n=10.0, stiffness=RIGID)


def test_thumb_closes_alone_when_every_finger_must_keep_the_limit() -> None:
    admitted = guard().admit(close(), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseToLimit)
    assert admitted.closing == (True, False, False)


def test_all_fingers_close_when_each_motor_keeps_the_limit_for_itself() -> None:
    admitted = guard(limit_mode="each_motor").admit(close(), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseToLimit)
    assert admitted.closing == ALL


def test_closing_speed_keeps_the_energy_within_the_stated_overshoot() -> None:
    g = guard(overshoot_n=1.0, contact_stiffness_npm=2500.0, tip_mass_kg=0.1)
    assert g.closing_speed_mps * math.sqrt(2500.0 * 0.1) == pytest.approx(1.0)
    admitted = g.admit(close(speed=0.11), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseToLimit)
    assert admitted.speed_mps == g.closing_speed_mps
    assert g.admit(close(speed=0.03), gripper(), NO_FORCE) == CloseToLimit(
        10.0, (True, False, False), (255, 255, 255), 0.03
    )


def test_measured_force_beyond_its_margin_stops_further_closing_but_never_opens() -> None:
    over = (15.1, 15.1, 0.0)
    assert guard().admit(close(), gripper(), over) == HoldFingers()
    assert guard().admit(MoveFingers((56, 55, 55), 0.05, 10.0), gripper(), over) == HoldFingers()
    at = (15.0, 15.0, 0.0)
    assert isinstance(guard().admit(close(), gripper(), at), CloseToLimit)


def test_measured_force_does_not_stop_opening() -> None:
    over = (40.0, 20.0, 20.0)
    opening = MoveFingers((50, 55, 55), 0.05, 10.0)
    assert guard().admit(opening, gripper(), over) == opening
    assert guard().admit(OpenFingers(0.1), gripper(), over) == OpenFingers(0.1)


def test_with_travel_bound_nothing_closes_before_a_first_grasp_is_known() -> None:
    assert guard(travel_bound=True).admit(close(), gripper(), NO_FORCE) == HoldFingers()


@given(
    first_n=st.floats(0, 12),
    stiffness=st.floats(600, 10_000),
    target=st.integers(0, 255),
    position=st.integers(0, 200),
)
def test_no_target_is_beyond_the_position_of_the_force_limit(
    first_n: float, stiffness: float, target: int, position: int
) -> None:
    g = guard(travel_bound=True, contact_stiffness_npm=stiffness)
    g.set_first_grasp((position, position, position), (first_n, first_n, first_n))
    admitted = g.admit(close(limit=target), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseToLimit)
    for limit in admitted.ends_counts:
        travel_m = max(0, limit - position) * 0.00077
        assert first_n + stiffness * travel_m <= max(10.0, first_n) + 1e-9
        assert limit <= target


def test_move_is_bounded_by_position_as_a_closing_is() -> None:
    g = guard(travel_bound=True)
    g.set_first_grasp((55, 55, 55), (2.0, 1.0, 1.0))
    closing = g.admit(close(), gripper(), NO_FORCE)
    moving = g.admit(MoveFingers((255, 255, 255), 0.05, 10.0), gripper(), NO_FORCE)
    assert isinstance(closing, CloseToLimit) and isinstance(moving, MoveFingers)
    assert moving.targets_counts == (closing.ends_counts[0], 55, 55) < (70, 55, 55)


def test_finger_with_a_grasp_above_the_limit_does_not_close() -> None:
    g = guard(travel_bound=True)
    g.set_first_grasp((55, 55, 55), (12.0, 6.0, 6.0))
    admitted = g.admit(close(), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseToLimit)
    assert admitted.ends_counts[0] == 55


@pytest.mark.parametrize(
    ("mode", "estimated_n", "stops"),
    [
        ("every_finger", (15.0, 15.0, 15.0), False),
        ("every_finger", (15.1, 15.1, 0.0), True),
        ("every_finger", (15.1, 7.6, 7.6), True),  # the thumb bears the sum of B and C
        ("each_motor", (25.0, 15.0, 10.0), False),
        ("each_motor", (25.1, 12.6, 12.6), True),
        ("each_motor", (15.1, 15.1, 0.0), True),
        ("each_motor", (15.1, 0.0, 15.1), True),
    ],
)
def test_every_finger_has_its_own_limit_of_measured_force(
    mode: str, estimated_n: Vector3, stops: bool
) -> None:
    admitted = guard(limit_mode=mode).admit(close(), gripper(), estimated_n)
    assert isinstance(admitted, HoldFingers) is stops


@pytest.mark.parametrize("mode", ["every_finger", "each_motor"])
@pytest.mark.parametrize("estimated_n", [(60.0, 2.0, 2.0), (4.0, 60.0, 2.0), (4.0, 2.0, 60.0)])
def test_single_fingertip_that_sticks_at_a_high_reading_does_not_prevent_closing(
    mode: str, estimated_n: Vector3
) -> None:
    assert isinstance(guard(limit_mode=mode).admit(close(), gripper(), estimated_n), CloseToLimit)


def test_least_speed_at_the_allowed_overshoot_is_accepted() -> None:
    fastest_mps = guard().closing_speed_mps
    ForceGuard(GuardSettings(), 10.0, RIGID, fastest_mps)
    with pytest.raises(ConfigError, match="overshoot_n"):
        ForceGuard(GuardSettings(), 10.0, RIGID, math.nextafter(fastest_mps, 1.0))


def speed(g: ForceGuard, targets: Counts3, requested_mps: float = 0.11) -> float:
    moved = g.admit(MoveFingers(targets, requested_mps, 10.0), gripper(), FIRST_N)
    closed = g.admit(CloseToLimit(10.0, ALL, targets, requested_mps), gripper(), FIRST_N)
    assert isinstance(moved, MoveFingers) and isinstance(closed, CloseToLimit)
    assert moved.speed_mps == closed.speed_mps
    return moved.speed_mps


def after_first_grasp(travel_bound: bool = False, **changes: object) -> ForceGuard:
    g = guard(travel_bound, **changes)
    g.set_first_grasp((55, 55, 55), FIRST_N)
    return g


def test_speed_is_limited_equally_for_moves_and_closings() -> None:
    g = after_first_grasp()
    reach = g.safe_travel(gripper(), FIRST_N)
    assert reach is not None and reach[0] == 58
    slow = g.closing_speed_mps
    assert [speed(g, (a, 55, 55)) for a in (20, 55, 58, 59, 255)] == [0.11, 0.11, 0.11, slow, slow]
    assert speed(g, (255, 55, 55), 0.03) == 0.03


def test_fingers_that_do_not_close_do_not_limit_the_speed() -> None:
    g = after_first_grasp()
    admitted = g.admit(CloseToLimit(10.0, ALL, (58, 255, 255), 0.11), gripper(), FIRST_N)
    assert isinstance(admitted, CloseToLimit)
    assert admitted.speed_mps == 0.11
    moved = g.admit(MoveFingers((58, 255, 55), 0.11, 10.0), gripper(), FIRST_N)
    assert isinstance(moved, MoveFingers)
    assert moved.speed_mps == 0.11


def test_before_the_first_grasp_only_free_motion_is_fast() -> None:
    g = ForceGuard(GuardSettings(), 10.0, RIGID, free_counts=(25, 40, 40))
    assert g.safe_travel(gripper(), FIRST_N) is None
    slow = g.closing_speed_mps
    assert [speed(g, (a, 40, 40)) for a in (25, 26)] == [0.11, slow]


def test_each_motor_mode_has_no_safe_travel() -> None:
    assert after_first_grasp(limit_mode="each_motor").safe_travel(gripper(), FIRST_N) is None


@given(
    first_n=st.floats(0, 12), stiffness=st.floats(600, 10_000), stiffer=st.floats(1.0, 1.3),
    stronger_n=st.floats(0.0, 1.0), overshoot_n=st.floats(0.8, 2.0),
)  # fmt: skip
def test_safe_travel_keeps_the_limit_and_with_margins_the_overshoot(
    first_n: float, stiffness: float, stiffer: float, stronger_n: float, overshoot_n: float
) -> None:
    g = guard(contact_stiffness_npm=stiffness, overshoot_n=overshoot_n)
    estimated_n = (first_n, first_n / 2, first_n / 2)
    g.set_first_grasp((55, 55, 55), estimated_n)
    reach = g.safe_travel(gripper(), estimated_n)
    assert reach is not None
    rise_n = (reach[0] - 55) * M_PER_COUNT * stiffness
    assert rise_n == 0 or first_n + rise_n <= 10.0 + 1e-9
    assert rise_n == 0 or first_n + stronger_n + stiffer * rise_n <= 10.0 + overshoot_n + 1e-9


def test_safe_travel_is_useful_on_the_can() -> None:
    assert after_first_grasp().safe_travel(gripper(), FIRST_N) == (58, 58, 58)
    soft = ForceGuard(GuardSettings(), 10.0, Stiffness(0.55))
    soft.set_first_grasp((53, 54, 54), FIRST_N)
    assert soft.safe_travel(gripper(), FIRST_N) == (64, 66, 66)


def test_unexplained_rise_of_force_reduces_the_safe_travel() -> None:
    g = after_first_grasp()
    assert g.safe_travel(gripper(), (2.9, 1.0, 1.0)) == (58, 58, 58)  # within the margin
    assert g.safe_travel(gripper(), (5.9, 2.5, 2.5)) == (57, 58, 58)
    assert g.safe_travel(gripper(), (15.0, 1.0, 1.0)) == (58, 58, 58)  # by one side alone
    closed = gripper(positions=(57, 55, 55))
    assert g.safe_travel(closed, (5.9, 2.5, 2.5)) == (58, 58, 58)  # by closing, as expected


def test_thumb_limit_is_known_only_with_travel_bound() -> None:
    assert guard(travel_bound=True).thumb_end_counts is None  # no first grasp is known yet
    assert after_first_grasp(travel_bound=True).thumb_end_counts == 59
    assert after_first_grasp().thumb_end_counts is None


def test_repeated_commands_do_not_ratchet_past_the_bound() -> None:
    g = guard(travel_bound=True)
    g.set_first_grasp((55, 55, 55), (2.0, 1.0, 1.0))
    limits = [g.admit(close(), gripper(positions=(55 + k, 55, 55)), NO_FORCE) for k in range(5)]
    assert len({c.ends_counts for c in limits if isinstance(c, CloseToLimit)}) == 1


def test_force_is_estimated_from_the_sum_of_counts_and_never_negative() -> None:
    g = guard(counts_per_newton=160.0)
    assert g.estimated_n((-320.0, -160.0, -16.0)) == (2.0, 1.0, 0.1)
    assert g.estimated_n((16.0, 160.0, 320.0)) == (0.0, 0.0, 0.0)
    each = guard(counts_per_newton=(100.0, 160.0, 200.0))
    assert each.estimated_n((-320.0, -320.0, -320.0)) == (3.2, 2.0, 1.6)


def test_guard_defaults_match_the_published_results() -> None:
    assert msgspec.structs.asdict(GuardSettings()) == {
        "force_limit_n": 10.0, "limit_mode": "every_finger", "overshoot_n": 1.0,
        "contact_stiffness_npm": 2500.0,
        "tip_mass_kg": 0.1, "counts_per_newton": 160.0,
        "estimate_margin_n": 5.0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("mode", "grip_n"), [("every_finger", (10.0, 5.0, 5.0)), ("each_motor", (20.0, 10.0, 10.0))]
)
def test_thumb_of_a_full_grip_carries_the_sum_of_both_others(mode: str, grip_n: object) -> None:
    assert msgspec.structs.replace(GuardSettings(), limit_mode=mode).full_grip_n == grip_n


def test_travel_bound_takes_no_reading_of_the_first_grasp_by_one_side_alone() -> None:
    g = guard(travel_bound=True)
    g.set_first_grasp((55, 55, 55), (15.0, 1.0, 1.0))
    assert g.thumb_end_counts == 58  # as from 3 N
    g.set_first_grasp((55, 55, 55), (2.0, 15.0, 1.0))
    assert g.thumb_end_counts == 59


@pytest.mark.parametrize("targets", [(1, 0, 0), (0, 1, 0), (0, 0, 1)])
def test_without_free_counts_no_finger_closes_fast(targets: Counts3) -> None:
    g = guard()
    moved = g.admit(MoveFingers(targets, 0.11, 10.0), gripper(), NO_FORCE)
    assert isinstance(moved, MoveFingers) and moved.speed_mps == g.closing_speed_mps
    assert speed(g, (0, 0, 0)) == 0.11
    thumb = g.admit(CloseToLimit(10.0, ALL, (0, 255, 255), 0.11), gripper(), NO_FORCE)
    assert isinstance(thumb, CloseToLimit) and thumb.speed_mps == 0.11


def test_impossible_overshoot_is_refused_with_the_least_possible_one() -> None:
    settings = GuardSettings(contact_stiffness_npm=2500.0, tip_mass_kg=0.1)
    with pytest.raises(ConfigError, match="overshoot_n") as caught:
        ForceGuard(settings, 10.0, RIGID, least_speed_mps=0.1)
    assert caught.value.remedy == f"allowed: guard.overshoot_n >= {0.1 * math.sqrt(250.0):.2f}"


def test_safe_travel_with_an_unexplained_force_ends_at_the_limit() -> None:
    assert after_first_grasp().safe_travel(gripper(), (7.0, 3.0, 3.0)) == (56, 58, 58)
    generous = after_first_grasp(overshoot_n=5.0)  # what the limit alone allows decides
    assert generous.safe_travel(gripper(), (5.9, 2.5, 2.5)) == (57, 58, 58)


def test_thumb_limit_depends_only_on_the_thumb() -> None:
    g = guard(travel_bound=True)
    g.set_first_grasp((50, 60, 70), FIRST_N)
    assert g.thumb_end_counts == 54


def test_each_motor_limit_is_described_with_the_double_force_of_the_thumb() -> None:
    assert "20 N" in limit_in_words(10.0, "each_motor")
    assert "20 N" not in limit_in_words(10.0, "every_finger")


def test_before_a_grasp_by_touch_a_finger_that_moves_and_touches_stops_one_count_further() -> None:
    by_touch = ForceGuard(GuardSettings(), 10.0, RIGID, touch=True)
    free, felt, target = NO_FORCE, (0.4, 0.0, 0.0), MoveFingers((80, 60, 60), 0.022, 10.0)
    for estimated_n, requested, thumb in ((free, 80, 80), (felt, 80, 56), (felt, 55, 55)):
        state = gripper(requested=(requested, 55, 55))
        admitted = by_touch.admit(target, state, estimated_n)
        assert isinstance(admitted, MoveFingers) and admitted.targets_counts == (thumb, 60, 60)


def read(by_touch: ForceGuard, t_ns: int, sides_n: float, height_m: float = 0.0) -> None:
    """Let the hand rest with that force on both sides until it is read."""
    estimated_n = sides_n, sides_n / 2, sides_n / 2
    for at_ns in (t_ns, t_ns + READ_NS):
        obs = observation(at_ns, arm=arm(at_ns, height_m))
        by_touch.observe(obs, estimated_n, responsive=True)


def test_in_a_grasp_by_touch_a_count_is_closed_only_while_the_limit_has_room_for_it() -> None:
    by_touch = ForceGuard(GuardSettings(), 10.0, RIGID, touch=True)
    room_n = 10.0 - RIGID.newtons_per_count
    closing, felt = close(), (TOUCHED_N, TOUCHED_N, TOUCHED_N)
    for t_ns, force_n, end in ((0, room_n, 56), (10**9, math.nextafter(room_n, 11), 55)):
        by_touch.observe(observation(t_ns - 1, gripper=gripper(positions=(54, 55, 55))), felt, True)
        read(by_touch, t_ns, force_n)
        admitted = by_touch.admit(closing, gripper(), felt)
        assert isinstance(admitted, CloseToLimit) and admitted.ends_counts == (end, end, end)


def test_after_a_grasp_by_touch_b_and_c_close_by_single_counts_where_they_may() -> None:
    each = GuardSettings(limit_mode="each_motor")
    by_touch = ForceGuard(each, 10.0, RIGID, touch=True)
    read(by_touch, 0, 6.0)
    by_touch.set_first_grasp((55, 55, 55), (6.0, 3.0, 3.0))
    admitted = by_touch.admit(MoveFingers((80, 80, 80), 0.022, 10.0), gripper(), NO_FORCE)
    assert isinstance(admitted, MoveFingers) and admitted.targets_counts == (56, 56, 56)


def test_an_object_counts_as_off_the_table_once_the_arm_has_risen_by_20_mm() -> None:
    by_touch = ForceGuard(GuardSettings(), 10.0, RIGID, touch=True)
    read(by_touch, 0, 4.0, height_m=0.1)
    by_touch.set_first_grasp((55, 55, 55), (4.0, 2.0, 2.0))
    base_m = arm(0, 0.1).position_m[2] - arm(0).position_m[2]
    for t_ns, height_m, in_air in ((1, 0.0, False), (2, 0.019, False), (3, RISEN_M, True)):
        read(by_touch, t_ns * 10**9, 4.0, base_m + height_m)
        assert by_touch.grip is not None and by_touch.grip.now is not None
        assert by_touch.grip.now.in_air is in_air, height_m
