"""The force guard: what it lets through, sampled densely around the limit."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ConfigError
from grasp.commands import CloseFast, HoldFingers, MoveFingers, OpenFingers
from grasp.guard import ForceGuard, GuardSettings
from grasp.stiffness import Stiffness
from tests.unit.grasp.builders import gripper

M_PER_COUNT = 0.00077
RIGID = Stiffness(2500.0 * M_PER_COUNT)
NO_FORCE = (0.0, 0.0, 0.0)
ALL = (True, True, True)
AROUND_THE_LIMIT = [9.0, 9.9, math.nextafter(10, 0), 10.0, math.nextafter(10, 11), 10.1, 11, 60.0]


def guard(**changes: object) -> ForceGuard:
    settings = msgspec.structs.replace(GuardSettings(), **changes)
    stiffness = Stiffness(settings.contact_stiffness_npm * M_PER_COUNT)
    return ForceGuard(settings, least_force_n=10.0, stiffness=stiffness)


def close(force_n: float = 10.0, speed: float = 0.11, limit: int = 255) -> CloseFast:
    return CloseFast(force_n, ALL, (limit, limit, limit), speed)


@pytest.mark.parametrize("asked_n", AROUND_THE_LIMIT)
def test_no_force_above_the_limit_is_admitted(asked_n: float) -> None:
    admitted = guard().admit(close(asked_n), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseFast)
    assert admitted.force_cap_n == min(asked_n, 10.0)
    moved = guard().admit(MoveFingers((60, 60, 60), 0.05, asked_n), gripper(), NO_FORCE)
    assert isinstance(moved, MoveFingers)
    assert moved.force_n == min(asked_n, 10.0)


def test_calibration_that_cannot_keep_the_limit_is_refused_with_the_remedy() -> None:
    with pytest.raises(ConfigError) as caught:
        ForceGuard(GuardSettings(), least_force_n=15.0, stiffness=RIGID)
    assert "15 N" in caught.value.message
    assert "calibration" in caught.value.remedy


def test_least_force_equal_to_the_limit_is_accepted() -> None:
    ForceGuard(GuardSettings(), least_force_n=10.0, stiffness=RIGID)


def test_thumb_closes_alone_when_every_finger_must_keep_the_limit() -> None:
    admitted = guard().admit(close(), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseFast)
    assert admitted.closing == (True, False, False)


def test_all_fingers_close_when_each_motor_keeps_the_limit_for_itself() -> None:
    admitted = guard(cap_mode="each_motor").admit(close(), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseFast)
    assert admitted.closing == ALL


def test_closing_speed_keeps_the_energy_within_the_stated_overshoot() -> None:
    g = guard(overshoot_n=1.0, contact_stiffness_npm=2500.0, tip_mass_kg=0.1)
    assert g.closing_speed_mps * math.sqrt(2500.0 * 0.1) == pytest.approx(1.0)
    admitted = g.admit(close(speed=0.11), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseFast)
    assert admitted.speed_mps == g.closing_speed_mps
    assert g.admit(close(speed=0.03), gripper(), NO_FORCE) == CloseFast(
        10.0, (True, False, False), (255, 255, 255), 0.03
    )


def test_measured_force_beyond_its_margin_stops_further_closing_but_never_opens() -> None:
    over = (15.1, 0.0, 0.0)
    assert guard().admit(close(), gripper(), over) == HoldFingers()
    assert guard().admit(MoveFingers((56, 55, 55), 0.05, 10.0), gripper(), over) == HoldFingers()
    at = (15.0, 0.0, 0.0)
    assert isinstance(guard().admit(close(), gripper(), at), CloseFast)


def test_measured_force_does_not_stop_opening() -> None:
    over = (40.0, 0.0, 0.0)
    opening = MoveFingers((50, 55, 55), 0.05, 10.0)
    assert guard().admit(opening, gripper(), over) == opening
    assert guard().admit(OpenFingers(0.1), gripper(), over) == OpenFingers(0.1)


def test_with_travel_bound_nothing_closes_before_a_first_grasp_is_known() -> None:
    assert guard(travel_bound=True).admit(close(), gripper(), NO_FORCE) == HoldFingers()


@given(
    first_n=st.floats(0, 12),
    stiffness=st.floats(600, 10_000),
    target=st.integers(0, 255),
    anchor=st.integers(0, 200),
)
def test_no_target_lies_beyond_the_position_where_the_force_reaches_the_limit(
    first_n: float, stiffness: float, target: int, anchor: int
) -> None:
    g = guard(travel_bound=True, contact_stiffness_npm=stiffness, cap_mode="each_motor")
    g.anchor((anchor, anchor, anchor), (first_n, first_n, first_n))
    admitted = g.admit(close(limit=target), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseFast)
    for limit in admitted.limits_counts:
        travel_m = max(0, limit - anchor) * 0.00077
        assert first_n + stiffness * travel_m <= max(10.0, first_n) + 1e-9
        assert limit <= target


def test_move_is_bounded_by_position_as_a_closing_is() -> None:
    g = guard(travel_bound=True)
    g.anchor((55, 55, 55), (2.0, 1.0, 1.0))
    closing = g.admit(close(), gripper(), NO_FORCE)
    moving = g.admit(MoveFingers((255, 255, 255), 0.05, 10.0), gripper(), NO_FORCE)
    assert isinstance(closing, CloseFast) and isinstance(moving, MoveFingers)
    assert moving.targets_counts == closing.limits_counts < (70, 70, 70)


def test_finger_whose_grasp_was_above_the_limit_stays_where_it_is() -> None:
    g = guard(travel_bound=True)
    g.anchor((55, 55, 55), (12.0, 1.0, 1.0))
    admitted = g.admit(close(), gripper(), NO_FORCE)
    assert isinstance(admitted, CloseFast)
    assert admitted.limits_counts[0] == 55


@pytest.mark.parametrize(
    ("mode", "thumb_n", "other_n", "stops"),
    [
        ("every_finger", 15.0, 15.0, False),
        ("every_finger", 15.1, 0.0, True),
        ("every_finger", 0.0, 15.1, True),
        ("each_motor", 25.0, 15.0, False),
        ("each_motor", 25.1, 0.0, True),
        ("each_motor", 0.0, 15.1, True),
    ],
)
def test_every_finger_has_its_own_limit_of_measured_force(
    mode: str, thumb_n: float, other_n: float, stops: bool
) -> None:
    for measured_n in ((thumb_n, other_n, 0.0), (thumb_n, 0.0, other_n)):
        admitted = guard(cap_mode=mode).admit(close(), gripper(), measured_n)
        assert isinstance(admitted, HoldFingers) is stops


def test_least_speed_that_just_keeps_the_overshoot_is_accepted() -> None:
    fastest_mps = guard().closing_speed_mps
    ForceGuard(GuardSettings(), 10.0, RIGID, fastest_mps)
    with pytest.raises(ConfigError, match="overshoot_n"):
        ForceGuard(GuardSettings(), 10.0, RIGID, math.nextafter(fastest_mps, 1.0))


def test_repeated_commands_do_not_ratchet_past_the_bound() -> None:
    g = guard(travel_bound=True)
    g.anchor((55, 55, 55), (2.0, 1.0, 1.0))
    limits = [g.admit(close(), gripper(positions=(55 + k, 55, 55)), NO_FORCE) for k in range(5)]
    assert len({c.limits_counts for c in limits if isinstance(c, CloseFast)}) == 1


def test_force_is_estimated_from_the_sum_of_counts_and_never_negative() -> None:
    assert guard(counts_per_newton=160.0).measured_n((-320.0, 16.0, 0.0)) == (2.0, 0.0, 0.0)
