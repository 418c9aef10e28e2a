"""Least force: steps of the thumb while the arm stands, a margin once they have carried, a jump
where a step is not enough."""

import pytest

from grasp.commands import CloseFast, MoveArm, MoveFingers, StopArm
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.lift_line import LiftLine
from grasp.observation import Observation
from grasp.phases import Phase
from grasp.steps import Steps
from grasp.stiffness import Stiffness
from tests.unit.grasp.builders import LOST, STOP, arm, gripper, seen
from tests.unit.grasp.controller_driver import HEIGHT, LATCHED, TICK, Driver
from tests.unit.grasp.test_pause import told


def stepping(**settings: object) -> Driver:
    low: dict[str, object] = {"answer": "stop_and_step", "step_below_m": 0.06}
    return Driver(**(low | settings)).slip()  # type: ignore[arg-type]


def over(d: Driver) -> Driver:
    """Slip ends with the pause, and the arm goes on."""
    while d.controller.phase is Phase.COMPENSATE:
        d.climb()
    return d


def rises(d: Driver, height_m: float, p: float = 0.0) -> None:
    d.step(p, arm=arm(d.t_ns + TICK, height_m, moving=True))


@pytest.mark.parametrize(("newtons_per_count", "counts"), [(1.9, 1), (0.55, 2), (0.3, 5)])
def test_step_is_newtons_in_whole_counts_of_the_thumb_alone_and_one_at_least(
    newtons_per_count: float, counts: int
) -> None:
    d = stepping(stiffness=Stiffness(newtons_per_count), step_n=1.5)
    assert told(d, StopArm, MoveFingers, CloseFast) == [
        StopArm(8.0), MoveFingers((55 + counts, 55, 55), 0.022, 10.0),
    ]  # fmt: skip


def test_slip_that_comes_back_is_answered_by_another_step() -> None:
    d = over(stepping())
    for _ in range(3):
        rises(d, 0.052, 0.9)
    over(d)
    assert [c.targets_counts[0] for c in told(d, MoveFingers)] == [56, 57]  # type: ignore[attr-defined]
    assert len(told(d, StopArm)) == len(told(d, MoveArm)) == 2
    assert told(d, CloseFast) == []


def test_force_that_has_carried_the_object_gets_its_margin_while_the_arm_stands() -> None:
    d = over(stepping(margin_steps=2, margin_after_m=0.01))
    rises(d, 0.055)
    assert d.controller.phase is Phase.LIFT
    d.commands.clear()
    rises(d, 0.061)
    assert d.commands == [StopArm(8.0), MoveFingers((58, 55, 55), 0.022, 10.0)]
    over(d)
    rises(d, 0.1)
    assert len(told(d, MoveFingers)) == 1  # once
    assert len(told(d, MoveArm)) == 1


def test_slip_that_a_step_does_not_end_in_its_time_is_answered_by_the_fastest_closure() -> None:
    d = stepping(step_patience_s=0.25)
    for _ in range(24):
        d.climb(0.9)
    assert told(d, CloseFast) == []
    for _ in range(3):
        d.climb(0.9)
    assert len(told(d, CloseFast)) == 1
    over(d)
    rises(d, 0.1)
    assert len(told(d, MoveFingers)) == 1  # no margin on the cap
    assert d.controller.phase is Phase.LIFT


def test_slip_in_the_air_is_answered_by_the_fastest_closure() -> None:
    high = stepping(step_below_m=0.03)
    assert told(high, MoveFingers) == []
    assert len(told(high, CloseFast)) == 1
    top = Driver(answer="stop_and_step", step_below_m=1.0, hold_s=5.0).lift()
    top.height_m = HEIGHT
    top.until(Phase.HOLD)
    top.until(Phase.COMPENSATE, 0.9)
    assert told(top, MoveFingers) == []
    assert len(told(top, CloseFast)) == 1


