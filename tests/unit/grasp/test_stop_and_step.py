"""Response in steps of the thumb with the arm stopped, then a margin; a closing where a step is not
enough."""

import pytest

from grasp.control.commands import CloseToLimit, MoveArm, MoveFingers, StopArm
from grasp.control.contact_estimator import Stiffness
from grasp.control.controller_settings import ControllerSettings, GripPlan
from grasp.control.lift_line import LiftLine
from grasp.control.observation import Observation
from grasp.control.slip_response.stop_and_step import StopAndStep
from grasp.control.states import State
from tests.unit.grasp.builders import LOST, STOP, arm, gripper, observation
from tests.unit.grasp.controller_driver import LATCHED, TICK, Driver
from tests.unit.grasp.test_stop_and_close import commands


def stepping(height_m: float = 0.02, **settings: object) -> Driver:
    d = Driver(slip_response="stop_and_step", **settings)  # type: ignore[arg-type]
    d.climbs_m = height_m
    return d.slip()


def over(d: Driver) -> Driver:
    """Let slip end with the arm's stop, and the arm continue."""
    while d.controller.state is State.COMPENSATE:
        d.climb()
    return d


def rises(d: Driver, height_m: float, p: float = 0.0) -> None:
    d.step(p, arm=arm(d.t_ns + TICK, height_m, moving=True))


@pytest.mark.parametrize(("newtons_per_count", "counts"), [(1.9, 1), (0.55, 2), (0.3, 5)])
def test_step_is_newtons_in_whole_counts_of_the_thumb_alone_and_one_at_least(
    newtons_per_count: float, counts: int
) -> None:
    d = stepping(stiffness=Stiffness(newtons_per_count))
    assert commands(d, StopArm, MoveFingers, CloseToLimit) == [
        StopArm(8.0), MoveFingers((55 + counts, 55, 55), 0.022, 10.0),
    ]  # fmt: skip


def test_recurring_slip_leads_to_another_step() -> None:
    d = over(stepping())
    for _ in range(3):
        rises(d, 0.022, 0.9)
    over(d)
    assert [c.targets_counts[0] for c in commands(d, MoveFingers)] == [56, 57]  # type: ignore[attr-defined]
    assert len(commands(d, StopArm)) == len(commands(d, MoveArm)) == 2
    assert commands(d, CloseToLimit) == []


def test_margin_is_added_with_the_arm_stopped_once_the_force_has_carried_the_object() -> None:
    d = over(stepping(margin_steps=2))
    rises(d, 0.025)
    assert d.controller.state is State.LIFT
    d.commands.clear()
    rises(d, 0.031)
    assert d.commands == [StopArm(8.0), MoveFingers((58, 55, 55), 0.022, 10.0)]
    over(d)
    rises(d, 0.1)
    assert len(commands(d, MoveFingers)) == 1  # once
    assert len(commands(d, MoveArm)) == 1


def test_slip_that_outlasts_a_step_leads_to_the_closing() -> None:
    d = stepping()
    for _ in range(24):
        d.climb(0.9)
    assert commands(d, CloseToLimit) == []
    for _ in range(3):
        d.climb(0.9)
    assert len(commands(d, CloseToLimit)) == 1
    over(d)
    rises(d, 0.1)
    assert len(commands(d, MoveFingers)) == 1  # no margin on the cap
    assert d.controller.state is State.LIFT


def test_slip_in_the_air_leads_to_the_closing() -> None:
    high = stepping(0.031)
    assert commands(high, MoveFingers) == []
    assert len(commands(high, CloseToLimit)) == 1
    top = Driver(slip_response="stop_and_step", hold_s=5.0, lift_height_m=0.02).lift()
    top.height_m = 0.02
    top.until(State.HOLD)
    top.until(State.COMPENSATE, 0.9)
    assert commands(top, MoveFingers) == []
    assert len(commands(top, CloseToLimit)) == 1


def test_thumb_latched_at_the_limit_by_a_step_gets_no_further_command() -> None:
    d = over(stepping(margin_steps=0))
    d.commands.clear()
    for _ in range(2):
        d.climb(0.9, gripper=d.hand(detections=LATCHED))
    assert d.controller.state is State.COMPENSATE
    assert commands(d, MoveFingers, CloseToLimit) == []
    assert d.controller.response.closings == 1


