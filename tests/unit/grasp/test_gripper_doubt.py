"""Doubts of the gripper: each setting takes effect where its name says, on both sides of it."""

from typing import Any

import msgspec
import pytest

from drivers.interfaces import Detection, GripperState
from grasp.doubt_settings import DoubtSettings
from grasp.gripper_doubt import LOOKS, GripperDoubt
from tests.unit.grasp.builders import MOVING, gripper

MS = 1_000_000
TICK = 10 * MS


def doubted(states: list[GripperState], **settings: Any) -> str:
    doubt = GripperDoubt(DoubtSettings(**settings))
    said = [doubt.see(state) for state in states]
    assert not any(said[:-1])
    return said[-1].partition(":")[0]


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_echo_s(value: float) -> None:
    def after(s: float) -> str:
        looks = [round(i * s / LOOKS * 1e9) for i in range(1, LOOKS + 1)]
        return doubted([gripper(0), *(gripper(ns, fresh=False) for ns in looks)], echo_s=value)

    assert (after(value - 1e-6), after(value + 1e-6)) == ("", "gripper_silent")


def test_hand_is_not_silent_because_the_loop_is_slow() -> None:
    """Few looks, each a long step after the last, say nothing of a hand that needs two of them."""
    slow = [gripper(i * 120_000_000, fresh=i == 0) for i in range(6)]
    assert doubted(slow[:5]) == ""
    assert doubted(slow) == "gripper_silent"


def test_silence_and_stillness_last_longer_than_they_may_and_not_just_as_long() -> None:
    half = [gripper(round(i * 1e8), fresh=i == 0) for i in range(6)]
    assert doubted(half, echo_s=0.5) == ""
    assert doubted([moving(0.0, 55), moving(0.5, 55)], finger_start_s=0.5) == "gripper_stands"


def test_after_a_standstill_of_the_loop_looks_without_an_answer_are_counted_anew() -> None:
    doubt = GripperDoubt(DoubtSettings(echo_s=0.1))
    assert doubt.see(gripper(0)) == ""
    doubt.begin_anew(gripper(10**10))
    looks = [doubt.see(gripper(10**10 + i * 200_000_000, fresh=False)) for i in range(1, 6)]
    assert [look.partition(":")[0] for look in looks] == ["", "", "", "", "gripper_silent"]


