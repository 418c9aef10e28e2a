"""Doubts about the arm as a pure unit: each setting takes effect where its name says."""

import math
from typing import Any

import msgspec
import pytest

from drivers.interfaces import ArmState, Vector3
from drivers.ur.model import ArmModel, ArmModelSettings
from grasp.arm_doubt import ArmDoubt
from grasp.commands import Command, HoldFingers, MoveArm, StopArm
from grasp.doubt import Doubts
from grasp.doubt_settings import DoubtSettings
from grasp.states import State
from tests.unit.grasp.builders import arm, gripper

MS = 1_000_000
X, Y, Z = arm(0).position_m


def at(t_s: float, height_m: float, aside_m: float = 0.0, speed_mps: float = 0.0) -> ArmState:
    state = arm(round(t_s * 1e9))
    return msgspec.structs.replace(
        state, position_m=(X + aside_m, Y, Z + height_m), velocity_mps=(0.0, 0.0, speed_mps)
    )


def up(
    by_m: float, speed_mps: float = 0.1, ramp_mps2: float = 0.5, aside_m: float = 0.0
) -> MoveArm:
    """To a point so far above the one at which each arm begins."""
    return MoveArm((X + aside_m, Y, Z + by_m), speed_mps, ramp_mps2)


def sent_up(**settings: Any) -> ArmDoubt:
    """Of an arm that stood at 0 s, and was told then to rise by 0.2 m."""
    doubt = ArmDoubt(DoubtSettings(**settings))
    assert doubt.see(at(0.0, 0.0), False) == ""
    doubt.told(up(0.2), at(0.0, 0.0))
    return doubt


def told_up(*states: ArmState, by_m: float = 0.2, **settings: Any) -> str:
    """Name of the last doubt; the arm stands at 0 s, and is told to rise then."""
    doubt = ArmDoubt(DoubtSettings(**settings))
    assert doubt.see(at(0.0, 0.0), False) == ""
    doubt.told(up(by_m), at(0.0, 0.0))
    said = [doubt.see(state, False) for state in states]
    assert not any(said[:-1])
    return said[-1].partition(":")[0]


SPARE_S = 2 * math.sqrt(2 * 0.0001 / 0.5)  # to turn round within what counts as no motion


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_arm_start_s(value: float) -> None:
    def after(s: float) -> str:
        return told_up(at(s + SPARE_S, 0.00005), arm_start_s=value)

    assert (after(value - 1e-4), after(value + 1e-4)) == ("", "arm_frozen")


@pytest.mark.parametrize("told", [True, False])
def test_arm_that_stands_where_it_shall_and_says_that_it_moves_is_doubted(told: bool) -> None:
    """Else only the time-out of a phase would end a run in which its flag sticks."""
    doubt = ArmDoubt(DoubtSettings(arm_start_s=0.3))
    moving = [msgspec.structs.replace(at(t_s, 0.0), moving=True) for t_s in (0.0, 0.29, 0.35)]
    assert doubt.see(moving[0], False) == ""
    if told:
        doubt.told(MoveArm(moving[0].position_m, 0.1, 0.5), moving[0])
    assert doubt.see(moving[1], False) == ""
    assert doubt.see(moving[2], False).startswith("arm_frozen: 0.35 s at one place, and it says")


@pytest.mark.parametrize("value", [0.05, 0.3])
def test_arm_frozen_s(value: float) -> None:
    def after(s: float) -> str:
        return told_up(at(0.1, 0.005), at(0.1 + s, 0.005), arm_frozen_s=value)

    assert (after(value - 1e-4), after(value + 1e-4)) == ("", "arm_frozen")


@pytest.mark.parametrize("value", [0.001, 0.005])
def test_arm_moved_m(value: float) -> None:
    spare_s = 2 * math.sqrt(2 * value / 0.5)

    def after(m: float) -> str:
        return told_up(at(0.26 + spare_s, m), arm_moved_m=value, arm_jump_m=0.1)

    assert (after(value - 1e-5), after(value + 1e-5)) == ("arm_frozen", "")


@pytest.mark.parametrize("value", [0.001, 0.005])
def test_arm_there_m(value: float) -> None:
    def standing(away_m: float) -> str:
        states = (at(0.1, 0.01 - away_m), at(0.5, 0.01 - away_m))
        return told_up(*states, by_m=0.01, arm_there_m=value)

    assert (standing(value - 1e-5), standing(value + 1e-5)) == ("", "arm_frozen")


