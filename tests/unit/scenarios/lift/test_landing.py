"""A ball that slipped is set down: it stands before the arm is down, and its flank widens."""

import pytest

from grasp.loop import Tick
from grasp.phases import LOWERING_PHASES, Phase
from scenarios.campaign.axes import AXES
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.trial.execution import make_guard, run_trial
from scenarios.world.cell import Truth

SLIPPED_M = 0.015


def ball(detector: str, *assignments: str, speed_mps: float = 0.1) -> LiftConfig:
    plain = load_config("ball", "simulated", detector, None, assignments)
    quicker = AXES["speed"].moved(plain, speed_mps)
    return load_config("ball", "simulated", detector, None, [*assignments, *quicker]).for_lift()


@pytest.mark.parametrize(
    ("settings", "seed"),
    [(ball("energy", "damage.gain_lost=0.5"), 1), (ball("energy", speed_mps=0.2), 1),
     (ball("gru", speed_mps=0.4), 4), (ball("gru", speed_mps=0.3), 2)],
    ids=["half of the gain", "0.2 m/s", "0.4 m/s", "0.3 m/s"],
)  # fmt: skip
def test_ball_that_slipped_is_let_go_where_it_stands_and_never_pressed_beyond_the_limit(
    settings: LiftConfig, seed: int
) -> None:
    seen: list[tuple[Tick, Truth]] = []

    def watch(tick: Tick, truth: Truth | None, _: object) -> None:
        assert truth is not None
        seen.append((tick, truth))

    with open_rig(settings.built_for(seed), seed, paced=False) as rig:
        trial = run_trial(settings, rig, make_guard(settings), watch)
    down = [truth for tick, truth in seen if tick.decision.phase in LOWERING_PHASES]
    assert down[0].slip_distance_m > SLIPPED_M
    guard = settings.guard
    assert max(max(t.normal_n) for t in down) < guard.force_limit_n + guard.overshoot_n
    opening = [(k, t) for k, t in seen if k.decision.phase is Phase.RELEASE]
    tick, truth = opening[0]
    assert truth.height_m < 0.001  # it stands
    assert tick.arm.position_m[2] - trial.controller.home[2] > 0.01  # and the arm is not down
    assert lift.judge(settings, seed, trial, None).success
