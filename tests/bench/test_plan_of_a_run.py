"""Processor time of planning all trials of an object, as in docs/physics.md."""

import time
from statistics import median

import pytest

from grasp.settings import names
from scenarios.campaign.config import load_config
from scenarios.tap import tap
from scenarios.tap.blows import nominal_impulse_n_s, searched
from scenarios.trial.config import TrialConfig
from scenarios.world.ladder.runs import plan_run

OBJECTS = names("objects")
SEED = 0


def planned_ms(config: TrialConfig) -> float:
    start_s = time.thread_time()
    config.physics(SEED)
    return 1e3 * (time.thread_time() - start_s)


def tap_ms(name: str, direction: str) -> tuple[float, float]:
    """Search for the blow, and the plan of what it does."""
    told = load_config(name, "simulated", None, None, (f"tap.direction={direction}",))
    config = tap.tap_config(told.for_tap())
    start_s = time.thread_time()
    nominal_impulse_n_s(
        config.object, config.contact, config.guard.full_grip_n, config.tap, direction
    )
    return 1e3 * (time.thread_time() - start_s), planned_ms(config)


@pytest.mark.bench
def test_processor_time_of_a_plan() -> None:
    tap_ms(OBJECTS[0], "side")  # loads what is compiled
    searched.cache_clear()
    plan_run.cache_clear()
    lifts = [
        planned_ms(load_config(name, "simulated", None, None, ()).for_lift()) for name in OBJECTS
    ]
    print(f"\nms, median of {len(OBJECTS)} objects\nlift: plan {median(lifts):.0f}")
    for direction in ("top", "side"):
        search_ms, plan_ms = zip(*(tap_ms(name, direction) for name in OBJECTS), strict=True)
        print(f"tap, {direction}: search {median(search_ms):.0f}, plan {median(plan_ms):.0f}")
    assert plan_run.cache_info().misses == 3 * len(OBJECTS)
