"""The safe state is commanded until it is reached, on the full loop, when commands are lost."""

from typing import Any

import msgspec
import pytest

from grasp.control.commands import CloseToLimit, StopArm
from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.rigs.rig import Rig
from tests.unit.scenarios.conftest import Staged, in_phase
from tests.unit.scenarios.lift import device_faults as fault
from tests.unit.scenarios.lift.test_monitors import thumb_n

IN_THE_AIR = [State.LIFT, State.DESCEND]


@pytest.mark.parametrize("phase", IN_THE_AIR)
def test_stop_is_repeated_until_the_arm_is_stationary(phase: State) -> None:
    for lost in (1, 4):
        staged, received = Staged(), list[list[int]]()

        def act(rig: Rig, lost: int = lost, received: list[list[int]] = received) -> None:
            received.append(fault.lose_stops(rig, lost))
            fault.silence_fingertips(rig)

        trial = staged.run(in_phase(phase, 5), act)
        assert trial.controller.state is State.FAULT
        later = trial.controller.later_faults
        assert all(found.code == "arm_wrong_way" for found in later)
        assert not later or lost > 1  # it moved for longer than braking takes
        unknown = "the arm's data are implausible: whether it has stopped is unknown"
        assert trial.controller.unconfirmed == ((unknown,) if later else ())
        assert received[0]
        sent = [i for t in staged.ticks for i in t.issued if isinstance(i.admitted, StopArm)]
        assert len(sent) > lost
        rig = staged.rig
        assert fault.cell(rig).arm.at(rig.clock.now_ns).velocity_mps == (0.0, 0.0, 0.0)


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


def closed_again(staged: Staged, trial: Any) -> None:
    assert trial.controller.state is State.FAULT
    assert thumb_n(staged) > 8.0  # not left at 2.4 N
    assert max(fault.cell(staged.rig).truth().peak_n) < 11.0
    assert trial.controller.unconfirmed == ()


def test_hand_is_closed_after_a_link_failure_at_the_time_of_the_fault() -> None:
    for phase, ms in ((State.LIFT, 30), (State.LIFT, 300), (State.COMPENSATE, 80)):
        staged = Staged()

        def act(rig: Rig, ms: int = ms) -> None:
            until_ns = rig.clock.now_ns + ms * 1_000_000
            whole = rig.devices.gripper.poll

            def poll(now_ns: int) -> None:
                fault.lost() if now_ns < until_ns else whole(now_ns)

            rig.devices.gripper.poll = poll  # type: ignore[method-assign]
            fault.silence_fingertips(rig)

        closed_again(staged, staged.run(in_phase(phase, 1), act))


def test_lost_closing_is_commanded_again() -> None:
    for ms in (100, 500, 1500):
        staged = Staged()

        def act(rig: Rig, staged: Staged = staged, ms: int = ms) -> None:
            fault.swallow_writes(rig)
            fault.silence_fingertips(rig)

            def recover(tick: Tick) -> None:
                late = tick.t_ns - (staged.done_at_ns or 0) > ms * 1_000_000
                fault.cell(rig).gripper.ignores_writes = not late

            staged.on_tick = recover

        closed_again(staged, staged.run(in_phase(State.LIFT, 2), act))
        closes = [i for t in staged.ticks for i in t.issued if isinstance(i.admitted, CloseToLimit)]
        assert len(closes) > 1


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
