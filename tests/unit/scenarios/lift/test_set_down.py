"""A ball that slipped is set down: it stands before the arm is down, and its flank widens."""

from collections.abc import Callable

import pytest

from grasp.loop import Tick
from grasp.states import LOWERING_STATES, State
from scenarios.campaign.config import load_config
from scenarios.lift.lift import LiftConfig, lift
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig
from scenarios.trial.execution import FinishedTrial, make_guard, run_trial
from scenarios.world.truth import Truth
from tests.unit.scenarios.conftest import EAGER, HAND_ALONE, RIGID
from tests.unit.scenarios.lift.device_faults import lose_stops

SLIPPED_M = 0.015
BOUND_N = 11.0  # limit and stated overshoot


def ball(detector: str, *assignments: str, speed_mps: float = 0.1) -> LiftConfig:
    """The hand alone answers, so that it slips far."""
    eager = (EAGER,) if detector == "energy" else ()
    assignments = (*RIGID, HAND_ALONE, *eager, *assignments)
    ramp_mps2 = 5 * speed_mps
    faster = (
        f"controller.lift_speed_mps={speed_mps}", f"controller.lift_acceleration_mps2={ramp_mps2}",
        f"arm.max_speed_mps={max(0.25, speed_mps)}",
        f"arm.max_acceleration_mps2={max(1.2, ramp_mps2)}",
    )  # fmt: skip
    return load_config("ball", "simulated", detector, None, [*assignments, *faster]).for_lift()


@pytest.mark.parametrize(
    ("detector", "settings", "speed_mps", "seed"),
    [("energy", ("damage.gain_lost=0.5",), 0.1, 1), ("gru", (), 0.3, 2)],
)
def test_ball_that_slipped_is_let_go_where_it_stands_and_never_pressed_beyond_the_limit(
    detector: str, settings: tuple[str, ...], speed_mps: float, seed: int
) -> None:
    told = ball(detector, *settings, speed_mps=speed_mps)
    trial, seen = watched(told, seed)
    assert seen[0][1].slip_distance_m > SLIPPED_M
    assert hardest_n(seen) < BOUND_N
    opening = [(k, t) for k, t in seen if k.decision.state is State.OPEN]
    tick, truth = opening[0]
    assert truth.height_m < 0.001  # it stands
    assert tick.arm.position_m[2] - trial.controller.home[2] > 0.01  # and the arm is not down
    assert lift.judge(told, seed, trial, None).success


SLIPPERY = ("object.friction_static=0.3", "object.friction_kinetic=0.25",
            "controller.lift_height_m=0.03")  # fmt: skip


def test_ball_that_slipped_all_the_way_is_not_pressed_beyond_the_limit_by_a_loop_that_is_late(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("grasp.set_down.STEP_M", 3e-4)
    trial, seen = watched(ball("energy", *SLIPPERY, "loop.decision_delay_s=0.1"), 39)
    assert seen[0][1].slip_distance_m > SLIPPED_M
    assert hardest_n(seen) < BOUND_N
    assert trial.controller.finished


def test_stop_that_is_lost_on_the_way_down_does_not_press_the_ball_beyond_the_limit() -> None:
    trial, seen = watched(ball("energy", "damage.gain_lost=0.5"), 1, lambda rig: lose_stops(rig, 1))
    assert State.FEEL in {tick.decision.state for tick, _ in seen}
    assert hardest_n(seen) < BOUND_N
    assert trial.controller.finished


Seen = list[tuple[Tick, Truth]]


def watched(
    settings: LiftConfig, seed: int, act: Callable[[GraspRig], object] = lambda rig: None
) -> tuple[FinishedTrial, Seen]:
    """A lift, and what was seen of it from when the arm turned, and ``act`` was done."""
    seen: Seen = []
    begun: list[bool] = []

    def watch(tick: Tick, truth: Truth | None, _: object) -> None:
        assert truth is not None
        if begun or tick.decision.state in LOWERING_STATES:
            act(rig) if not begun else None
            begun.append(True)
            seen.append((tick, truth))

    with open_rig(settings.built_for(seed), seed, paced=False) as rig:
        return run_trial(settings, rig, make_guard(settings), watch), seen


def hardest_n(seen: Seen) -> float:
    """On the way down."""
    return max(
        max(truth.normal_n) for tick, truth in seen if tick.decision.state in LOWERING_STATES
    )