def flickering(every: int, asked_anew: int = 1000) -> list[str]:
    """What is said of a hand that says by turns that it moves and that it stands."""
    doubt = GripperDoubt(DoubtSettings())
    told = []
    for tick in range(120):
        asked = 60 + tick // asked_anew % 2
        moves = bool(tick // every % 2)
        says = Detection.MOVING if moves else Detection.AT_TARGET
        at = (60 + tick % 2,) * 3
        seen = gripper(tick * TICK, at, (says,) * 3, requested=(asked,) * 3)
        told.append(doubt.see(seen).partition(":")[0])
    return told


@pytest.mark.parametrize("every", [2, 5, 10])
def test_hand_that_says_again_and_again_that_it_moves_and_stands_is_doubted(every: int) -> None:
    assert "gripper_flickers" in flickering(every)


@pytest.mark.parametrize(("command_every", "doubted"), [(1000, True), (8, False)])
def test_hand_whose_status_speaks_of_its_command_and_then_of_none_is_doubted(
    command_every: int, doubted: bool
) -> None:
    doubt, told = GripperDoubt(DoubtSettings()), []
    for tick in range(120):
        if tick % command_every == 0:
            doubt.told()
        told.append(doubt.see(gripper(tick * TICK, fresh=bool(tick // 4 % 2))))
    assert any(text.startswith("gripper_flickers") for text in told) is doubted


def test_hand_that_begins_and_ends_some_motions_or_is_told_anew_is_believed() -> None:
    assert set(flickering(13)) == {""}
    assert set(flickering(5, asked_anew=20)) == {""}


def test_hand_that_is_seen_moving_at_first_has_the_time_of_a_start() -> None:
    first = moving(100.0, 55)
    assert doubted([first]) == ""
    assert doubted([first, moving(100.19, 55)], finger_start_s=0.2) == ""
    assert doubted([first, moving(100.2, 55)], finger_start_s=0.2) == "gripper_stands"


def test_each_answer_begins_the_time_and_the_looks_anew() -> None:
    answers = (0, 4, 9)  # four looks between them at most
    looks = [gripper(i * 120_000_000, fresh=i in answers) for i in range(15)]
    assert doubted(looks[:14]) == ""
    assert doubted(looks) == "gripper_silent"
    often = [gripper(i * 10_000_000, fresh=i < 100) for i in range(110)]
    assert doubted(often, echo_s=0.2) == ""


def test_finger_that_begins_to_move_from_rest_has_the_time_of_a_start() -> None:
    resting = [gripper(0), gripper(TICK)]
    starting = [moving(0.02, 55), moving(0.15, 55)]
    assert doubted([*resting, *starting], stands_s=0.1, finger_start_s=0.3) == ""


def test_first_status_without_an_answer_is_none_of_the_looks() -> None:
    looks = [gripper(10**10 + i * 120_000_000, fresh=False) for i in range(6)]
    assert doubted(looks[:5]) == ""
    assert doubted(looks) == "gripper_silent"


@pytest.mark.parametrize(
    ("fault", "active", "said"),
    [(14, False, ""), (14, True, "gripper_silent"), (0, True, "gripper_silent")],
)
def test_a_hand_that_says_that_it_refuses_is_not_called_silent(
    fault: int, active: bool, said: str
) -> None:
    looks = [gripper(i * 120_000_000, fresh=i == 0, fault=fault) for i in range(6)]
    assert doubted([msgspec.structs.replace(look, active=active) for look in looks]) == said


def moving(t_s: float, position: int, asked: int = 90) -> GripperState:
    at_ns = round(t_s * 1e9)
    return gripper(at_ns, (position, 55, 55), MOVING, requested=(asked, 55, 55))


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_finger_start_s(value: float) -> None:
    def after(s: float, position: int = 55) -> str:
        return doubted([moving(0.0, 55), moving(s, position)], finger_start_s=value)

    assert (after(value - 1e-6), after(value + 1e-6)) == ("", "gripper_stands")
    assert after(value + 1e-6, position=56) == ""


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_stands_s(value: float) -> None:
    def after(s: float, asked: int = 90) -> str:
        states = [moving(0.0, 55), moving(0.01, 56), moving(0.01 + s, 56, asked)]
        return doubted(states, stands_s=value, finger_start_s=10.0)

    assert (after(value - 1e-6), after(value + 1e-6)) == ("", "gripper_stands")


def pressing(t_s: float, current_ma: int) -> GripperState:
    state = moving(t_s, 55)
    a = msgspec.structs.replace(state.fingers[0], current_ma=current_ma)
    return msgspec.structs.replace(state, fingers=(a, *state.fingers[1:]))


@pytest.mark.parametrize("value", [150, 400])
def test_pressing_ma(value: int) -> None:
    def stands(current_ma: int) -> str:
        return doubted([pressing(0.0, current_ma), pressing(1.0, current_ma)], pressing_ma=value)

    assert (stands(value - 1), stands(value)) == ("gripper_stands", "")


@pytest.mark.parametrize("value", [0.5, 1.5])
def test_pressing_s(value: float) -> None:
    """A finger at its force creeps after what gives way."""

    def after(s: float) -> str:
        return doubted([pressing(0.0, 310), pressing(s, 310)], pressing_s=value)

    assert (after(value - 1e-6), after(value + 1e-6)) == ("", "gripper_stands")


def test_finger_that_is_told_otherwise_on_its_way_has_the_time_of_a_start_again() -> None:
    turning = msgspec.structs.replace(moving(0.02, 57, 40), fresh=False)
    states = [moving(0.0, 55), moving(0.01, 56), turning, moving(0.2, 57, 40)]
    assert doubted(states, stands_s=0.1, finger_start_s=0.3) == ""
    assert doubted([*states, moving(0.33, 57, 40)], stands_s=0.1, finger_start_s=0.3)


def beside(asked: int, by: int, **settings: Any) -> str:
    """A finger that says 'at target' beside what it was asked for."""
    state = gripper(positions=(asked, 55, 55))
    a = msgspec.structs.replace(state.fingers[0], position_counts=asked + by)
    state = msgspec.structs.replace(state, fingers=(a, *state.fingers[1:]))
    return doubted([state], **settings)


@pytest.mark.parametrize("value", [3, 12])
def test_target_counts(value: int) -> None:
    assert beside(100, value, target_counts=value) == ""
    assert beside(100, value + 1, target_counts=value) == "gripper_impossible"
    assert beside(100, -value - 1, target_counts=value) == "gripper_impossible"


TOUCHING = (Detection.CONTACT_CLOSING, Detection.AT_TARGET, Detection.AT_TARGET)


def touching(t_s: float, position: int, fresh: bool = True) -> GripperState:
    asked = (90, 55, 55)
    return gripper(round(t_s * 1e9), (position, 55, 55), TOUCHING, fresh, requested=asked)


@pytest.mark.parametrize("value", [2, 6])
@pytest.mark.parametrize("way", [1, -1])
def test_contact_counts(value: int, way: int) -> None:
    def after(counts: int) -> str:
        steps = [touching(0.1 * k, 55 + way * k) for k in range(counts + 1)]
        return doubted(steps, contact_counts=value)

    assert (after(value), after(value + 1)) == ("", "gripper_impossible")


def test_finger_in_contact_may_move_after_another_request() -> None:
    states = [touching(0.0, 55), touching(0.1, 56, fresh=False), touching(0.2, 75)]
    assert doubted(states, contact_counts=2) == ""


@pytest.mark.parametrize("value", [10, 40])
def test_soft_low_counts(value: int) -> None:
    assert beside(value - 1, 50, soft_low_counts=value) == ""
    assert beside(value, 50, soft_low_counts=value) == "gripper_impossible"


@pytest.mark.parametrize("value", [180, 220])
def test_soft_high_counts(value: int) -> None:
    assert beside(value + 1, -50, soft_high_counts=value) == ""
    assert beside(value, -50, soft_high_counts=value) == "gripper_impossible"


@pytest.mark.parametrize("value", [200.0, 1000.0])
def test_finger_counts_ps(value: float) -> None:
    def leap(counts: int) -> str:
        states = [gripper(0), gripper(TICK, (55 + counts, 55, 55))]
        return doubted(states, finger_counts_ps=value, target_counts=5)

    most = 5 + round(value * 0.01)
    assert (leap(most), leap(most + 1)) == ("", "gripper_impossible")


@pytest.mark.parametrize("first_took_ns", [0, 200_000_000])
def test_a_late_status_tells_of_a_later_hand_and_a_leap_beyond_that_is_still_one(
    first_took_ns: int,
) -> None:
    def leap(counts: int, took_s: float) -> str:
        first, then = gripper(0), gripper(TICK, (55 + counts, 55, 55))
        states = [
            msgspec.structs.replace(first, took_ns=first_took_ns),
            msgspec.structs.replace(then, took_ns=round(took_s * 1e9)),
        ]
        return doubted(states, finger_counts_ps=300.0, target_counts=8)

    assert (leap(-14, 0.0), leap(-14, 0.09)) == ("gripper_impossible", "")
    assert (leap(38, 0.09), leap(39, 0.09)) == ("", "gripper_impossible")


def test_leap_is_one_however_long_the_run_has_lasted() -> None:
    at_ns = 10**12
    assert doubted([gripper(at_ns), gripper(at_ns + TICK, (200, 55, 55))]) == "gripper_impossible"


@pytest.mark.parametrize("position", [-1, 256])
def test_positions_that_no_motor_has_are_impossible(position: int) -> None:
    assert doubted([gripper(positions=(55, position, 55))]) == "gripper_impossible"
    there = min(max(position, 0), 255)
    assert doubted([gripper(positions=(55, there, 55))]) == ""


def test_a_hand_that_is_not_active_obeys_nothing_and_one_with_a_fault_has_its_own_text() -> None:
    lost = msgspec.structs.replace(gripper(), active=False)
    assert doubted([lost]) == "gripper_inactive"
    assert doubted([msgspec.structs.replace(lost, fault=14)]) == ""
