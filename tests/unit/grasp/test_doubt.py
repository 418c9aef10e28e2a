"""Doubts of detector and loop, and of all together, as a pure unit."""

import math

import msgspec
import numpy as np
import pytest

from grasp.commands import MoveArm
from grasp.doubt import Doubts, wrong_probabilities
from grasp.doubt_settings import DoubtSettings
from grasp.gripper_doubt import LOOKS
from grasp.states import SAFE_STATES, State
from tests.unit.grasp.builders import MOVING, arm, codes, frame_of, gripper

MS = 1_000_000
TICK = 10 * MS


def of(phase: State, settings: DoubtSettings, **told: int) -> str:
    return Doubts(settings).of(phase, frame_of(codes(0)), gripper(), arm(), **told)


@pytest.mark.parametrize("value", [0.05, 0.4])
def test_detector_s(value: float) -> None:
    settings = DoubtSettings(detector_s=value)
    assert of(State.LIFT, settings, took_ns=round((value - 1e-6) * 1e9)) == ""
    late = of(State.LIFT, settings, took_ns=round((value + 1e-6) * 1e9))
    assert late.startswith("detector_late: ")


@pytest.mark.parametrize("value", [0.05, 0.4])
def test_standstill_s(value: float) -> None:
    settings = DoubtSettings(standstill_s=value)
    assert of(State.SHAPE, settings, late_ns=round((value - 1e-6) * 1e9)) == ""
    late = of(State.SHAPE, settings, late_ns=round((value + 1e-6) * 1e9))
    assert late.startswith("loop_stood_still: ")
    assert of(State.START, settings, late_ns=10**10) == ""  # a run begins when it begins


def test_after_a_standstill_of_the_loop_no_device_is_blamed_for_the_time_that_nobody_saw() -> None:
    doubts, s = Doubts(DoubtSettings()), DoubtSettings()
    there = (0.3, 0.2, 0.6)
    unheard = [gripper(t, detections=MOVING, fresh=False) for t in (0, 10**10, 10**10 + TICK)]
    rising = [arm(t, moving=True) for t in (0, 10**10, 10**10 + TICK)]
    sees = [frame_of(codes(k)) for k in range(3)]
    assert doubts.of(State.LIFT, sees[0], unheard[0], rising[0]) == ""
    doubts.sent((MoveArm(there, 0.1, 0.5),), rising[0])
    slept = doubts.of(State.LIFT, sees[1], unheard[1], rising[1], late_ns=10**10 - TICK)
    assert slept == "loop_stood_still: for 9.990 s nobody was in control"
    assert doubts.of(State.FAULT, sees[2], unheard[2], rising[2]) == ""
    later_ns = 10**10 + round(max(s.echo_s, s.arm_start_s, s.arm_frozen_s) * 1e9) + 10**9
    for t_ns in range(later_ns, later_ns + LOOKS * TICK, TICK):
        hand = gripper(t_ns, detections=MOVING, fresh=False)
        blamed = doubts.of(State.FAULT, sees[0], hand, arm(t_ns, moving=True))
    assert "arm_frozen" in blamed and "gripper_silent" in blamed


@pytest.mark.parametrize("phase", sorted(SAFE_STATES))
def test_devices_are_doubted_in_a_safe_state_too(phase: State) -> None:
    assert of(phase, DoubtSettings(), late_ns=10**10).startswith("loop_stood_still: ")


def test_all_that_is_wrong_is_told() -> None:
    doubts = Doubts(DoubtSettings())
    lost = msgspec.structs.replace(gripper(), active=False)
    nan = msgspec.structs.replace(arm(), position_m=(math.nan,) * 3)
    said = doubts.of(State.LIFT, None, lost, nan)
    names = [part.partition(":")[0] for part in said.split("; ")]
    assert names == ["arm_position_nan", "gripper_inactive", "fingertips_absent"]


@pytest.mark.parametrize(
    "answer", [np.array([0.0, np.nan, 0.0]), np.array([np.inf] * 3), np.zeros(4), 0.5, None,
               np.array([-0.1, 0.0, 0.0]), np.array([None] * 3), np.array(["0.1"] * 3),
               np.array([0.1j] * 3)],
)  # fmt: skip
def test_an_answer_that_is_no_probability_a_finger_is_refused(answer: object) -> None:
    assert wrong_probabilities(answer).startswith("detector_failed: ")


def test_probabilities_are_accepted_up_to_their_ends() -> None:
    assert wrong_probabilities(np.array([0.0, 0.5, 1.0])) == ""
