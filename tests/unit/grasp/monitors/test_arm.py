"""Plausibility checks of the arm: each limit takes effect at its value."""

import math
from typing import Any

import msgspec
import pytest

from drivers.interfaces import ArmState, Vector3
from drivers.ur.model import ArmModel
from drivers.ur.settings import ArmModelSettings
from grasp.control.commands import MoveArm, StopArm
from grasp.control.monitors.arm import AT_TARGET_M, OFF_LINE_M, TURN_S, ArmHistory
from grasp.control.monitors.settings import MonitorSettings
from tests.unit.grasp.builders import arm

MS = 1_000_000
X, Y, Z = arm(0).position_m


class CheckedArm:
    """The history of an arm, and the checks that fail after each state."""

    def __init__(self, **settings: Any) -> None:
        self._history = ArmHistory(MonitorSettings(**settings))
        self.command = self._history.sent

    def update(self, state: ArmState, pending: bool = False) -> str:
        return ", ".join(self._history.update(state, pending))


def at(t_s: float, height_m: float, aside_m: float = 0.0, speed_mps: float = 0.0) -> ArmState:
    state = arm(round(t_s * 1e9))
    return msgspec.structs.replace(
        state, position_m=(X + aside_m, Y, Z + height_m), velocity_mps=(0.0, 0.0, speed_mps)
    )


def up(
    by_m: float, speed_mps: float = 0.1, ramp_mps2: float = 0.5, aside_m: float = 0.0
) -> MoveArm:
    """Command to a point ``by_m`` above the start."""
    return MoveArm((X + aside_m, Y, Z + by_m), speed_mps, ramp_mps2)


def sent_up(**settings: Any) -> CheckedArm:
    """Checks of an arm that is at rest at 0 s and is then commanded to rise by 0.2 m."""
    checked = CheckedArm(**settings)
    assert checked.update(at(0.0, 0.0)) == ""
    checked.command(up(0.2), at(0.0, 0.0))
    return checked


def failed_while_rising(*states: ArmState, by_m: float = 0.2, **settings: Any) -> str:
    """Code that fails at the last state; the arm is commanded to rise at 0 s."""
    checked = CheckedArm(**settings)
    assert checked.update(at(0.0, 0.0)) == ""
    checked.command(up(by_m), at(0.0, 0.0))
    codes = [checked.update(state) for state in states]
    assert not any(codes[:-1])
    return codes[-1]


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_arm_start_s(value: float) -> None:
    def after(s: float) -> str:
        return failed_while_rising(at(s + TURN_S, 0.00005), arm_start_s=value)

    assert (after(value - 1e-4), after(value + 1e-4)) == ("", "arm_frozen")


@pytest.mark.parametrize("command_sent", [True, False])
def test_arm_at_its_target_that_reports_motion_is_detected(command_sent: bool) -> None:
    """Otherwise only the phase time-out would end a run with a stuck motion flag."""
    checked = CheckedArm(arm_start_s=0.3)
    moving = [msgspec.structs.replace(at(t_s, 0.0), moving=True) for t_s in (0.0, 0.39, 0.41)]
    assert checked.update(moving[0]) == ""
    if command_sent:
        checked.command(MoveArm(moving[0].position_m, 0.1, 0.5), moving[0])
    assert checked.update(moving[1]) == ""
    assert checked.update(moving[2]) == "arm_frozen"


def test_an_arm_that_moves_without_a_command_deviates() -> None:
    checked = CheckedArm()
    assert checked.update(at(0.0, 0.0)) == ""
    assert checked.update(at(0.1, 0.004)) == "arm_wrong_way"


def test_an_arm_that_must_brake_first_does_not_deviate() -> None:
    checked = sent_up()
    rising = at(1.0, 0.1, speed_mps=0.1)
    assert checked.update(rising) == ""
    checked.command(up(0.0), rising)
    assert checked.update(at(1.2, 0.11)) == ""
    assert checked.update(at(1.3, 0.15)) == "arm_wrong_way"