def told_while_moving(up_mps: float, seen: ArmState, aside_m: float = 0.0, **settings: Any) -> str:
    """Name of the doubt about what is seen after an arm on its way was told to rise by 0.2 m."""
    doubt = ArmDoubt(DoubtSettings(**settings))
    moving = at(0.0, 0.0, speed_mps=up_mps)
    assert doubt.see(moving, False) == ""
    doubt.told(up(0.2, aside_m=aside_m), moving)
    return doubt.see(seen, False).partition(":")[0]


@pytest.mark.parametrize("value", [0.01, 0.03])
def test_arm_standing_mps(value: float) -> None:
    """One that sinks has to brake first, and may sink on; one that stands may not."""

    def sinking(mps: float) -> str:
        return told_while_moving(-mps, at(0.1, -0.0025), arm_standing_mps=value)

    assert (sinking(value - 1e-4), sinking(value + 1e-4)) == ("arm_wrong_way", "")


@pytest.mark.parametrize("value", [0.003, 0.02])
def test_arm_line_m(value: float) -> None:
    """Room to brake in has only what must leave its line."""

    def told_aside(m: float) -> str:
        return told_while_moving(0.1, at(0.1, 0.01, aside_m=-0.0025), m, arm_line_m=value)

    assert (told_aside(value - 1e-5), told_aside(value + 1e-5)) == ("arm_wrong_way", "")


@pytest.mark.parametrize("value", [0.002, 0.02])
@pytest.mark.parametrize("way", ["back", "aside"])
def test_arm_astray_m(value: float, way: str) -> None:
    def gone(m: float) -> str:
        state = at(0.1, -m) if way == "back" else at(0.1, 0.01, aside_m=m)
        return told_up(state, arm_astray_m=value)

    assert (gone(value - 1e-5), gone(value + 1e-5)) == ("", "arm_wrong_way")


def test_an_arm_that_nobody_told_to_move_is_astray_when_it_moves() -> None:
    doubt = ArmDoubt(DoubtSettings())
    assert doubt.see(at(0.0, 0.0), False) == ""
    assert doubt.see(at(0.1, 0.004), False).startswith("arm_wrong_way: ")


def test_an_arm_that_must_brake_first_is_not_astray() -> None:
    doubt = sent_up()
    rising = at(1.0, 0.1, speed_mps=0.1)
    assert doubt.see(rising, False) == ""
    doubt.told(up(0.0), rising)
    assert doubt.see(at(1.2, 0.11), False) == ""
    assert doubt.see(at(1.3, 0.15), False).startswith("arm_wrong_way: ")


def falling(height_m: float = 0.1) -> ArmDoubt:
    """It was told to go down on its way up, has braked, and comes down."""
    doubt = sent_up()
    rising = at(1.0, height_m, speed_mps=0.1)
    assert doubt.see(rising, False) == ""
    doubt.told(up(0.0), rising)
    assert doubt.see(at(1.2, height_m + 0.01), False) == ""
    assert doubt.see(at(1.3, height_m + 0.005), False) == ""
    return doubt


def test_an_arm_that_has_turned_round_is_given_nothing_for_braking_any_more() -> None:
    assert falling().see(at(1.31, 0.1055), False) == ""
    assert falling().see(at(1.35, 0.108), False).startswith("arm_wrong_way: ")
    assert falling().see(at(1.35, 0.100, aside_m=0.003), False).startswith("arm_wrong_way: ")
    assert falling().see(at(1.34, 0.105), False) == ""
    assert falling().see(at(1.37, 0.105), False).startswith("arm_frozen: ")


def test_an_arm_that_turns_round_may_keep_its_place_for_as_long_as_that_takes() -> None:
    def turning(s: float) -> str:
        doubt = sent_up(arm_frozen_s=0.06)
        rising = at(1.0, 0.1, speed_mps=0.1)
        doubt.see(rising, False)
        doubt.told(up(0.0), rising)
        assert doubt.see(at(1.2, 0.11), False) == ""
        return doubt.see(at(1.2 + s, 0.11), False)

    assert turning(0.06 + SPARE_S - 1e-3) == ""
    assert turning(0.06 + SPARE_S + 1e-3).startswith("arm_frozen: ")


