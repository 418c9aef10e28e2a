"""The safe state is commanded until it is reached, on the full loop, when commands are lost."""

from typing import Any

import msgspec
import pytest

from grasp.control.states import State
from scenarios.rigs.rig import Rig
from tests.unit.scenarios.conftest import Staged, in_phase
from tests.unit.scenarios.lift import device_faults as fault

IN_THE_AIR = [State.LIFT, State.DESCEND]


@pytest.mark.parametrize("end", [fault.silence_fingertips, fault.interrupt])
def test_stop_is_repeated_for_an_arm_that_always_reports_to_be_stationary(end: fault.Act) -> None:
    """The final state quotes the report instead of confirming it."""
    still = {"moving": False, "velocity_mps": (0.0, 0.0, 0.0)}

    def act(rig: Rig) -> None:
        fault.lose_stops(rig, 4)
        fault.cell(rig).arm.misreport(lambda sample: msgspec.structs.replace(sample, **still))
        end(rig)

    for phase in IN_THE_AIR:
        staged = Staged()
        trial = staged.run(in_phase(phase, 20), act)
        rig = staged.rig
        assert fault.cell(rig).arm.at(rig.clock.now_ns).velocity_mps == (0.0, 0.0, 0.0)
        assert any(found.code == "arm_wrong_way" for found in trial.controller.later_faults)
        left = trial.end(staged.config)
        assert left is not None
        assert left.arm == "the arm reports that it is stationary"


@pytest.mark.parametrize("latency_s", [0.0, 0.07])
def test_run_does_not_end_before_an_opening_with_a_lost_reply_is_complete(
    latency_s: float,
) -> None:
    staged = Staged(f"hand.command_latency_s={latency_s}", "controller.lift_height_m=0.05")

    def act(rig: Rig) -> None:
        transport = rig.devices.gripper._exchange._transport  # type: ignore[attr-defined]
        whole = transport.write

        def write(first: int, registers: Any, now_ns: int) -> None:
            whole(first, registers, now_ns)
            transport.write = whole
            fault.lost()

        transport.write = write

    trial = staged.run(in_phase(State.DESCEND, 5), act)  # the next write opens the hand
    assert trial.controller.machine.before is State.OPEN
    assert not fault.cell(staged.rig).gripper.moving