def assert_never_blamed(
    end: Vector3, speed_mps: float, ramp_mps2: float, delay_ms: int = 0, phase_ms: int = 0
) -> None:
    """Assert that no check fails for a rising arm that gets a new target ``end`` after 2 s."""
    model = ArmModel(ArmModelSettings(start_m=(X, Y, Z)), 0)
    checked = CheckedArm()
    goals = {(0, 0): (X, Y, Z + 0.5)}  # time of the command, time of its arrival
    for now_ms in range(phase_ms, 8000, 10):
        now_ns = now_ms * MS
        sample = model.read(now_ns)
        reported = msgspec.structs.replace(
            arm(sample.t_ns), position_m=sample.position_m, velocity_mps=sample.velocity_mps
        )
        if now_ms - phase_ms == 2000:
            a, b, c = sample.position_m
            goals[2000, 2000 + delay_ms] = (a + end[0], b + end[1], c + end[2])
        pending = any(due < now_ms <= sent for due, sent in goals)
        assert checked.update(reported, pending) == "", now_ms
        for (due, sent), goal_m in goals.items():
            if due == now_ms - phase_ms:
                checked.command(MoveArm(goal_m, speed_mps, ramp_mps2), reported)
            if sent == now_ms - phase_ms:
                model.move_l(goal_m, speed_mps, ramp_mps2, now_ns)


def test_an_arm_that_reverses_passes_all_checks() -> None:
    for speed_mps, ramp_mps2 in ((0.005, 0.5), (0.03, 3.0), (0.1, 0.05), (0.4, 0.5), (0.4, 3.0)):
        for delay_ms, phase_ms in ((0, 3), (280, 0), (280, 7)):
            assert_never_blamed((0.0, 0.0, -0.1), speed_mps, ramp_mps2, delay_ms, phase_ms)


def test_an_arm_that_overshoots_a_target_too_near_to_brake_passes_all_checks() -> None:
    """The arm first approaches the target and then reverses."""
    for speed_mps, ramp_mps2 in ((0.1, 0.05), (0.25, 0.3), (0.25, 3.0), (0.4, 0.5)):
        for share, aside_m in ((0.0, 0.0), (0.1, 0.02), (0.6, 0.0), (0.9, 0.002), (0.99, 0.02)):
            braking_m = speed_mps**2 / (2.0 * ramp_mps2)
            assert_never_blamed((aside_m, 0.0, share * braking_m), speed_mps, ramp_mps2)


@pytest.mark.parametrize("ramp_mps2", [0.3, 0.5, 3.0])
def test_an_arm_that_overshoots_more_than_braking_explains_is_detected(
    ramp_mps2: float,
) -> None:
    """A target 0.1 mm ahead at 0.25 m/s allows braking after 0.25 s plus 2 mm."""
    limit_m = 0.25 * 0.25 + 0.25**2 / (2 * ramp_mps2) + OFF_LINE_M + 0.0001

    def failed_at(m: float) -> str:
        checked = CheckedArm()
        rising = at(0.0, 0.0, speed_mps=0.25)
        assert checked.update(rising) == ""
        checked.command(up(0.0001, 0.25, ramp_mps2), rising)
        return checked.update(at(0.3, m, speed_mps=0.25))

    assert (failed_at(limit_m - 1e-5), failed_at(limit_m + 1e-5)) == ("", "arm_wrong_way")


def test_a_stopped_arm_may_be_at_any_position() -> None:
    checked = sent_up()
    checked.update(at(0.5, 0.05))
    checked.command(StopArm(1.0), at(0.5, 0.05))
    assert checked.update(at(5.0, 0.05)) == ""


def test_a_pending_command_does_not_change_the_expected_motion() -> None:
    checked = sent_up()
    assert checked.update(at(0.5, 0.0), True) == ""
    assert checked.update(at(0.6, 0.0)) == ""
    assert checked.update(at(0.9, 0.0)) == "arm_frozen"


def failed_after_standstill(m: float, moving: bool = False) -> str:
    """Code that fails after a stop while rising, when the arm moves on by ``m``."""
    checked = sent_up()
    assert checked.update(at(0.1, 0.005)) == ""
    checked.command(StopArm(1.0), at(0.1, 0.005))
    assert checked.update(at(0.11, 0.006)) == ""
    codes = msgspec.structs.replace(at(0.15, 0.006 + m), moving=moving)
    return checked.update(codes)


def test_motion_after_a_reported_standstill_is_detected() -> None:
    assert failed_after_standstill(AT_TARGET_M - 1e-5) == ""
    assert failed_after_standstill(AT_TARGET_M + 1e-5) == "arm_wrong_way"
    assert failed_after_standstill(AT_TARGET_M + 1e-5, moving=True) == ""


