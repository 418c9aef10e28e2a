"""What an hour of lifts is judged by: made-up hours in which one thing was not as it must be."""

from typing import Any

import pytest
from msgspec.structs import replace

from scripts.soak import Lift, Soak, tell, wrong

HELD = Lift(1, "can", "", "held", "", "", "", 1_000, 2, 0, 10.2, 0.0, 0.0, 15.0)
STRUCK = replace(
    HELD, seed=2, struck="gripper_disconnect in hold", outcome="fault", kind="link_lost",
    message="gripper: connection closed", told="the hand holds by itself", begun_s=15.0,
    ended_s=30.0,
)  # fmt: skip
HOUR = Soak(60.0, True, [HELD, STRUCK], [], (3_000, 3), [100.0, 101.0, 102.0], [], 0)


def of(made: Lift, **changes: Any) -> Soak:
    other = [lift for lift in HOUR.lifts if lift.seed != made.seed]
    return replace(HOUR, lifts=[*other, replace(made, **changes)])


def test_an_hour_in_which_all_was_well_is_not_blamed() -> None:
    assert wrong(HOUR) == []
    assert tell(HOUR) == 0


@pytest.mark.parametrize("made", [HELD, STRUCK])
@pytest.mark.parametrize(
    "outcome",
    ["dropped", "expelled", "over_force", "", "not opened", "internal_error", "interrupted"],
)
def test_what_no_lift_may_end_as_is_told_struck_or_not(made: Lift, outcome: str) -> None:
    assert len(wrong(of(made, outcome=outcome))) == 1


@pytest.mark.parametrize("made", [HELD, STRUCK])
def test_a_true_force_past_limit_and_overshoot_is_told_whatever_the_outcome(made: Lift) -> None:
    assert any("13.0 N" in text for text in wrong(of(made, peak_n=13.0)))


def test_an_object_let_go_in_the_air_is_told_unless_the_hand_could_not_be_told_to_hold() -> None:
    assert wrong(of(HELD, let_go_m=0.05)) != []
    assert wrong(of(STRUCK, let_go_m=0.05)) == []
    assert wrong(of(STRUCK, let_go_m=0.05, told="the hand is closed")) != []
    arm = {"struck": "arm_freeze in hold", "message": "the arm is silent"}
    assert wrong(of(STRUCK, **arm)) == []
    assert wrong(of(STRUCK, let_go_m=0.05, **arm)) != []


def test_a_struck_lift_that_blames_another_device_is_told() -> None:
    assert wrong(of(STRUCK, message="arm: a protective stop")) != []


@pytest.mark.parametrize(
    ("kind", "message"),
    [("stale", "gripper status too old"), ("safety_stop", "loop_stood_still: for 0.4 s")],
)
def test_lateness_is_excused_only_while_the_idle_loop_missed_too(kind: str, message: str) -> None:
    late = of(HELD, outcome="fault", kind=kind, message=message)
    assert len(wrong(late)) == 1  # it missed three, long after
    assert wrong(replace(late, idle_late_s=[7.0])) == []


def test_a_fault_that_is_no_lateness_is_told_however_much_the_idle_loop_missed() -> None:
    failed = of(HELD, outcome="fault", kind="safety_stop", message="phase grasp lasted longer")
    assert len(wrong(replace(failed, idle_late_s=[7.0]))) == 1


@pytest.mark.parametrize("made", [HELD, STRUCK])
def test_periods_missed_far_beyond_those_of_the_idle_loop_are_told(made: Lift) -> None:
    assert len(wrong(of(made, periods=100, missed=900))) == 1


def test_a_row_that_the_page_was_not_told_is_told() -> None:
    assert len(wrong(replace(HOUR, lost_rows=5_000))) == 1


def test_what_is_wrong_makes_the_command_fail(capsys: pytest.CaptureFixture[str]) -> None:
    assert tell(replace(HOUR, lost_rows=1)) == 1
    assert "WRONG" in capsys.readouterr().out