def test_thumb_that_a_step_has_latched_at_the_cap_is_told_nothing_more() -> None:
    d = over(stepping(margin_steps=0))
    d.commands.clear()
    for _ in range(2):
        d.climb(0.9, gripper=d.hand(detections=LATCHED))
    assert d.controller.phase is Phase.COMPENSATE
    assert told(d, MoveFingers, CloseFast) == []
    assert d.controller.closings == 1


def held_by(end: int, **settings: object) -> Driver:
    """A thumb that may go no further than that; the first grasp is at 55 counts."""
    d = Driver(answer="stop_and_step", step_below_m=0.06, **settings)
    d.end = end
    return d


@pytest.mark.parametrize(("end", "targets"), [(57, [57]), (56, [])])
def test_step_that_the_thumb_may_not_take_whole_is_one_closing_to_its_last_count(
    end: int, targets: list[int]
) -> None:
    d = held_by(end, stiffness=Stiffness(0.75)).slip()
    assert [c.targets_counts[0] for c in told(d, MoveFingers)] == targets  # type: ignore[attr-defined]
    assert len(told(d, CloseFast)) == (not targets)


@pytest.mark.parametrize(("changes", "hand"), [({"errors": LOST}, 1), ({"stop": STOP}, 0)])
def test_fault_closes_the_hand_to_the_limit_in_a_step_and_a_person_leaves_it(
    changes: dict[str, str], hand: int
) -> None:
    d = stepping()
    d.commands.clear()
    d.climb(**changes)
    assert len(told(d, CloseFast)) == hand
    assert told(d, MoveFingers) == []


# By themselves


def alone(**settings: object) -> Steps:
    """Of one count each, on a line that begins 0.4 m below the arm."""
    asked = ControllerSettings(
        **({"answer": "stop_and_step", "step_below_m": 0.5, "step_tries": 2} | settings)  # type: ignore[arg-type]
    )
    plan = GripPlan((40, 55, 55), (55, 55, 55), 10.0, Stiffness(1.0))
    return Steps(asked, plan, LiftLine(asked, (0.3, 0.2, 0.0)))


def at(thumb: int = 55, end: int | None = None, moving: bool = False) -> Observation:
    hand = gripper(positions=(thumb, 55, 55))
    return seen(0, gripper=hand, thumb_end=end, arm=arm(moving=moving))


def test_steps_are_taken_as_often_as_may_be_tried() -> None:
    steps = alone(step_tries=2)
    for _ in range(2):
        assert steps.may(at())
        steps.step(at())
    assert not steps.may(at())


def test_no_step_is_taken_from_the_height_on_that_ends_them() -> None:
    assert not alone(step_below_m=0.4).may(at())
    assert alone(step_below_m=0.401).may(at())


def test_arm_may_take_all_the_time_of_a_step_to_stop() -> None:
    """At 0.05 m/s."""
    assert alone(answer_stop_mps2=0.1, step_patience_s=0.5).may(at(moving=True))
    assert not alone(answer_stop_mps2=0.1, step_patience_s=0.499).may(at(moving=True))


@pytest.mark.parametrize(("thumb", "end"), [(253, 255), (254, 255), (255, 255)])
def test_thumb_that_force_alone_ends_goes_as_far_as_fingers_close(thumb: int, end: int) -> None:
    steps = alone(margin_steps=2)
    steps.step(at(thumb))
    assert steps.may(at(thumb)) == (thumb < 255)
    assert steps.margin_due(at(thumb), at_top=True) == (thumb < 255)
    assert steps.margin(at(thumb)).targets_counts == (end, 55, 55)


def test_margin_is_due_once_the_arm_has_risen_so_far_and_once_only() -> None:
    steps = alone(margin_steps=1, margin_after_m=0.0)
    assert not steps.margin_due(at(), at_top=True)
    steps.step(at())
    assert steps.margin_due(at(), at_top=False)
    steps.margin(at())
    assert not steps.margin_due(at(), at_top=True)
    steps.step(at())
    steps.forget()
    assert not steps.margin_due(at(), at_top=True)
    assert not (steps.lasts or steps.securing)