def failed_after_stop(m: float) -> str:
    """Code that fails when an arm rising at 0.1 m/s ignores a stop at 1 m/s2 for ``m`` metres."""
    checked = sent_up(arm_start_s=0.2)
    rising = at(1.0, 0.05, speed_mps=0.1)
    assert checked.update(rising) == ""
    checked.command(StopArm(1.0), rising)
    for step in range(1, 101):
        states = at(1.0 + 0.02 * step, 0.05 + step * m / 100, speed_mps=0.1)
        moving = msgspec.structs.replace(states, moving=True)
        if step % 20 == 0:  # a repeated stop allows no further motion
            checked.command(StopArm(1.0), moving)
        if codes := checked.update(moving):
            return codes
    return ""


def test_arm_that_ignores_a_stop_on_its_line_is_detected() -> None:
    """Limit: 0.2 s at 0.1 m/s, 5 mm of braking, and 1 mm."""
    assert (failed_after_stop(0.0259), failed_after_stop(0.0261)) == ("", "arm_wrong_way")


def test_an_arm_may_continue_only_until_the_stop_has_arrived() -> None:
    def failed_at(m: float) -> str:
        checked = sent_up(arm_start_s=0.2)
        states = [
            msgspec.structs.replace(at(t_s, height_m, speed_mps=0.1), moving=True)
            for t_s, height_m in ((1.0, 0.05), (1.5, 0.1), (1.51, 0.1), (1.6, 0.1 + m))
        ]
        checked.update(states[0])
        checked.command(StopArm(1.0), states[0])
        codes = [checked.update(state, n == 0) for n, state in enumerate(states[1:])]
        return "".join(codes)

    assert (failed_at(0.0259), failed_at(0.0261)) == ("", "arm_wrong_way")


@pytest.mark.parametrize("direction", ["back", "aside"])
def test_deviation_from_the_line_is_detected_beyond_its_limit(direction: str) -> None:
    def failed_at(m: float) -> str:
        return failed_while_rising(at(0.1, -m) if direction == "back" else at(0.1, 0.01, aside_m=m))

    assert (failed_at(OFF_LINE_M - 1e-5), failed_at(OFF_LINE_M + 1e-5)) == ("", "arm_wrong_way")


def test_an_arm_may_stop_only_at_its_target() -> None:
    def standing(away_m: float) -> str:
        states = (at(0.1, 0.01 - away_m), at(0.6, 0.01 - away_m))
        return failed_while_rising(*states, by_m=0.01)

    assert (standing(AT_TARGET_M - 1e-5), standing(AT_TARGET_M + 1e-5)) == ("", "arm_frozen")


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_nan_is_detected_and_skips_the_other_checks(value: float) -> None:
    checked = sent_up()
    for broken in ({"position_m": (value, Y, Z)}, {"speed_fraction": value}):
        state = msgspec.structs.replace(at(0.1, 0.0), **broken)
        assert checked.update(state) == "arm_position_nan", broken


def paced(fraction: float, state: ArmState) -> ArmState:
    return msgspec.structs.replace(state, speed_fraction=fraction)


@pytest.mark.parametrize("fraction", [1.0, 0.5, 0.1])
def test_time_until_frozen_scales_with_the_speed_slider(fraction: float) -> None:
    def begins(after_s: float) -> str:
        checked = CheckedArm(arm_start_s=0.25)
        assert checked.update(paced(fraction, at(0.0, 0.0))) == ""
        checked.command(up(0.2), at(0.0, 0.0))
        start_s = (0.25 + TURN_S) / fraction
        return checked.update(paced(fraction, at(start_s + after_s, 0.00005)))

    assert (begins(-0.01), begins(0.01)) == ("", "arm_frozen")


def test_an_arm_whose_slider_is_raised_again_gets_the_start_time() -> None:
    checked = sent_up(arm_start_s=0.25)
    assert checked.update(paced(0.0, at(0.2, 0.0))) == ""
    assert checked.update(paced(0.0, at(1.0, 0.0))) == ""
    assert checked.update(paced(1.0, at(1.01, 0.0))) == ""
    assert checked.update(paced(1.0, at(1.2, 0.0))) == ""
    assert checked.update(paced(1.0, at(1.4, 0.0))) == "arm_frozen"


@pytest.mark.parametrize("stopped", [False, True])  # a stop is repeated until it is confirmed
def test_arm_that_alternates_between_motion_and_standstill_is_detected(stopped: bool) -> None:
    def found(every: int) -> bool:
        checked, codes = CheckedArm(), []
        for i in range(120):
            if stopped:
                checked.command(StopArm(1.0), at(0.01 * i, 0.0))
            state = msgspec.structs.replace(at(0.01 * i, 0.0), moving=bool(i // every % 2))
            codes.append(checked.update(state))
        return "arm_flickers" in codes

    assert [found(every) for every in (2, 4, 10, 13)] == [True, True, True, False]