def held_by(end: int, **settings: object) -> Driver:
    """Driver whose thumb limit is ``end``; the first grasp is at 55 counts."""
    d = Driver(slip_response="stop_and_step", **settings)  # type: ignore[arg-type]
    d.end, d.climbs_m = end, 0.02
    return d


@pytest.mark.parametrize(("end", "targets"), [(57, [57]), (56, [])])
def test_a_step_beyond_the_thumb_limit_becomes_a_closing_to_that_limit(
    end: int, targets: list[int]
) -> None:
    d = held_by(end, stiffness=Stiffness(0.75)).slip()
    assert [c.targets_counts[0] for c in commands(d, MoveFingers)] == targets  # type: ignore[attr-defined]
    assert len(commands(d, CloseToLimit)) == (not targets)


@pytest.mark.parametrize(("changes", "hand"), [({"errors": LOST}, 1), ({"stop": STOP}, 0)])
def test_during_a_step_a_fault_closes_the_hand_and_a_stop_keeps_it(
    changes: dict[str, str], hand: int
) -> None:
    d = stepping()
    d.commands.clear()
    d.climb(**changes)
    assert len(commands(d, CloseToLimit)) == hand
    assert commands(d, MoveFingers) == []


# By itself


def alone(height_m: float = 0.01, **settings: object) -> StopAndStep:
    """Steps of one count each, on a line that begins so far below the arm."""
    expected = ControllerSettings(slip_response="stop_and_step", **settings)  # type: ignore[arg-type]
    plan = GripPlan((40, 55, 55), (55, 55, 55), 10.0, Stiffness(1.5))
    return StopAndStep(expected, plan, LiftLine(expected, (0.3, 0.2, 0.4 - height_m)))


def at(thumb: int = 55, end: int | None = None, moving: bool = False) -> Observation:
    hand = gripper(positions=(thumb, 55, 55))
    return observation(0, gripper=hand, thumb_end_counts=end, arm=arm(moving=moving))


def steps(response: StopAndStep, obs: Observation) -> bool:
    """Whether slip while rising leads to a step."""
    commands = response.begin(obs, rising=True, lost=False)
    return any(isinstance(c, MoveFingers) for c in commands)


def test_number_of_steps_is_limited() -> None:
    response = alone()
    assert [steps(response, at()) for _ in range(6)] == [True] * 5 + [False]


@pytest.mark.parametrize("height_m", [0.029, 0.031])
def test_no_step_above_the_height_limit(height_m: float) -> None:
    assert steps(alone(height_m), at()) == (height_m < 0.03)


@pytest.mark.parametrize("brake_mps2", [0.2, 0.19])
def test_arm_may_take_the_whole_step_time_to_stop(brake_mps2: float) -> None:
    """The arm rises at 0.05 m/s."""
    assert steps(alone(slip_stop_mps2=brake_mps2), at(moving=True)) == (brake_mps2 == 0.2)


@pytest.mark.parametrize(("thumb", "end"), [(252, 254), (253, 255), (254, 255)])
def test_without_a_thumb_limit_a_step_may_close_fully(thumb: int, end: int) -> None:
    response = alone(margin_steps=2)
    assert steps(response, at(thumb))
    (margin,) = response.follow_up(at(thumb), rising=False)
    assert isinstance(margin, MoveFingers) and margin.targets_counts == (end, 55, 55)


def test_thumb_at_its_limit_takes_no_step_and_gets_no_margin() -> None:
    response = alone()
    assert steps(response, at(254))
    assert response.follow_up(at(255), rising=False) == ()
    assert not steps(response, at(255))


def test_margin_is_due_once_after_the_arm_has_risen_far_enough() -> None:
    response = alone(margin_steps=1)
    assert response.follow_up(at(), rising=False) == ()
    assert steps(response, at())
    assert response.follow_up(at(), rising=True) == ()
    assert len(response.follow_up(at(), rising=False)) == 1
    assert response.follow_up(at(), rising=False) == ()
    assert steps(response, at())
    assert not steps(response, at(end=55))  # a closing to the cap: nothing is left to find
    assert response.follow_up(at(), rising=False) == ()
    assert not response.adds_margin