def assert_never_doubted(
    end: Vector3, speed_mps: float, ramp_mps2: float, delay_ms: int = 0, phase_ms: int = 0
) -> None:
    """An arm that rises is told after 2 s to go to ``end``, from where it is then."""
    model = ArmModel(ArmModelSettings(start_m=(X, Y, Z)), 0)
    doubt = ArmDoubt(DoubtSettings())
    goals = {(0, 0): (X, Y, Z + 0.5)}  # when told, when it is on its way
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
        assert doubt.see(reported, pending) == "", now_ms
        for (due, sent), goal_m in goals.items():
            if due == now_ms - phase_ms:
                doubt.told(MoveArm(goal_m, speed_mps, ramp_mps2), reported)
            if sent == now_ms - phase_ms:
                model.move_l(goal_m, speed_mps, ramp_mps2, now_ns)


def test_an_arm_that_is_turned_round_on_its_way_is_never_doubted() -> None:
    for speed_mps, ramp_mps2 in ((0.005, 0.5), (0.03, 3.0), (0.1, 0.05), (0.4, 0.5), (0.4, 3.0)):
        for delay_ms, phase_ms in ((0, 3), (280, 0), (280, 7)):
            assert_never_doubted((0.0, 0.0, -0.1), speed_mps, ramp_mps2, delay_ms, phase_ms)


def test_an_arm_that_passes_a_target_too_near_to_brake_for_is_never_doubted() -> None:
    """It comes nearer first, and turns round only then."""
    for speed_mps, ramp_mps2 in ((0.1, 0.05), (0.25, 0.3), (0.25, 3.0), (0.4, 0.5)):
        for share, aside_m in ((0.0, 0.0), (0.1, 0.02), (0.6, 0.0), (0.9, 0.002), (0.99, 0.02)):
            braking_m = speed_mps**2 / (2.0 * ramp_mps2)
            assert_never_doubted((aside_m, 0.0, share * braking_m), speed_mps, ramp_mps2)


@pytest.mark.parametrize("ramp_mps2", [0.3, 0.5, 3.0])
def test_an_arm_that_passes_a_target_by_more_than_braking_takes_is_doubted(
    ramp_mps2: float,
) -> None:
    """Told to go 0.1 mm further at 0.25 m/s, it may brake after 0.25 s, and stray by 2 mm."""
    room_m = 0.25 * 0.25 + 0.25**2 / (2 * ramp_mps2) + 0.002 + 0.0001

    def gone(m: float) -> str:
        doubt = ArmDoubt(DoubtSettings(arm_jump_m=0.3))
        rising = at(0.0, 0.0, speed_mps=0.25)
        assert doubt.see(rising, False) == ""
        doubt.told(up(0.0001, 0.25, ramp_mps2), rising)
        return doubt.see(at(0.3, m, speed_mps=0.25), False).partition(":")[0]

    assert (gone(room_m - 1e-5), gone(room_m + 1e-5)) == ("", "arm_wrong_way")


def test_an_arm_goes_on_as_before_while_what_it_is_told_is_on_its_way() -> None:
    def rising_on(by_m: float, aside_m: float = 0.0) -> str:
        doubt = sent_up()
        rising = at(1.0, 0.05, speed_mps=0.1)
        doubt.see(rising, False)
        doubt.told(up(0.0), rising)
        assert doubt.see(at(1.5, 0.1, speed_mps=0.1), True) == ""
        assert doubt.see(at(2.0, 0.14, speed_mps=0.1), True) == ""
        return doubt.see(at(2.3, 0.14 + by_m, aside_m), False)

    assert rising_on(0.03) == ""  # it brakes
    assert rising_on(0.04).startswith("arm_wrong_way: ")
    assert rising_on(0.01, 0.04).startswith("arm_wrong_way: ")


@pytest.mark.parametrize("value", [0.5, 2.0])
def test_arm_fastest_mps(value: float) -> None:
    def after(s: float) -> str:
        return told_up(at(s, 0.11), arm_fastest_mps=value, arm_jump_m=0.01)

    assert (after(0.1 / value + 1e-4), after(0.1 / value - 1e-4)) == ("", "arm_jump")


