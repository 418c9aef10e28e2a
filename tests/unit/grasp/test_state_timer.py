"""Effects of the arm's speed slider: scaled time-outs, no lift below half speed."""

from typing import Any

import msgspec
import pytest

from drivers.interfaces import ArmState
from grasp.control.commands import HoldFingers, MoveArm, StopArm
from grasp.control.fault import lines
from grasp.control.state_timer import HALTED_NS, LEAST_PACE
from grasp.control.states import State
from tests.unit.grasp.builders import arm
from tests.unit.grasp.controller_driver import HEIGHT, MOVING, TICK, Driver


def slow(d: Driver, fraction: float, height_m: float, moving: bool = True) -> ArmState:
    """The arm's state in the next step."""
    state = arm(d.t_ns + TICK, height_m, moving=moving)
    return msgspec.structs.replace(state, speed_fraction=fraction)


def seconds_in(d: Driver, phase: State, fraction: float, height_m: float) -> float:
    """Duration of a phase while the arm moves all the time, s."""
    assert d.controller.state is phase
    began_ns = d.t_ns
    while d.controller.state is phase:
        d.step(arm=slow(d, fraction, height_m))
    return (d.t_ns - began_ns) * 1e-9


def going_down(**settings: Any) -> Driver:
    d = Driver(hold_s=0.1, **settings).lift()
    d.height_m = HEIGHT
    d.until(State.DESCEND)
    return d


@pytest.mark.parametrize(("fraction", "factor"), [(1.0, 1), (0.8, 1.25), (0.5, 2), (0.1, 10)])
def test_lowering_time_out_scales_with_the_arm_speed(fraction: float, factor: float) -> None:
    d = going_down(phase_timeout_s=1.0)
    lasted_s = seconds_in(d, State.DESCEND, fraction, 0.1)
    assert lasted_s == pytest.approx(factor, abs=0.011)
    assert "phase lower.descend lasted longer" in lines(d.controller.faults)
    assert d.controller.arm_delay_ns == pytest.approx((factor - 1) * 1e9, abs=2e7)


def test_slow_arm_does_not_extend_time_outs_of_the_fingers() -> None:
    d = Driver(phase_timeout_s=1.0)
    d.until(State.BRACE)
    began_ns = d.t_ns
    while d.controller.state is State.BRACE:
        d.step(gripper=d.hand(detections=MOVING), arm=slow(d, 0.2, 0.0, moving=False))
    assert (d.t_ns - began_ns) * 1e-9 == pytest.approx(1.0, abs=0.011)
    assert d.controller.arm_delay_ns == 0.0


@pytest.mark.parametrize("phase", [State.BASELINE, State.LIFT])
def test_no_lift_with_a_speed_slider_below_half(phase: State) -> None:
    d = Driver()
    d.until(phase)
    assert d.step(arm=slow(d, 0.5, 0.0, moving=False)).state is phase
    d.commands.clear()
    d.step(arm=slow(d, 0.49, 0.0, moving=phase is State.LIFT))
    assert d.controller.state is State.FAULT
    assert lines(d.controller.faults) == (
        "the arm's speed slider is at 49 %; a lift needs at least 50 %"
    )
    assert isinstance(d.commands[0], StopArm)
    assert not any(isinstance(c, MoveArm) for c in d.commands)
    assert any(isinstance(c, HoldFingers) for c in d.commands) == (phase is State.BASELINE)


def test_arm_halted_by_its_slider_while_lowering_is_a_fault() -> None:
    d = going_down()
    lasted_s = seconds_in(d, State.DESCEND, 0.9 * LEAST_PACE, 0.1)
    assert lasted_s == pytest.approx(HALTED_NS * 1e-9, abs=0.011)
    assert (
        lines(d.controller.faults)
        == "the arm's speed slider is at 4.5 %, so its motion does not end"
    )
