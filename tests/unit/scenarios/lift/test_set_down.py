"""Set-down of a ball that slipped: it touches the table early, and it widens between the pads."""

from collections.abc import Callable

import pytest

from grasp.control.states import LOWERING_STATES, State
from grasp.run.loop import Tick
from scenarios.campaign.config import load_config
from scenarios.lift.config import LiftConfig
from scenarios.lift.lift import lift
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig
from scenarios.trial.execution import FinishedTrial, make_guard, run_trial
from scenarios.world.truth import Truth
from tests.unit.scenarios.conftest import EAGER, HAND_ALONE, RIGID
from tests.unit.scenarios.lift.device_faults import lose_stops

SLIPPED_M = 0.012
BOUND_N = 11.0  # limit and stated overshoot


def ball(detector: str, *assignments: str, speed_mps: float = 0.1) -> LiftConfig:
    """A lift in which only the hand responds, so that the ball slips far."""
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
def test_ball_that_slipped_is_released_on_the_table_and_never_pressed_above_the_limit(
    detector: str, settings: tuple[str, ...], speed_mps: float, seed: int
) -> None:
    config = ball(detector, *settings, speed_mps=speed_mps)
    trial, observed = watched(config, seed)
    assert observed[0][1].slip_distance_m > SLIPPED_M
    assert peak_n(observed) < BOUND_N
    opening = [(k, t) for k, t in observed if k.decision.state is State.OPEN]
    tick, truth = opening[0]
    assert truth.height_m < 0.001  # on the table
    assert tick.arm.position_m[2] - trial.controller.home[2] > 0.01  # before the arm is down
    assert lift.judge(config, seed, trial, None).success


SLIPPERY = ("object.friction_static=0.3", "object.friction_kinetic=0.25",
            "controller.lift_height_m=0.03")  # fmt: skip


def test_late_loop_does_not_press_a_ball_that_slipped_far_above_the_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("grasp.control.set_down.STEP_M", 3e-4)
    trial, observed = watched(ball("energy", *SLIPPERY, "loop.decision_delay_s=0.1"), 39)
    assert observed[0][1].slip_distance_m > SLIPPED_M
    assert peak_n(observed) < BOUND_N
    assert trial.controller.finished


def test_lost_stop_while_lowering_does_not_press_the_ball_above_the_limit() -> None:
    config = ball("energy", "damage.gain_lost=0.5")
    trial, observed = watched(config, 1, lambda rig: lose_stops(rig, 1))
    assert State.FEEL in {tick.decision.state for tick, _ in observed}
    assert peak_n(observed) < BOUND_N
    assert trial.controller.finished


Observed = list[tuple[Tick, Truth]]


def watched(
    settings: LiftConfig, seed: int, act: Callable[[GraspRig], object] = lambda rig: None
) -> tuple[FinishedTrial, Observed]:
    """A lift, with ticks and truth from the start of lowering on; ``act`` is called there."""
    observed: Observed = []

    def watch(tick: Tick, truth: Truth | None, _: object) -> None:
        assert truth is not None
        if observed or tick.decision.state in LOWERING_STATES:
            act(rig) if not observed else None
            observed.append((tick, truth))

    with open_rig(settings.built_for(seed), seed, paced=False) as rig:
        return run_trial(settings, rig, make_guard(settings), watch), observed


def peak_n(observed: Observed) -> float:
    """Highest true force while lowering, N."""
    return max(
        max(truth.normal_n) for tick, truth in observed if tick.decision.state in LOWERING_STATES
    )
