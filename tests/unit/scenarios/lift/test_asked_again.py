"""A safe state is asked for until it is seen, on the full loop: a stop or closing that is lost."""

from typing import Any

import msgspec
import pytest

from drivers.errors import LinkLost
from grasp.commands import CloseFast, StopArm
from grasp.loop import Tick
from grasp.phases import Phase
from scenarios.rigs.rig import Rig
from tests.unit.scenarios.conftest import Staged, in_phase
from tests.unit.scenarios.lift import device_faults as fault
from tests.unit.scenarios.lift.test_faults import silence_fingertips

IN_THE_AIR = [Phase.LIFT, Phase.LOWER]


def lose_stops(rig: Rig, times: int) -> list[int]:
    """The arm's controller never hears so many stops; gives when it heard one."""
    arm, left, heard = fault.cell(rig).arm, [times], list[int]()
    whole = arm.stop_l

    def stop_l(deceleration_mps2: float, now_ns: int) -> None:
        if left[0] > 0:
            left[0] -= 1
            return
        heard.append(now_ns)
        whole(deceleration_mps2, now_ns)

    arm.stop_l = stop_l  # type: ignore[method-assign]
    return heard


@pytest.mark.parametrize("phase", IN_THE_AIR)
@pytest.mark.parametrize("lost", [1, 4])
def test_arm_whose_stops_are_lost_is_told_again_until_it_stands(phase: Phase, lost: int) -> None:
    staged, heard = Staged(), list[list[int]]()

    def act(rig: Rig) -> None:
        heard.append(lose_stops(rig, lost))
        silence_fingertips(rig)

    trial = staged.run(in_phase(phase, 5), act)
    assert trial.controller.phase is Phase.FAULT
    further = trial.controller.further
    assert all(doubt.startswith("arm_goes_on") for doubt in further)
    assert not further or lost > 1  # it has gone on for longer than braking takes
    unknown = "the arm cannot be believed: whether it stands is unknown"
    assert trial.controller.unreached == ((unknown,) if further else ())
    assert heard[0]
    sent = [i for t in staged.ticks for i in t.issued if isinstance(i.admitted, StopArm)]
    assert len(sent) > lost
    rig = staged.rig
    assert fault.cell(rig).arm.velocity(rig.clock.now_ns) == (0.0, 0.0, 0.0)


def test_arm_that_hears_no_stop_is_said_to_go_on() -> None:
    staged = Staged()

    def act(rig: Rig) -> None:
        lose_stops(rig, 10_000)
        silence_fingertips(rig)

    trial = staged.run(in_phase(Phase.LOWER, 5), act)
    end = trial.end(staged.config)
    assert end is not None
    moving = fault.cell(staged.rig).arm.moving(staged.rig.clock.now_ns)
    assert end.further[0].startswith("arm_goes_on")
    assert moving == ("is still moving" in end.arm)


def deny_motion(rig: Rig) -> None:
    """Whatever the arm does, it says that it stands."""
    still = {"moving": False, "velocity_mps": (0.0, 0.0, 0.0)}
    fault.cell(rig).arm.misreport(lambda sample: msgspec.structs.replace(sample, **still))


@pytest.mark.parametrize("end", [silence_fingertips, None], ids=["fault", "a person"])
@pytest.mark.parametrize("phase", IN_THE_AIR)
def test_arm_that_denies_its_motion_is_told_again_and_not_said_to_stand(
    phase: Phase, end: Any
) -> None:
    staged = Staged()

    def act(rig: Rig) -> None:
        lose_stops(rig, 4)
        deny_motion(rig)
        if end is None:
            raise KeyboardInterrupt
        end(rig)

    trial = staged.run(in_phase(phase, 20), act)
    rig = staged.rig
    assert fault.cell(rig).arm.velocity(rig.clock.now_ns) == (0.0, 0.0, 0.0)
    assert any(doubt.startswith("arm_goes_on: ") for doubt in trial.controller.further)
    left = trial.end(staged.config)
    assert left is not None
    assert left.arm == "the arm says that it stands"


def closed_again(staged: Staged, trial: Any) -> None:
    assert trial.controller.phase is Phase.FAULT
    truth = staged.rig.truth()
    assert truth is not None
    assert truth.normal_n[0] > 8.0  # not left at 2.4 N
    assert max(truth.peak_n) < 11.0
    assert trial.controller.unreached == ()


@pytest.mark.parametrize("phase", [Phase.LIFT, Phase.COMPENSATE])
@pytest.mark.parametrize("ms", [30, 80, 300])
def test_hand_whose_link_blinks_at_the_fault_is_closed_when_it_is_back(
    phase: Phase, ms: int
) -> None:
    staged = Staged()

    def act(rig: Rig) -> None:
        until_ns = rig.clock.now_ns + ms * 1_000_000
        whole = rig.devices.gripper.pump

        def pump(now_ns: int) -> None:
            if now_ns < until_ns:
                raise LinkLost("gripper: no answer", "check cable, power and address")
            whole(now_ns)

        rig.devices.gripper.pump = pump  # type: ignore[method-assign]
        silence_fingertips(rig)

    closed_again(staged, staged.run(in_phase(phase, 1), act))


@pytest.mark.parametrize("ms", [100, 500, 1500])
def test_hand_that_loses_the_closing_itself_is_told_again(ms: int) -> None:
    staged, began = Staged(), list[int]()
    met = in_phase(Phase.LIFT, 2)

    def when(tick: Tick) -> bool:
        if not began and met(tick):
            began.append(tick.t_ns)
            fault.swallow_writes(staged.rig)
            silence_fingertips(staged.rig)
        return bool(began) and tick.t_ns - began[0] > ms * 1_000_000

    def hear(rig: Rig) -> None:
        fault.cell(rig).gripper.swallows = False

    closed_again(staged, staged.run(when, hear))
    closes = [i for t in staged.ticks for i in t.issued if isinstance(i.admitted, CloseFast)]
    assert len(closes) > 1


@pytest.mark.parametrize("latency_s", [0.0, 0.03, 0.07])
def test_run_has_not_ended_while_an_opening_whose_reply_was_lost_still_sets_the_hand_going(
    latency_s: float,
) -> None:
    staged = Staged(f"hand.command_latency_s={latency_s}", "controller.lift_height_m=0.05")

    def act(rig: Rig) -> None:
        transport = rig.devices.gripper._exchange._transport  # type: ignore[attr-defined]
        whole = transport.write

        def write(first: int, registers: Any, now_ns: int) -> None:
            whole(first, registers, now_ns)
            transport.write = whole
            raise LinkLost("gripper: no answer", "check cable, power and address")

        transport.write = write

    trial = staged.run(in_phase(Phase.LOWER, 5), act)  # the next that is written opens the hand
    assert trial.controller.machine.before is Phase.RELEASE
    assert not fault.cell(staged.rig).gripper.moving
