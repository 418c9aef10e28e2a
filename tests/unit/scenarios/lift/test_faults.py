"""Faults at every phase: the arm stops, the hand does what is safe there, nothing is dropped."""

import pytest

from drivers.errors import LinkLost
from grasp.commands import CloseFast, HoldFingers, MoveArm, StopArm
from grasp.phases import Phase
from scenarios.rigs.rig import Rig
from scenarios.trial.execution import FinishedTrial
from tests.unit.scenarios.conftest import Staged, by_default, in_phase, well_in

CONTACT = [Phase.LIFT, Phase.COMPENSATE, Phase.HOLD]


def unplug_fingertips(rig: Rig) -> None:
    assert rig.cell is not None
    rig.cell.board.unplug()


def trip_arm(rig: Rig) -> None:
    assert rig.cell is not None
    rig.cell.arm.trip(rig.clock.now_ns)


def fault_gripper(rig: Rig) -> None:
    assert rig.cell is not None
    rig.cell.gripper.inject_fault(0x0E)


def silence_fingertips(rig: Rig) -> None:
    assert rig.cell is not None
    rig.cell.board.time_out(10_000)


def cut_gripper(rig: Rig) -> None:
    def lost(*_: object) -> None:
        raise LinkLost("gripper: no answer", "check cable, power and address")

    rig.devices.gripper.pump = lost  # type: ignore[method-assign]


FAULTS = [unplug_fingertips, trip_arm, fault_gripper, silence_fingertips, cut_gripper]


def sent_after(staged: Staged) -> list[object]:
    assert staged.done_at_ns is not None
    return [c.admitted for t in staged.ticks for c in t.issued if c.decided_ns >= staged.done_at_ns]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f.__name__)
@pytest.mark.parametrize("phase", [Phase.APPROACH, Phase.REST, Phase.GRASP, Phase.LISTEN, *CONTACT])
def test_every_fault_in_every_phase_ends_in_its_safe_state(phase: Phase, fault: object) -> None:
    staged = Staged(made=by_default)
    trial = staged.run(well_in(phase), fault)  # type: ignore[arg-type]
    assert trial.controller.phase is Phase.FAULT
    assert trial.controller.fault_cause
    commands = sent_after(staged)
    assert any(isinstance(c, StopArm) for c in commands)
    assert not any(isinstance(c, MoveArm) for c in commands)
    arm = staged.ticks[-1].arm
    assert not arm.moving
    assert staged.result(trial).outcome == "fault"
    _check_hand(phase, fault, commands, trial, staged)


def _check_hand(
    phase: Phase, fault: object, commands: list[object], trial: FinishedTrial, staged: Staged
) -> None:
    if fault is cut_gripper:
        assert not any(isinstance(c, CloseFast | HoldFingers) for c in commands)
    elif phase in CONTACT:
        assert any(isinstance(c, CloseFast) for c in commands)
    else:
        assert not any(isinstance(c, CloseFast) for c in commands)
        assert any(isinstance(c, HoldFingers) for c in commands)
    truth = staged.rig.truth()
    assert truth is not None
    assert max(truth.peak_n) < 11.0
    if phase is Phase.HOLD:  # held before, and held still
        assert truth.touched
        assert truth.height_m > 0.005
        assert abs(truth.slip_speed_mps) < 1e-3


def test_object_that_was_slipping_is_caught_by_the_safe_state() -> None:
    staged = Staged("rule.threshold=0.9999999", made=by_default)  # nobody listens, the can slips
    staged.run(in_phase(Phase.LIFT, 60), silence_fingertips)
    truth = staged.rig.truth()
    assert truth is not None
    assert truth.normal_n[0] > 8.0
    assert abs(truth.slip_speed_mps) < 1e-3


def test_a_single_lost_sample_is_repeated_counted_and_survived() -> None:
    staged = Staged("tactile.conversion_ms=7.0", made=by_default)  # not two frames a period

    def lose_one(rig: Rig) -> None:
        assert rig.cell is not None
        rig.cell.board.shorten_frame(4)

    trial = staged.run(in_phase(Phase.LIFT, 2), lose_one)
    assert staged.result(trial).success
    assert trial.loop.timing.repeated_frames == 1
    assert trial.loop.timing.missed_periods == 0


def test_interrupting_stops_the_arm_and_keeps_the_grip() -> None:
    staged = Staged(made=by_default)

    def interrupt(rig: Rig) -> None:
        raise KeyboardInterrupt

    trial = staged.run(in_phase(Phase.HOLD, 5), interrupt)
    assert trial.interrupted
    rig = staged.rig
    before = rig.truth()
    rig.clock.sleep_until_ns(rig.clock.now_ns + 2_000_000_000)
    after = rig.truth()
    assert before is not None
    assert after is not None
    assert after.normal_n[0] > 8.0
    assert rig.cell is not None
    assert rig.cell.arm.velocity(rig.clock.now_ns) == (0.0, 0.0, 0.0)


def test_interrupting_before_contact_stops_the_fingers() -> None:
    staged = Staged(made=by_default)

    def interrupt(rig: Rig) -> None:
        raise KeyboardInterrupt

    staged.run(in_phase(Phase.APPROACH, 8), interrupt)
    rig = staged.rig
    assert rig.cell is not None
    rig.clock.sleep_until_ns(rig.clock.now_ns + 1_000_000_000)
    stopped = rig.cell.gripper.travel_m
    rig.clock.sleep_until_ns(rig.clock.now_ns + 1_000_000_000)
    assert (rig.cell.gripper.travel_m == stopped).all()
    assert stopped.max() < 0.9 * 40 * 0.00077


def test_loaded_fingertip_is_refused_before_the_grasp() -> None:
    staged = Staged(
        "controller.preshape_margin_counts=2", "controller.thumb_back_counts=0",
        "object.half_width_m=0.039", made=by_default,
    )  # fmt: skip
    trial = staged.run(lambda tick: False, lambda rig: None)
    assert trial.controller.phase is Phase.FAULT
    assert "taxel" in trial.controller.fault_cause
    assert [c.phase for c in trial.controller.machine.log] == ["approach", "rest", "fault"]
