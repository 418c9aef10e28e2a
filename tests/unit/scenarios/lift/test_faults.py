"""Faults in every phase: the arm stops, the hand acts as is safe there, nothing is dropped."""

import pytest

from grasp.control.commands import CloseToLimit, HoldFingers, MoveArm, StopArm
from grasp.control.fault import lines
from grasp.control.states import State
from tests.unit.scenarios.conftest import Staged, by_default, in_phase, well_in
from tests.unit.scenarios.lift import device_faults as fault
from tests.unit.scenarios.lift.test_monitors import issued_since, thumb_n

CONTACT = [State.LIFT, State.COMPENSATE, State.HOLD]
PHASES = [State.SHAPE, State.TARE, State.BRACE, State.BASELINE, *CONTACT]


@pytest.mark.parametrize("act", fault.LINKS, ids=lambda act: act.__name__)
def test_every_fault_in_every_phase_ends_in_its_safe_state(act: fault.Act) -> None:
    for phase in PHASES:
        staged = Staged(made=by_default)
        trial = staged.run(well_in(phase), act)
        assert trial.controller.state is State.FAULT, phase
        assert lines(trial.controller.faults), phase
        commands = issued_since(staged, staged.done_at_ns)
        assert any(isinstance(c, StopArm) for c in commands), phase
        assert not any(isinstance(c, MoveArm) for c in commands), phase
        assert not staged.ticks[-1].arm.moving, phase
        assert staged.result(trial).outcome == "fault", phase
        cut = act is fault.cut_gripper
        closes, holds = (
            any(isinstance(c, kind) for c in commands) for kind in (CloseToLimit, HoldFingers)
        )
        assert closes == (phase in CONTACT and not cut), phase
        assert holds or phase in CONTACT or cut, phase
        truth = fault.cell(staged.rig).truth()
        assert max(truth.peak_n) < 11.0, phase
        if phase is State.HOLD:  # held before, and still held
            assert truth.touched and truth.height_m > 0.005
            assert abs(truth.slip_speed_mps) < 1e-3


def test_object_that_was_slipping_is_caught_by_the_safe_state() -> None:
    staged = Staged("rule.threshold=0.9999999", made=by_default)  # slip is never registered
    staged.run(in_phase(State.LIFT, 60), fault.silence_fingertips)
    assert thumb_n(staged) > 8.0
    assert abs(fault.cell(staged.rig).truth().slip_speed_mps) < 1e-3


def test_a_single_lost_sample_is_counted_and_ends_no_run() -> None:
    staged = Staged("tactile.conversion_ms=7.0", made=by_default)  # at most one frame a period
    lose_one = in_phase(State.LIFT, 2)
    trial = staged.run(lose_one, lambda rig: fault.cell(rig).board.shorten_frame(4))
    assert staged.result(trial).success
    assert trial.loop.timing.repeated_frames == 1
    assert trial.loop.timing.missed_periods == 0
