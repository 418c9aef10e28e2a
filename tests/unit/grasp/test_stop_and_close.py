"""Response that stops the arm during the lift and continues when slip is over."""

import pytest

from drivers.interfaces import ArmState
from grasp.control.commands import CloseToLimit, MoveArm, StopArm
from grasp.control.slip_response.stop_and_close import PATIENCE_NS, RESUME_MPS2
from grasp.control.states import State
from tests.unit.grasp.builders import LOST, STOP, arm, observation
from tests.unit.grasp.controller_driver import HEIGHT, MOVING, TICK, Driver


def commands(d: Driver, *kinds: type) -> list[object]:
    return [c for c in d.commands if isinstance(c, kinds)]


def on_its_way(d: Driver, height_m: float = 0.05) -> ArmState:
    return arm(d.t_ns + TICK, height_m, moving=True)


def quiet(d: Driver, steps: int) -> None:
    for _ in range(steps):
        d.climb()


def test_arm_stops_before_the_hand_closes() -> None:
    d = Driver(slip_stop_mps2=4.0).slip()
    assert [type(c) for c in d.commands] == [StopArm, CloseToLimit]
    assert commands(d, StopArm) == [StopArm(4.0)]


def test_arm_continues_gently_once_slip_has_been_over_for_a_while() -> None:
    d = Driver(lift_acceleration_mps2=1.0).slip()
    d.climb(gripper=d.hand(detections=MOVING))  # still closing
    over_ns = d.t_ns
    while d.controller.state is State.COMPENSATE:
        d.climb()
    (on,) = commands(d, MoveArm)
    assert on == MoveArm((0.3, 0.2, 0.4 + HEIGHT), 0.1, RESUME_MPS2)
    assert (d.t_ns - over_ns) * 1e-9 == pytest.approx(0.14 + 0.05, abs=0.011)


def test_stop_is_repeated_while_the_arm_moves_and_the_lift_waits() -> None:
    d = Driver().slip()
    for _ in range(40):
        d.step(arm=on_its_way(d))
    assert d.controller.state is State.COMPENSATE
    assert len(commands(d, StopArm)) == 5
    assert commands(d, MoveArm) == []


def test_a_pause_is_the_time_for_which_the_arm_stands_still() -> None:
    response = Driver().slip().controller.response
    response.update(observation(0, arm=arm(0, moving=True)), True, TICK)
    before_s = response.paused_s
    for paused_s in (0.0, 0.01, 0.02):
        response.update(observation(0), True, TICK)
        assert response.paused_s - before_s == pytest.approx(paused_s)


def test_with_the_arm_stopped_a_further_stage_waits_until_the_stop_had_time_to_act() -> None:
    d = Driver().slip()
    response, by_touch = d.controller.response, observation(d.t_ns, rise_n=1.9)
    assert response.escalate(by_touch, PATIENCE_NS - 1) is None
    assert response.escalate(by_touch, PATIENCE_NS)
    d.climb(gripper=d.hand(detections=MOVING))
    while d.controller.state is State.COMPENSATE:
        d.climb()
    assert response.arm_stop is None
    assert response.escalate(by_touch, 0)  # the arm moves again


def test_arm_that_has_reached_the_top_does_not_move() -> None:
    d = Driver().slip()
    d.height_m = HEIGHT
    d.until(State.HOLD)
    assert commands(d, MoveArm) == []


def test_slip_at_the_top_stops_no_arm() -> None:
    d = Driver(hold_s=5.0).lift()
    d.height_m = HEIGHT
    d.until(State.HOLD)
    d.until(State.COMPENSATE, 0.9)
    d.until(State.HOLD)
    assert commands(d, StopArm, MoveArm) == []


@pytest.mark.parametrize("pattern", [(3, 3), (2, 40), (3, 9)])
def test_recurring_slip_at_the_limit_ends_the_lift(
    pattern: tuple[int, int],
) -> None:
    """An object too heavy to be held stands on the table again whenever the arm stops."""
    d = Driver().slip()
    loud, silent = pattern
    began_ns = d.t_ns
    while d.controller.state in (State.LIFT, State.COMPENSATE) and d.t_ns < began_ns + 2e10:
        d.climb(0.9 if d.t_ns // TICK % (loud + silent) < loud else 0.0)
    assert d.controller.state is State.DESCEND
    assert d.controller.limit_reached
    assert d.t_ns - began_ns < 10e9
    assert d.controller.response.closings == 1


def test_slow_descent_begins_slightly_above_the_height_at_which_slip_ended() -> None:
    d = Driver(hold_s=0.1).slip()
    quiet(d, 40)
    d.height_m = HEIGHT
    d.until(State.DESCEND)
    assert commands(d, MoveArm)[-1] == MoveArm((0.3, 0.2, 0.453), 0.05, 0.5)


@pytest.mark.parametrize(
    ("changes", "phase"),
    [({"errors": LOST}, State.FAULT), ({"stop": STOP}, State.STOPPED)],
)
def test_paused_arm_does_not_continue_after_a_stop(changes: dict[str, str], phase: State) -> None:
    d = Driver().slip()
    d.commands.clear()
    d.climb(**changes)
    for _ in range(60):
        d.step(arm=arm(d.t_ns + TICK, 0.05))
    assert d.controller.state is phase
    assert commands(d, MoveArm) == []
    assert d.controller.finished and not d.controller.unconfirmed
