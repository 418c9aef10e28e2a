"""All plausibility checks together: the states in which they apply, and report mode."""

import math

import msgspec
import numpy as np
import pytest

from drivers.errors import LinkLost
from drivers.interfaces import Detection
from grasp.control.commands import Command, HoldFingers, MoveArm
from grasp.control.fault import ARM, GRIPPER, Fault
from grasp.control.monitors.checks import (
    CHECKS,
    Monitors,
    failed,
    implausible,
    invalid_probabilities,
)
from grasp.control.monitors.settings import MonitorSettings
from grasp.control.observation import StepInput
from grasp.control.states import CONTACT_STATES, SAFE_STATES, State
from tests.unit.grasp.builders import arm, codes, frame_of, gripper

TICK = 10_000_000
REST = (Detection.AT_TARGET,) * 3


def inputs(t_ns: int = 0, **changes: object) -> StepInput:
    values: dict[str, object] = {
        "t_ns": t_ns, "frame": frame_of(codes(t_ns // TICK)), "rest_taken": True,
        "gripper": gripper(t_ns), "arm": arm(t_ns), **changes,
    }  # fmt: skip
    return StepInput(**values)  # type: ignore[arg-type]


def found(phase: State, *states: StepInput, **settings: float) -> list[str]:
    """Codes of the checks that fail at the last of these steps."""
    monitors = Monitors(MonitorSettings(**settings))  # type: ignore[arg-type]
    return [[fault.code for fault in monitors.check(phase, each)] for each in states][-1]


def test_detector_and_loop_are_late_beyond_their_limits() -> None:
    for value in (0.05, 0.4):
        for s, late in ((value - 1e-6, False), (value + 1e-6, True)):
            ns = round(s * 1e9)
            took = found(State.LIFT, inputs(took_ns=ns), detector_s=value)
            slept = found(State.SHAPE, inputs(late_ns=ns), standstill_s=value)
            assert (took, slept) == (["detector_late"] * late, ["loop_stood_still"] * late)
    assert found(State.START, inputs(late_ns=10**10)) == []  # a run begins when it begins
    for phase in SAFE_STATES:
        assert found(phase, inputs(late_ns=10**10)) == ["loop_stood_still"]


def test_a_late_step_states_its_duration_and_a_remedy() -> None:
    limits = MonitorSettings(detector_s=0.4, standstill_s=0.2)
    given = inputs(took_ns=1_234_567_890, late_ns=345_678_901)
    late, stood = Monitors(limits).check(State.LIFT, given)
    assert (late.message, late.data) == ("a step took 1.235 s", {"seconds": 1.235})
    assert (stood.message, stood.data) == (
        "the control step began 0.346 s late", {"seconds": 0.346}
    )  # fmt: skip
    assert late.remedy.startswith("choose another detector")
    on_time = inputs(took_ns=400_000_000, late_ns=200_000_000)
    assert Monitors(limits).check(State.LIFT, on_time) == ()


def test_after_a_standstill_of_the_loop_only_vital_checks_continue() -> None:
    monitors = Monitors(MonitorSettings())

    def at(t_ns: int, late_ns: int = 0, **changes: object) -> list[str]:
        given = inputs(t_ns, late_ns=late_ns, **changes)
        return [fault.code for fault in monitors.check(State.LIFT, given)]

    assert at(0) == []
    monitors.sent((MoveArm((0.3, 0.2, 0.6), 0.1, 0.5),), arm(0, moving=True))
    assert at(10**10, late_ns=10**10 - TICK) == ["loop_stood_still"]
    assert at(2 * 10**10) == []
    assert at(3 * 10**10, frame=None) == ["fingertips_absent"]


def test_all_failed_checks_are_reported() -> None:
    lost = msgspec.structs.replace(gripper(), active=False)
    nan = msgspec.structs.replace(arm(), position_m=(math.nan,) * 3)
    assert found(State.LIFT, inputs(frame=None, gripper=lost, arm=nan)) == [
        "arm_position_nan", "gripper_inactive", "fingertips_absent",
    ]  # fmt: skip


def test_a_missing_frame_is_a_fault_only_in_contact_states() -> None:
    assert {p for p in State if found(p, inputs(frame=None))} == CONTACT_STATES


@pytest.mark.parametrize(
    ("commands", "says"),
    [((HoldFingers(), MoveArm((0.3, 0.2, 0.6), 0.1, 0.5)), ["arm_frozen"]), ((HoldFingers(),), [])],
)
def test_the_arm_is_checked_against_the_commands_of_the_step(
    commands: tuple[Command, ...], says: list[str]
) -> None:
    monitors = Monitors(MonitorSettings())
    assert monitors.check(State.START, inputs()) == ()
    monitors.sent(commands, arm())
    assert [f.code for f in monitors.check(State.START, inputs(10**9))] == says


@pytest.mark.parametrize("pressed_before", [False, True])
def test_contact_without_pressure_is_implausible_unless_the_object_was_lost(
    pressed_before: bool,
) -> None:
    """A hand that has closed on an object keeps reporting contact once the object is gone."""
    latched = (Detection.CONTACT_CLOSING, *REST[1:])
    steps = [
        inputs(
            TICK * k, gripper=gripper(TICK * k, detections=latched),
            frame=frame_of(codes(k) + np.int16(0 if pressed_before and k == 0 else 50)),
        )
        for k in range(32)
    ]  # fmt: skip
    assert found(State.CLOSE, *steps[:30], jump_counts=100) == []
    expected = [] if pressed_before else ["fingertips_unpressed"]
    assert found(State.CLOSE, *steps, jump_counts=100) == expected


@pytest.mark.parametrize(("other", "swapped"), [(139, []), (141, ["fingertips_swapped"])])
def test_fingertips_are_swapped_beyond_a_ratio_in_a_strong_grip(
    other: int, swapped: list[str]
) -> None:
    for share, strong in ((1.0, True), (0.5, False)):
        raw = 450 - np.array([[100], [other], [60]]) * np.ones(6) * share
        frames = (raw + k % 2 for k in range(10))
        steps = [inputs(frame=frame_of(np.rint(each).astype(np.int16))) for each in frames]
        assert found(State.LIFT, *steps[:9]) == []
        assert found(State.LIFT, *steps) == (swapped if strong else [])


def test_report_mode_ends_a_run_only_for_vital_checks() -> None:
    stop, report = (Monitors(MonitorSettings(mode=mode)) for mode in ("stop", "report"))
    lost = Fault.of(ARM, LinkLost("unplugged", "plug it in"))
    stale = Fault("stale", GRIPPER, "too old", kind="stale")
    values = {"finger": "A", "how": "x", "seconds": 1.0, "mm": 1.0, "counts": 1.0, "samples": 1.0}
    faults = [failed(code, **values) for code in CHECKS]
    ends = {fault.code for fault in [*faults, lost, stale] if stop.stops(fault)}
    assert ends == {*CHECKS, lost.code, stale.code} - {"fingertips_swapped"}
    assert report.stops(lost) and report.stops(stale)
    assert {fault.code for fault in faults if report.stops(fault)} == {
        "loop_stood_still", "detector_late", "detector_failed", "arm_position_nan",
        "gripper_inactive", "fingertips_absent", "fingertips_slow",
    }  # fmt: skip


def test_data_of_an_inactive_hand_are_plausible_and_of_a_jumping_one_not() -> None:
    assert not implausible([failed("gripper_inactive")], GRIPPER)
    jumped = failed("gripper_impossible", finger="A", how="jumped")
    assert implausible([failed("gripper_inactive"), jumped], GRIPPER)
    assert not implausible([jumped], ARM)


@pytest.mark.parametrize(
    "output", [np.array([0.0, np.nan, 0.0]), np.array([np.inf] * 3), np.zeros(4), 0.5, None,
               np.array([-0.1, 0.0, 0.0]), np.array([None] * 3), np.array(["0.1"] * 3),
               np.array([0.1j] * 3)],
)  # fmt: skip
def test_output_other_than_one_probability_a_finger_is_refused(output: object) -> None:
    fault = invalid_probabilities(output)
    assert fault is not None and fault.code == "detector_failed"


@pytest.mark.parametrize("finger", range(3))
def test_probabilities_are_accepted_up_to_their_ends(finger: int) -> None:
    for value, accepted in ((0.0, True), (1.0, True), (-1e-9, False), (1.0 + 1e-9, False)):
        output = np.full(3, 0.5)
        output[finger] = value
        assert (invalid_probabilities(output) is None) == accepted
