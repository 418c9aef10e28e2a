"""Impulses found by simulation: the threshold of motion, and that of the mallet."""

import numpy as np
import pytest

from scenarios.acquire.datasets.causes import base_lift_config
from scenarios.acquire.datasets.disturbances import AIM_M, MOVED_M, GripTrials
from scenarios.acquire.datasets.random_objects import random_object


@pytest.fixture(scope="module")
def bench() -> GripTrials:
    config, rng = base_lift_config(""), np.random.default_rng(3)
    body = random_object("straight", None, config, rng)
    return GripTrials(body, config.contact, config.guard.full_grip_n, False, rng)


@pytest.mark.parametrize("direction", ["top", "side"])
def test_threshold_impulse_moves_the_object_and_a_lower_one_does_not(
    bench: GripTrials, direction: str
) -> None:
    impulses = bench.impulses(direction)
    assert bench.simulate_impact(bench.impact(direction, impulses.threshold))[1] >= MOVED_M
    assert bench.simulate_impact(bench.impact(direction, 0.95 * impulses.threshold))[1] < MOVED_M
    assert bench.simulate_impact(bench.impact(direction, impulses.mallet))[1] == pytest.approx(
        AIM_M, rel=0.15
    )