@pytest.mark.parametrize("value", [0.005, 0.05])
def test_arm_jump_m(value: float) -> None:
    def leap(m: float) -> str:
        return told_up(at(0.0, m), arm_jump_m=value)

    assert (leap(value - 1e-5), leap(value + 1e-5)) == ("", "arm_jump")


def dated(here_s: float, there_s: float | None, height_m: float) -> ArmState:
    """Read then, and sampled then by the controller's own clock, which began 100 s before ours."""
    sampled_ns = None if there_s is None else round((100.0 + there_s) * 1e9)
    return msgspec.structs.replace(at(here_s, height_m), sampled_ns=sampled_ns)


def leapt(*states: ArmState) -> list[bool]:
    """At which of them the arm, told to rise by 0.4 m, is said to have."""
    doubt = ArmDoubt(DoubtSettings(arm_jump_m=0.01, arm_fastest_mps=1.0, arm_start_s=0.25))
    assert doubt.see(states[0], False) == ""
    doubt.told(up(0.4, 0.25, 1.0), states[0])
    return ["arm_jump" in doubt.see(state, False) for state in states[1:]]


def test_samples_that_come_in_a_burst_after_who_reads_them_was_kept_waiting_are_no_leap() -> None:
    """Read at its time each 10 ms, an arm at 0.25 m/s, whose samples came 0.1 s late meanwhile."""
    late = [dated(0.01 * k, 0.0, 0.0) for k in range(1, 10)]  # all dated as the first was
    assert leapt(dated(0.0, 0.0, 0.0), *late, dated(0.1, 0.1, 0.025)) == [False] * 10
    slow = [dated(0.01 * k, 0.005 * k, 0.00125 * k) for k in range(1, 21)]
    assert leapt(dated(0.0, 0.0, 0.0), *slow, dated(0.21, 0.21, 0.0525)) == [False] * 21
    unknown = [msgspec.structs.replace(state, sampled_ns=None) for state in slow]
    burst = dated(0.21, None, 0.0525)
    assert leapt(dated(0.0, None, 0.0), *unknown, burst) == [False] * 20 + [True]


@pytest.mark.parametrize(("there_s", "leaps"), [(0.039, True), (0.041, False), (0.1, False)])
def test_a_leap_is_judged_by_the_controllers_clock_where_it_was_heard_of_late(
    there_s: float, leaps: bool
) -> None:
    assert leapt(dated(0.0, 0.0, 0.0), dated(0.1, there_s, 0.05)) == [leaps]


@pytest.mark.parametrize("there_s", [0.0, 0.01, 0.02, 0.5, 1e6, -0.5, -1e6])
def test_no_clock_of_a_controller_hides_a_leap(there_s: float) -> None:
    """One that stands still, goes on, runs ahead, for good or not, or runs back."""
    there = 0.01 + there_s
    assert leapt(
        dated(0.0, 0.0, 0.0), dated(0.01, 0.01, 0.0), dated(0.02, there, 0.05),
        dated(0.03, there, 0.0), dated(0.04, there + 0.02, 0.05), dated(0.05, there + 1.0, 0.0),
        dated(0.06, 0.06, 0.05), dated(0.07, 0.07, 0.0), dated(0.08, 2.0, 0.05),
    ) == [False] + [True] * 7  # fmt: skip


@pytest.mark.parametrize(("height_m", "leaps"), [(0.268, False), (0.273, True)])
def test_a_clock_that_ran_slow_for_long_makes_room_for_no_more_than_a_command_takes(
    height_m: float, leaps: bool
) -> None:
    slow = [dated(0.01 * k, 0.001 * k, 0.0) for k in range(1, 100)]
    *before, last = leapt(dated(0.0, 0.0, 0.0), *slow, dated(1.0, 1.0, height_m))
    assert (any(before), last) == (False, leaps)


def test_a_delay_that_was_made_up_for_makes_room_for_nothing_more() -> None:
    assert leapt(
        dated(0.0, 0.0, 0.0), dated(0.1, 0.05, 0.0), dated(0.11, 0.11, 0.055),
        dated(0.12, 0.17, 0.11),
    ) == [False, False, True]  # fmt: skip


def test_an_arm_that_was_told_to_stop_may_stand_anywhere() -> None:
    doubt = sent_up()
    doubt.see(at(0.5, 0.05), False)
    doubt.told(StopArm(1.0), at(0.5, 0.05))
    assert doubt.see(at(5.0, 0.05), False) == ""


