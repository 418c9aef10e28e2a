"""Set-down: an object that slipped touches the table before the arm is where the lift began."""

from typing import Any

import pytest

from grasp.control.commands import CloseToLimit, MoveArm, OpenFingers, StopArm
from grasp.control.states import State
from tests.unit.grasp.builders import LOST, arm
from tests.unit.grasp.controller_driver import TICK, Driver
from tests.unit.grasp.safety_probes import grip_forces, near, probed, tightened

SURE = "grasp.control.set_down.MAX_RISE_SHARE"  # largest rise without a conclusive probe

HOME_M = 0.4
GRIP = grip_forces(3.0)
TIGHTER = grip_forces(3.5)


def moves(d: Driver) -> list[MoveArm]:
    return [c for c in d.commands if isinstance(c, MoveArm)]


def test_the_arm_creeps_from_the_height_at_which_slip_ended() -> None:
    fast, slow = moves(near())[-2:]
    assert (fast.position_m[2], fast.speed_mps) == (pytest.approx(HOME_M + 0.053), 0.05)
    assert (slow.position_m[2], slow.speed_mps) == (pytest.approx(HOME_M), 0.005)


def test_object_that_never_slipped_is_lowered_fast_all_the_way() -> None:
    d = Driver(hold_s=0.1).lift()
    d.height_m = 0.2
    d.until(State.DESCEND)
    assert moves(d)[-1].position_m[2] == pytest.approx(HOME_M)


def test_grip_that_tightens_above_the_expected_height_stops_the_arm_too() -> None:
    d = Driver(hold_s=0.1).lift()
    d.height_m = 0.2
    d.until(State.DESCEND)
    d.commands.clear()
    for _ in range(5):
        d.step(estimated_n=GRIP, arm=arm(d.t_ns + TICK, 0.1, moving=True))
    assert d.controller.state is State.FEEL
    assert d.commands == [StopArm(1.0)]


def probed_high_up(steps: Any, monkeypatch: pytest.MonkeyPatch) -> Driver:
    """Probe above the greatest height at which the object can stand, with this result."""
    monkeypatch.setattr(SURE, 1.0)
    d = Driver(hold_s=0.1).lift()
    d.height_m = 0.2
    d.until(State.DESCEND)
    d.height_m = 0.1
    d.until_next(estimated_n=GRIP)
    d.until_next(estimated_n=GRIP)
    d.until(State.DESCEND, estimated_n=steps)
    return d


def test_fast_descent_continues_where_no_object_can_stand_yet(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    d = probed_high_up(GRIP, monkeypatch)
    assert (moves(d)[-1].position_m[2], moves(d)[-1].speed_mps) == (pytest.approx(HOME_M), 0.05)


@pytest.mark.parametrize("steps", [grip_forces(3.2), grip_forces(2.8)], ids=["tighter", "looser"])
def test_no_release_where_no_object_can_stand_after_any_probe(
    steps: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The change is then caused by drift or oscillation."""
    d = probed_high_up(steps, monkeypatch)
    assert d.controller.machine.log[-1].cause == "no object can stand yet"
    assert not any(isinstance(c, OpenFingers) for c in d.commands)
    assert moves(d)[-1].position_m[2] == pytest.approx(HOME_M)


@pytest.mark.parametrize(("braked_m", "step_m"), [(0.0, 0.0005), (0.001, 0.000343), (1e-4, 2e-4)])
def test_step_is_shorter_where_the_grip_tightened_much_while_the_arm_braked(
    braked_m: float, step_m: float
) -> None:
    """Rise of 0.7 N beyond the threshold; the probe aims at 0.24 N, three times CHECK_N."""
    d = tightened(3.0)
    d.height_m -= braked_m
    d.until_next(estimated_n=grip_forces(3.0))
    assert d.height_m - step_m == pytest.approx(moves(d)[-1].position_m[2] - HOME_M, abs=1e-5)


def test_grip_that_has_tightened_much_is_lowered_no_further(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(SURE, 0.25)
    d = probed(2.6, 2.6)
    assert d.controller.state is State.LOST
    assert "uncertain" in d.controller.machine.log[-1].cause


def test_grip_that_tightens_while_lowering_stops_the_arm_without_opening() -> None:
    d = tightened(GRIP[0])
    assert d.controller.state is State.FEEL
    assert d.commands == [StopArm(1.0)]


def test_object_that_tightens_the_grip_at_a_probe_is_released() -> None:
    d = probed(GRIP[0], TIGHTER[0])
    assert d.controller.state is State.OPEN
    assert [type(c) for c in d.commands] == [StopArm, MoveArm, OpenFingers]
    d.until(State.RETREAT)
    assert moves(d)[-1].position_m[2] == pytest.approx(HOME_M + 0.02 + 0.05)
    d.height_m = 0.07
    d.until(State.SET_DOWN)
    assert d.controller.finished


def test_probe_waits_until_the_arm_is_at_rest() -> None:
    d = tightened(GRIP[0])
    for _ in range(60):
        d.step(estimated_n=GRIP, arm=arm(d.t_ns + TICK, 0.02, moving=True))
    assert d.controller.state is State.FEEL


def test_object_whose_textured_face_loosens_the_grip_at_a_probe_is_released() -> None:
    assert probed(3.0, 2.7).controller.state is State.OPEN


def test_probe_without_a_change_continues_the_descent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(SURE, 0.5)
    d = probed(2.6, 2.6)
    assert d.controller.state is State.FEEL
    assert moves(d)[-1].position_m[2] == pytest.approx(HOME_M)
    assert not any(isinstance(c, OpenFingers | CloseToLimit) for c in d.commands)
    d.height_m = 0.0
    d.until(State.OPEN, estimated_n=grip_forces(2.6))


def test_inconclusive_probes_end_with_hand_and_height_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("grasp.control.set_down.MAX_TIGHTENINGS", 1)
    d = probed(GRIP[0], GRIP[0])
    assert d.controller.state is State.LOST
    assert "uncertain" in d.controller.machine.log[-1].cause
    assert [type(c) for c in d.commands] == [StopArm, MoveArm, StopArm]


@pytest.mark.parametrize("probes", [False, True])
def test_fault_during_a_probe_closes_the_hand(probes: bool) -> None:
    d = tightened(GRIP[0])
    if probes:
        d.until_next(estimated_n=GRIP)
    d.commands.clear()
    d.step(errors=LOST, estimated_n=GRIP)
    assert [type(c) for c in d.commands] == [StopArm, CloseToLimit]


def test_stop_while_lowering_is_repeated_until_the_arm_has_stopped() -> None:
    d = tightened(3.5)
    d.commands.clear()
    for _ in range(35):
        d.step(estimated_n=grip_forces(3.5), arm=arm(d.t_ns + TICK, 0.02, moving=True))
    assert d.controller.state is State.FEEL
    assert [type(c) for c in d.commands] == [StopArm] * 3
    d.commands.clear()
    for _ in range(15):
        d.step(estimated_n=grip_forces(3.5), arm=arm(d.t_ns + TICK, 0.02))
    assert not any(isinstance(c, StopArm) for c in d.commands)


@pytest.mark.parametrize("probes", [False, True])
def test_no_probe_without_contact(probes: bool) -> None:
    d = tightened(3.5)
    if probes:
        d.until_next(estimated_n=grip_forces(3.5))
    d.commands.clear()
    for _ in range(10):
        d.step(estimated_n=grip_forces(0.0))
    assert d.controller.state is State.LOST
    assert moves(d) == []
