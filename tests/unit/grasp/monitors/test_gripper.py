"""Plausibility checks of the gripper: each limit takes effect at its value."""

from typing import Any

import msgspec
import pytest

from drivers.interfaces import Detection, GripperState
from grasp.control.commands import (
    CloseToLimit,
    GripperCommand,
    HoldFingers,
    MoveFingers,
    OpenFingers,
)
from grasp.control.monitors.gripper import (
    CONTACT_COUNTS,
    FINGER_COUNTS_PS,
    JUMP_COUNTS,
    OUTDATED_READS,
    PRESSING_MA,
    PRESSING_S,
    GripperHistory,
)
from grasp.control.monitors.settings import MonitorSettings
from tests.unit.grasp.builders import MOVING, gripper

MS = 1_000_000
TICK = 10 * MS


IMPOSSIBLE = "gripper_impossible"


def failed_at(states: list[GripperState], **settings: Any) -> str:
    """Codes that fail at the last state; asserts that none fails before."""
    history = GripperHistory(MonitorSettings(**settings))
    codes = [", ".join(history.update(state)) for state in states]
    assert not any(codes[:-1])
    return codes[-1]


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_echo_s(value: float) -> None:
    def after(s: float) -> str:
        reads = [round(i * s / OUTDATED_READS * 1e9) for i in range(1, OUTDATED_READS + 1)]
        return failed_at([gripper(0), *(gripper(ns, fresh=False) for ns in reads)], echo_s=value)

    assert (after(value - 1e-6), after(value + 1e-6)) == ("", "gripper_unconfirmed")


@pytest.mark.parametrize(
    ("command", "how"),
    [
        (MoveFingers((55, 194, 55), 0.1, 5.0), "target of finger B 55, expected 194"),
        (
            CloseToLimit(5.0, (True, True, False), (194, 50, 194), 0.1),
            "target of finger A 55, expected 194",
        ),
        (
            OpenFingers(0.1),
            "; ".join(f"target of finger {name} 55, expected 0" for name in "ABC"),
        ),
        (HoldFingers(), "targets (55, 55, 55) or rGTO are not as written"),
    ],
)
def test_the_targets_in_a_status_that_shows_no_command_are_reported(
    command: GripperCommand, how: str
) -> None:
    history = GripperHistory(MonitorSettings())
    history.sent(command)
    reads = [gripper(i * 40_000_000, fresh=i == 0) for i in range(6)]
    *_, last = [history.update(state) for state in reads]
    assert last == {"gripper_unconfirmed": {"seconds": 0.2, "how": how}}


def test_a_command_is_not_unconfirmed_because_the_loop_is_slow() -> None:
    """Few status reads far apart prove nothing about a hand that needs two of them."""
    slow = [gripper(i * 120_000_000, fresh=i == 0) for i in range(6)]
    assert failed_at(slow[:5]) == ""
    assert failed_at(slow) == "gripper_unconfirmed"


def test_limits_of_confirmation_and_standstill_are_exclusive() -> None:
    half = [gripper(round(i * 1e8), fresh=i == 0) for i in range(6)]
    assert failed_at(half, echo_s=0.5) == ""
    assert failed_at([moving(0.0, 55), moving(0.5, 55)], finger_start_s=0.5) == "gripper_stands"


def test_hand_that_moves_in_the_first_status_gets_the_start_time() -> None:
    first = moving(100.0, 55)
    assert failed_at([first]) == ""
    assert failed_at([first, moving(100.19, 55)], finger_start_s=0.2) == ""
    assert failed_at([first, moving(100.2, 55)], finger_start_s=0.2) == "gripper_stands"


def test_each_fresh_status_restarts_time_and_read_count() -> None:
    fresh_reads = (0, 4, 9)  # at most four status reads between them
    reads = [gripper(i * 120_000_000, fresh=i in fresh_reads) for i in range(15)]
    assert failed_at(reads[:14]) == ""
    assert failed_at(reads) == "gripper_unconfirmed"
    often = [gripper(i * 10_000_000, fresh=i < 100) for i in range(110)]
    assert failed_at(often, echo_s=0.2) == ""


def test_finger_that_starts_from_rest_gets_the_start_time() -> None:
    resting = [gripper(0), gripper(TICK)]
    starting = [moving(0.02, 55), moving(0.15, 55)]
    assert failed_at([*resting, *starting]) == ""


def test_first_outdated_status_is_not_counted() -> None:
    reads = [gripper(10**10 + i * 120_000_000, fresh=False) for i in range(6)]
    assert failed_at(reads[:5]) == ""
    assert failed_at(reads) == "gripper_unconfirmed"


