"""The final state after a safe state is based on the last status messages only."""

import re
from collections.abc import Callable

import pytest

from drivers.errors import LinkLost
from grasp.control.states import State
from scenarios.rigs.rig import Rig
from scenarios.trial.execution import FinishedTrial
from scenarios.trial.final_state import (
    LOOK,
    FinalState,
    final_state,
)
from tests.unit.scenarios.conftest import Staged, in_phase
from tests.unit.scenarios.lift.device_faults import (
    cut_gripper,
    freeze_gripper_status,
    interrupt,
    make_finger_b_jump,
    silence_fingertips,
    trip_arm,
    zero_gripper_status,
)

QUICK = ("controller.lift_height_m=0.08", "hand.activation_s=0.5")


def cut_arm(rig: Rig) -> None:
    def lost(*_: object) -> None:
        raise LinkLost("link to the arm lost: it said nothing", "connect it again")

    rig.devices.arm.poll = lost  # type: ignore[method-assign]


def cut_everything(rig: Rig) -> None:
    cut_gripper(rig)
    cut_arm(rig)
    silence_fingertips(rig)


def ended(phase: State, act: Callable[[Rig], None]) -> tuple[FinishedTrial, Staged, FinalState]:
    staged = Staged(*QUICK)
    trial = staged.run(in_phase(phase, 5), act)
    end = trial.end(staged.config)
    assert end is not None
    return trial, staged, end


def test_interruption_keeps_the_grip_and_stops_the_arm() -> None:
    trial, staged, end = ended(State.LIFT, interrupt)
    assert end.arm == "the arm is stationary"
    assert end.hand.startswith("the hand is closed")
    assert "N measured at finger" in end.hand
    failure = trial.failure(staged.config)
    assert failure is not None
    assert failure.message == "stopped by hand in phase lift"
    assert re.fullmatch(r"in phase lift, [1-9]\d* mm above the grasp", end.where), end.where
    assert staged.result(trial).end == end == failure.end


@pytest.mark.parametrize(
    ("phase", "act"),
    [
        (State.DESCEND, freeze_gripper_status),
        (State.BRACE, make_finger_b_jump),
        (State.HOLD, zero_gripper_status),
    ],
)
def test_implausible_status_of_the_hand_is_reported_as_such(
    phase: State, act: Callable[[Rig], None]
) -> None:
    trial, _, end = ended(phase, act)
    assert trial.controller.faults[0].code.startswith("gripper_")
    assert end.hand.startswith(
        "the hand's status is implausible, and it may still move: it reports that it is "
    )
    assert not end.open


def test_every_lost_device_is_named() -> None:
    trial, staged, end = ended(State.LIFT, cut_everything)
    failure = trial.failure(staged.config)
    assert failure is not None
    for word in ("gripper: no answer", "link to the arm lost", "the tactile board"):
        assert word in failure.message
    assert "\n" not in failure.message
    assert end.arm.startswith("the arm was still moving at ")
    assert len(end.unconfirmed) == 2
    assert end.arm.endswith("at its last status")
    assert end.hand.startswith("the hand cannot be commanded and holds by itself")
    assert end.hand.endswith("its force is not measured")


def test_advice_is_to_look_at_an_arm_with_unknown_motion() -> None:
    for act, unknown in ((cut_arm, True), (cut_gripper, False), (trip_arm, False)):
        trial, _, _ = ended(State.HOLD, act)
        errors = tuple(trial.loop.errors.values())
        end = final_state(trial.trace.last, trial.trace.hand, 0.1, "type this", errors=errors)
        assert end.advice == (f"{LOOK}; type this" if unknown else "type this"), act
