"""Impacts found on the contact profile: what threshold moves an object, and what only swings it."""

import numpy as np
import pytest

from scenarios.acquire.datasets.causes import base_lift_config
from scenarios.acquire.datasets.disturbances import AIM_M, MOVED_M, GripTrials
from scenarios.acquire.datasets.random_objects import random_object, shape_ranges


@pytest.fixture(scope="module")
def bench() -> GripTrials:
    config, rng = base_lift_config(""), np.random.default_rng(3)
    body = random_object(
        shape_ranges("straight"), None, config.contact, config.hand.m_per_count, 20.0, rng
    )
    return GripTrials(body, config.contact, config.guard.full_grip_n, False, rng)


@pytest.mark.parametrize("direction", ["top", "side"])
def test_what_just_moves_it_does_and_a_little_less_does_not(
    bench: GripTrials, direction: str
) -> None:
    known = bench.impulses(direction)
    assert bench.simulate_impact(bench.impact(direction, known.threshold))[1] >= MOVED_M
    assert bench.simulate_impact(bench.impact(direction, 0.95 * known.threshold))[1] < MOVED_M
    assert bench.simulate_impact(bench.impact(direction, known.mallet))[1] == pytest.approx(
        AIM_M, rel=0.15
    )