@pytest.mark.parametrize(
    ("fault", "active", "codes"),
    [(14, False, ""), (14, True, "gripper_unconfirmed"), (0, True, "gripper_unconfirmed")],
)
def test_an_inactive_hand_with_a_fault_confirms_no_command(
    fault: int, active: bool, codes: str
) -> None:
    reads = [gripper(i * 120_000_000, fresh=i == 0, fault=fault) for i in range(6)]
    assert failed_at([msgspec.structs.replace(look, active=active) for look in reads]) == codes


def moving(t_s: float, position: int, asked: int = 90) -> GripperState:
    at_ns = round(t_s * 1e9)
    return gripper(at_ns, (position, 55, 55), MOVING, requested=(asked, 55, 55))


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_finger_start_s(value: float) -> None:
    def after(s: float, position: int = 55) -> str:
        return failed_at([moving(0.0, 55), moving(s, position)], finger_start_s=value)

    assert (after(value - 1e-6), after(value + 1e-6)) == ("", "gripper_stands")
    assert after(value + 1e-6, position=56) == ""


def pressing(t_s: float, current_ma: int) -> GripperState:
    state = moving(t_s, 55)
    a = msgspec.structs.replace(state.fingers[0], current_ma=current_ma)
    return msgspec.structs.replace(state, fingers=(a, *state.fingers[1:]))


def test_a_pressing_finger_may_keep_its_count_for_longer() -> None:
    def after(s: float, current_ma: int = PRESSING_MA) -> str:
        return failed_at([pressing(0.0, current_ma), pressing(s, current_ma)])

    assert after(1.0, PRESSING_MA - 1) == "gripper_stands"
    assert (after(PRESSING_S - 1e-6), after(PRESSING_S + 1e-6)) == ("", "gripper_stands")


TOUCHING = (Detection.CONTACT_CLOSING, Detection.AT_TARGET, Detection.AT_TARGET)


def touching(t_s: float, position: int, fresh: bool = True) -> GripperState:
    asked = (90, 55, 55)
    return gripper(round(t_s * 1e9), (position, 55, 55), TOUCHING, fresh, requested=asked)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_finger_in_contact_must_not_move(direction: int) -> None:
    def after(counts: int) -> str:
        return failed_at([touching(0.1 * k, 55 + direction * k) for k in range(counts + 1)])

    assert (after(CONTACT_COUNTS), after(CONTACT_COUNTS + 1)) == ("", IMPOSSIBLE)


def test_finger_in_contact_may_move_after_another_request() -> None:
    states = [touching(0.0, 55), touching(0.1, 56, fresh=False), touching(0.2, 75)]
    assert failed_at(states) == ""


def test_no_finger_is_faster_than_twice_full_speed() -> None:
    def jump(counts: int) -> str:
        return failed_at([gripper(0), gripper(TICK, (55 + counts, 55, 55))])

    most = JUMP_COUNTS + round(FINGER_COUNTS_PS * 0.01)
    assert (jump(most), jump(most + 1)) == ("", IMPOSSIBLE)


@pytest.mark.parametrize("first_took_ns", [0, 200_000_000])
def test_a_late_status_allows_more_motion_but_no_larger_jump(
    first_took_ns: int,
) -> None:
    def jump(counts: int, took_s: float) -> str:
        first, then = gripper(0), gripper(TICK, (55 + counts, 55, 55))
        states = [
            msgspec.structs.replace(first, took_ns=first_took_ns),
            msgspec.structs.replace(then, took_ns=round(took_s * 1e9)),
        ]
        return failed_at(states)

    assert (jump(-14, 0.0), jump(-14, 0.09)) == ("gripper_impossible", "")
    assert (jump(38, 0.09), jump(39, 0.09)) == ("", "gripper_impossible")


def test_a_jump_is_detected_at_any_time_of_a_run() -> None:
    at_ns = 10**12
    assert failed_at([gripper(at_ns), gripper(at_ns + TICK, (200, 55, 55))]) == "gripper_impossible"


def test_an_inactive_hand_is_a_fault_unless_it_reports_one_itself() -> None:
    lost = msgspec.structs.replace(gripper(), active=False)
    assert failed_at([lost]) == "gripper_inactive"
    assert failed_at([msgspec.structs.replace(lost, fault=14)]) == ""


def flickering(every: int, asked_every: int = 1000) -> set[str]:
    """Codes that fail for a hand that alternately reports motion and standstill."""
    history, found = GripperHistory(MonitorSettings()), set()
    for tick in range(120):
        says = Detection.MOVING if tick // every % 2 else Detection.AT_TARGET
        asked, at = (60 + tick // asked_every % 2,) * 3, (60 + tick % 2,) * 3
        failures = history.update(gripper(tick * TICK, at, (says,) * 3, requested=asked))
        found.add(", ".join(failures))
    return found


def test_alternating_motion_reports_are_detected_unless_commanded() -> None:
    for every in (2, 5, 10):
        assert "gripper_flickers" in flickering(every)
    assert flickering(13) == flickering(5, asked_every=20) == {""}