def test_a_command_on_its_way_does_not_move_the_arm_yet() -> None:
    doubt = sent_up()
    assert doubt.see(at(0.5, 0.0), True) == ""
    assert doubt.see(at(0.6, 0.0), False) == ""
    assert doubt.see(at(0.9, 0.0), False).startswith("arm_frozen: ")


def stopped_and_gone(m: float, moving: bool = False) -> str:
    """Told to stop on its way up, it says that it stands, or does not, and goes on."""
    doubt = sent_up(arm_there_m=0.002)
    assert doubt.see(at(0.1, 0.005), False) == ""
    doubt.told(StopArm(1.0), at(0.1, 0.005))
    assert doubt.see(at(0.11, 0.006), False) == ""
    said = msgspec.structs.replace(at(0.15, 0.006 + m), moving=moving)
    return doubt.see(said, False).partition(":")[0]


def test_arm_that_was_stopped_and_says_that_it_stands_does_not_go_on() -> None:
    assert (stopped_and_gone(0.0019), stopped_and_gone(0.0021)) == ("", "arm_goes_on")
    assert stopped_and_gone(0.0021, moving=True) == ""


def told_to_stop(m: float, **settings: float) -> str:
    """Rising at 0.1 m/s it was told to stop at 1 m/s2, and says that it moves that far away."""
    doubt = sent_up(arm_start_s=0.2, arm_there_m=0.001, **settings)
    rising = at(1.0, 0.05, speed_mps=0.1)
    assert doubt.see(rising, False) == ""
    doubt.told(StopArm(1.0), rising)
    for step in range(1, 101):
        seen = at(1.0 + 0.02 * step, 0.05 + step * m / 100, speed_mps=0.1)
        moving = msgspec.structs.replace(seen, moving=True)
        if step % 20 == 0:  # it is told so again, and gets no more room by that
            doubt.told(StopArm(1.0), moving)
        if said := doubt.see(moving, False):
            return said.partition(":")[0]
    return ""


def test_arm_that_obeys_no_stop_is_doubted_though_it_stays_on_its_way() -> None:
    """0.2 s at 0.1 m/s, 5 mm of braking, and 1 mm."""
    assert (told_to_stop(0.0259), told_to_stop(0.0261)) == ("", "arm_goes_on")


def test_an_arm_may_go_on_while_the_stop_is_on_its_way_to_it_and_no_longer() -> None:
    def gone(m: float) -> str:
        doubt = sent_up(arm_start_s=0.2, arm_there_m=0.001)
        seen = [
            msgspec.structs.replace(at(t_s, height_m, speed_mps=0.1), moving=True)
            for t_s, height_m in ((1.0, 0.05), (1.5, 0.1), (1.51, 0.1), (1.6, 0.1 + m))
        ]
        doubt.see(seen[0], False)
        doubt.told(StopArm(1.0), seen[0])
        said = [doubt.see(state, n == 0) for n, state in enumerate(seen[1:])]
        return "".join(said).partition(":")[0]

    assert (gone(0.0259), gone(0.0261)) == ("", "arm_goes_on")


def test_arm_that_was_stopped_and_says_that_it_moves_does_not_keep_its_place() -> None:
    """As one whose values have frozen while it slowed down: nobody would know when it stands."""

    def after(s: float, moving: bool = True) -> str:
        doubt = ArmDoubt(DoubtSettings())
        for t_s, height_m in ((0.0, 0.1), (0.01, 0.101)):
            doubt.see(at(t_s, height_m, speed_mps=0.1), False)
        doubt.told(StopArm(3.0), at(0.01, 0.101, speed_mps=0.1))
        doubt.told(StopArm(3.0), at(0.05, 0.101, speed_mps=0.1))  # again
        told = msgspec.structs.replace(at(0.01 + s, 0.101, speed_mps=0.1), moving=moving)
        return doubt.see(told, False).partition(":")[0]

    braking_s = 2 * math.sqrt(2 * 1e-4 / 3.0)
    assert (after(0.059 + braking_s), after(0.061 + braking_s)) == ("", "arm_frozen")
    assert after(1.0, moving=False) == ""


