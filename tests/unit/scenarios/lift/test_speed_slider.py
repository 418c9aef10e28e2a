"""The arm's speed slider is changed during a lift."""

import pytest

from grasp.control.states import LOWERING_STATES, State
from tests.unit.scenarios.conftest import Staged, in_phase, well_in
from tests.unit.scenarios.lift.device_faults import Act, cell


def turn_to(fraction: float) -> Act:
    return lambda rig: cell(rig).arm.set_speed_slider(fraction, rig.clock.now_ns)


def seconds(staged: Staged) -> float:
    return (staged.ticks[-1].t_ns - staged.ticks[0].t_ns) * 1e-9


def lowered_s(staged: Staged) -> float:
    return sum(tick.decision.state in LOWERING_STATES for tick in staged.ticks) * 0.01


def test_lift_continues_more_slowly_above_one_half() -> None:
    plain = Staged()
    plain.run(in_phase(State.SET_DOWN), turn_to(1.0))
    for phase, fraction in ((State.LIFT, 0.5), (State.BRACE, 0.9)):
        staged = Staged()
        trial = staged.run(well_in(phase), turn_to(fraction))
        assert trial.controller.state is State.SET_DOWN, trial.controller.fault_cause
        assert staged.result(trial).success
        assert seconds(staged) > seconds(plain)
        assert {tick.arm.speed_fraction for tick in staged.ticks} == {1.0, fraction}
        assert lowered_s(staged) == pytest.approx(lowered_s(plain) / fraction, rel=0.15)


@pytest.mark.parametrize("phase", [State.BASELINE, State.LIFT])
def test_lift_ends_in_the_safe_state_below_one_half(phase: State) -> None:
    for fraction in (0.0, 0.45):
        staged = Staged()
        trial = staged.run(well_in(phase), turn_to(fraction))
        assert trial.controller.state is State.FAULT
        assert f"speed slider is at {100 * fraction:g} %" in trial.controller.fault_cause
        assert not trial.controller.unconfirmed
        assert staged.done_at_ns is not None and staged.ticks[-1].t_ns - staged.done_at_ns < 1e9
        assert cell(staged.rig).arm.at(staged.rig.clock.now_ns).velocity_mps == (0.0, 0.0, 0.0)
        assert trial.final is not None
        if phase is State.LIFT:
            assert min(trial.final.normal_n) > 1.0 and trial.final.slip_speed_mps < 1e-3
        failure = trial.failure(staged.config)
        assert failure is not None and "speed slider" in failure.message
        assert failure.end is not None and failure.end.arm == "the arm is stationary"


def test_object_stays_held_when_the_slider_stops_the_arm_in_the_air() -> None:
    staged = Staged()
    trial = staged.run(in_phase(State.DESCEND, 30), turn_to(0.0))
    assert trial.controller.state is State.FAULT
    assert (
        trial.controller.fault_cause
        == "the arm's speed slider is at 0 %, so its motion does not end"
    )
    assert trial.final is not None and trial.final.height_m > 0.05
    assert min(trial.final.normal_n) > 1.0 and trial.final.slip_speed_mps < 1e-3
