"""Steps of the hand in whole counts, and what is refused before anything is opened."""

import pytest

from drivers.errors import ConfigError, UsageError
from drivers.interfaces import Detection, FingerState, GripperState
from grasp.commands import MoveFingers
from scenarios.lab.arm import step_arm
from scenarios.lab.calibrate import check_force
from scenarios.lab.hand import (
    activate_hand,
    guard_of,
    open_hand,
    step_counts,
)
from tests.unit.scenarios.conftest import config

LAB = config("gripper.calibration=paper")


def test_step_is_rounded_down_to_whole_counts() -> None:
    assert [step_counts(LAB, mm * 1e-3) for mm in (0.77, 1.5, 2.0, 5.0)] == [1, 1, 2, 6]


@pytest.mark.parametrize("mm", [0.0, 0.5, 5.1, -1.0])
def test_step_of_no_count_or_of_more_than_5_mm_is_refused(mm: float) -> None:
    with pytest.raises(UsageError, match="a step of"):
        step_counts(LAB, mm * 1e-3)


@pytest.mark.parametrize("up_to_n", [14.9, 61.0])
def test_a_hand_that_may_press_more_than_allowed_is_refused(up_to_n: float) -> None:
    with pytest.raises(UsageError):
        check_force(up_to_n)


def test_closing_is_refused_where_a_run_would_be() -> None:
    with pytest.raises(ConfigError, match="cannot close with less than 15 N"):
        guard_of(config("gripper.calibration=manual"))
    with pytest.raises(ConfigError, match="carries the fingertip further"):
        guard_of(config("controller.grip_speed_mps=0.1"))


def test_hand_around_nobody_knows_what_closes_no_faster_than_a_stiff_contact_allows() -> None:
    guard = guard_of(config("object.contact_stiffness_npm=700"))
    finger = FingerState(6, 6, 0, Detection.AT_TARGET)
    state = GripperState(0, 1, True, 0, "", True, (finger, finger, finger))
    admitted = guard.admit(MoveFingers((30, 6, 6), 0.11, 60.0), state, (0.0, 0.0, 0.0))
    assert admitted == MoveFingers((30, 6, 6), guard.closing_speed_mps, 10.0)


def test_library_call_without_a_permit_moves_nothing() -> None:
    def say(text: str) -> None:
        raise AssertionError(text)

    for call in (
        lambda: open_hand(LAB, None, closing=False).__enter__(),
        lambda: activate_hand(LAB, None, say),
        lambda: step_arm(LAB, None, (0.0, 0.0, 0.001), say),
    ):
        with pytest.raises(UsageError, match="may not open the rig hardware"):
            call()
