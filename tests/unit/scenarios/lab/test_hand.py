"""Steps of the hand in whole counts, and refusals before a device is opened."""

import pytest

from drivers.errors import ConfigError, UsageError
from drivers.interfaces import Detection, FingerState, GripperState
from grasp.control.commands import MoveFingers
from scenarios.lab.arm import step_arm
from scenarios.lab.calibrate import check_force
from scenarios.lab.hand import (
    activate_hand,
    hand_guard,
    open_hand,
    step_counts,
)
from tests.unit.scenarios.conftest import config

LAB = config("gripper.calibration=paper")


def test_step_is_rounded_down_to_whole_counts() -> None:
    assert [step_counts(LAB, mm * 1e-3) for mm in (0.77, 1.5, 2.0, 5.0)] == [1, 1, 2, 6]


@pytest.mark.parametrize("mm", [0.0, 0.5, 5.1, -1.0])
def test_step_below_one_count_or_above_5_mm_is_refused(mm: float) -> None:
    with pytest.raises(UsageError, match="a step of"):
        step_counts(LAB, mm * 1e-3)


@pytest.mark.parametrize("up_to_n", [14.9, 61.0])
def test_allowed_force_must_be_within_the_range_of_the_hand(up_to_n: float) -> None:
    with pytest.raises(UsageError):
        check_force(up_to_n)


def test_closing_is_refused_where_a_run_would_be_refused() -> None:
    with pytest.raises(ConfigError, match="cannot close with less than 15 N"):
        hand_guard(config("gripper.calibration=manual"))
    with pytest.raises(ConfigError, match="exceeds the force limit by more"):
        hand_guard(config("controller.grip_speed_mps=0.1"))


def test_closing_speed_around_an_unknown_object_is_that_of_a_stiff_contact() -> None:
    guard = hand_guard(config("object.contact_stiffness_npm=700"))
    finger = FingerState(6, 6, 0, Detection.AT_TARGET)
    state = GripperState(0, 1, True, 0, "", True, (finger, finger, finger))
    admitted = guard.admit(MoveFingers((30, 6, 6), 0.11, 60.0), state, (0.0, 0.0, 0.0))
    assert admitted == MoveFingers((30, 6, 6), guard.closing_speed_mps, 10.0)


def test_library_functions_move_nothing_without_a_permit() -> None:
    def say(text: str) -> None:
        raise AssertionError(text)

    for call in (
        lambda: open_hand(LAB, None, closing=False).__enter__(),
        lambda: activate_hand(LAB, None, say),
        lambda: step_arm(LAB, None, (0.0, 0.0, 0.001), say),
    ):
        with pytest.raises(UsageError, match="may not open the rig hardware"):
            call()
