"""The arm's speed slider is changed during a lift."""

import pytest

from grasp.control.fault import lines
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
        assert trial.controller.state is State.SET_DOWN, lines(trial.controller.faults)
        assert staged.result(trial).success
        assert seconds(staged) > seconds(plain)
        assert {tick.arm.speed_fraction for tick in staged.ticks} == {1.0, fraction}
        assert lowered_s(staged) == pytest.approx(lowered_s(plain) / fraction, rel=0.15)