@pytest.mark.parametrize("stopped", [False, True])  # a stop is told again until it is seen
@pytest.mark.parametrize(("every", "doubted"), [(2, True), (4, True), (10, True), (13, False)])
def test_arm_that_says_again_and_again_that_it_moves_and_stands_is_doubted(
    every: int, doubted: bool, stopped: bool
) -> None:
    doubt, told = ArmDoubt(DoubtSettings()), []
    for i in range(120):
        if stopped:
            doubt.told(StopArm(1.0), at(0.01 * i, 0.0))
        says = msgspec.structs.replace(at(0.01 * i, 0.0), moving=bool(i // every % 2))
        told.append(doubt.see(says, False))
    assert any(text.startswith("arm_flickers") for text in told) is doubted


def going(t_s: float, height_m: float, speed_mps: float = 0.0) -> ArmState:
    return msgspec.structs.replace(at(t_s, height_m, speed_mps=speed_mps), moving=True)


def stopped_at(height_m: float, deceleration_mps2: float = 1.0) -> ArmDoubt:
    """Told to rise to 0.2 m, and to stop gently when it is there, at 0.1 m/s."""
    doubt = ArmDoubt(DoubtSettings(arm_jump_m=0.3))
    assert doubt.see(at(0.0, 0.0), False) == ""
    doubt.told(up(0.2, 0.1, 5.0), at(0.0, 0.0))
    rising = going(1.9, height_m, speed_mps=0.1)
    assert doubt.see(rising, False) == ""
    doubt.told(StopArm(deceleration_mps2), rising)
    return doubt


def test_an_arm_that_is_stopped_gently_may_end_past_where_it_was_told_to_be() -> None:
    doubt = stopped_at(0.195)
    assert doubt.see(going(2.0, 0.202, speed_mps=0.05), False) == ""
    assert doubt.see(going(2.1, 0.2065), False) == ""
    assert doubt.see(going(2.2, 0.2071), False).startswith("arm_wrong_way: ")  # 5 mm, and 2


def test_an_arm_that_still_speeds_up_when_it_is_told_to_stop_may_brake_from_there() -> None:
    def ends(at_mps: float, height_m: float) -> str:
        doubt = ArmDoubt(DoubtSettings())
        doubt.see(at(0.0, 0.0), False)
        doubt.told(up(0.01, 0.2, 5.0), at(0.0, 0.0))
        rising = going(0.03, 0.0025, speed_mps=at_mps)
        assert doubt.see(rising, False) == ""
        doubt.told(StopArm(1.0), rising)
        assert doubt.see(going(0.2, 0.01 + height_m / 2), False) == ""
        return doubt.see(going(0.3, 0.01 + height_m), False).partition(":")[0]

    assert (ends(0.15, 0.0219), ends(0.15, 0.0221)) == ("", "arm_wrong_way")  # 0.2 m/s, and 2 mm


@pytest.mark.parametrize(
    ("commands", "says"), [((HoldFingers(), up(0.2)), "arm_frozen"), ((HoldFingers(),), "")]
)
def test_what_a_step_tells_the_arm_is_what_it_is_doubted_by(
    commands: tuple[Command, ...], says: str
) -> None:
    doubts = Doubts(DoubtSettings())
    later = round((DoubtSettings().arm_start_s + SPARE_S + 0.01) * 1e9)
    assert doubts.of(State.START, None, gripper(0), arm(0)) == ""
    doubts.sent(commands, arm(0))
    said = doubts.of(State.START, None, gripper(later), arm(later))
    assert said.partition(":")[0] == says


def paced(fraction: float, state: ArmState) -> ArmState:
    return msgspec.structs.replace(state, speed_fraction=fraction)


@pytest.mark.parametrize("fraction", [math.nan, math.inf, -0.01, 1.01, 100.0])
def test_slider_that_stands_nowhere_is_doubted(fraction: float) -> None:
    doubt = ArmDoubt(DoubtSettings())
    assert doubt.see(at(0.0, 0.0), False) == ""
    assert doubt.see(paced(fraction, at(0.01, 0.0)), False).startswith("arm_slider: ")


def slowed(fraction: float, command: Command, *states: ArmState, **settings: Any) -> str:
    """As ``told_up``, by an arm whose slider stands there."""
    doubt = ArmDoubt(DoubtSettings(**settings))
    assert doubt.see(paced(fraction, at(0.0, 0.0)), False) == ""
    doubt.told(command, at(0.0, 0.0))  # type: ignore[arg-type]
    return [doubt.see(paced(fraction, state), False) for state in states][-1].partition(":")[0]


@pytest.mark.parametrize("fraction", [1.0, 0.5, 0.1])
def test_arm_is_frozen_only_after_longer_the_slower_its_slider_makes_it(fraction: float) -> None:
    start_s = (0.25 + SPARE_S) / fraction

    def begins(after_s: float) -> str:
        return slowed(fraction, up(0.2), at(start_s + after_s, 0.00005), arm_start_s=0.25)

    assert (begins(-0.01), begins(0.01)) == ("", "arm_frozen")

    def stands(after_s: float) -> str:
        on_its_way, there_s = at(0.1, 0.001, speed_mps=0.01), 0.1 + 0.06 / fraction
        still = at(there_s + after_s, 0.001, speed_mps=0.01)
        return slowed(fraction, up(0.2), on_its_way, still, arm_frozen_s=0.06)

    assert (stands(-0.01), stands(0.01)) == ("", "arm_frozen")


@pytest.mark.parametrize("value", [0.2, 2.0])
def test_arm_slider_s(value: float) -> None:
    """Turned from a tenth to full: half of that on, half of the pace is there."""
    doubt = ArmDoubt(DoubtSettings(arm_slider_s=value, arm_frozen_s=0.06))
    assert doubt.see(paced(0.1, at(0.0, 0.0)), False) == ""
    doubt.told(up(0.2), at(0.0, 0.0))
    up_s = 0.4 * value
    assert doubt.see(paced(1.0, at(up_s, 0.001, speed_mps=0.05)), False) == ""
    assert doubt.see(paced(0.5, at(up_s + 1e-6, 0.001, speed_mps=0.05)), False) == ""
    for late_s, said in ((0.06 / 0.5 - 0.005, ""), (0.06 / 0.5 + 0.005, "arm_frozen")):
        state = at(up_s + late_s, 0.001, speed_mps=0.05)
        assert doubt.see(paced(0.5, state), False).partition(":")[0] == said


def after_standstill(*backlog: ArmState, heard: ArmState, later: tuple[ArmState, ...]) -> list[str]:
    """Of an arm on its way up at 0.02 m/s, since 0.1 s, when for 4 s nobody saw it: what it said
    meanwhile comes in a burst, it is told to stop at the first of it, and ``heard`` is the last."""
    doubt = ArmDoubt(DoubtSettings())
    assert doubt.see(at(0.0, 0.0), False) == ""
    doubt.told(up(0.2, 0.02, 0.5), at(0.0, 0.0))
    assert doubt.see(at(0.1, 0.002, speed_mps=0.02), False) == ""
    first, *rest = backlog
    doubt.begin_anew(first, round(4.0 * 1e9))
    said = [doubt.see(first, False)]
    doubt.told(StopArm(0.8), first)
    return [*said, *(doubt.see(state, False) for state in (*rest, heard, *later))]


BURST = (at(4.11, 0.002, speed_mps=0.02), at(4.12, 0.04, speed_mps=0.02))
STANDS = at(4.13, 0.082)


def test_what_an_arm_did_while_the_loop_stood_still_is_no_leap_and_no_stop_that_it_ignored() -> (
    None
):
    later = tuple(at(4.14 + 0.01 * k, 0.082) for k in range(200))
    assert set(after_standstill(*BURST, heard=STANDS, later=later)) == {""}


def test_an_arm_that_goes_on_long_after_the_standstill_though_told_to_stop_is_doubted() -> None:
    rising = tuple(
        msgspec.structs.replace(
            at(4.14 + 0.01 * k, 0.082 + 0.0002 * k, speed_mps=0.02), moving=True
        )
        for k in range(200)
    )
    said = after_standstill(*BURST, heard=STANDS, later=rising)
    assert next(filter(None, said)).startswith("arm_goes_on: ")


def test_an_arm_that_leaps_or_strays_after_the_standstill_is_doubted() -> None:
    stood = tuple(at(4.14 + 0.01 * k, 0.082) for k in range(30))
    leapt, aside = at(4.45, 0.14), at(4.2, 0.082, aside_m=0.003)
    assert after_standstill(*BURST, heard=STANDS, later=(*stood, leapt))[-1].startswith("arm_jump")
    assert after_standstill(*BURST, heard=STANDS, later=(aside,))[-1].startswith("arm_wrong_way")
