"""Impacts found on the contact law: what just moves an object, and what only swings it."""

import numpy as np
import pytest

from scenarios.acquire.datasets.causes import bare_config
from scenarios.acquire.datasets.disturbances import AIM_M, JUST_M, GripTrials
from scenarios.acquire.datasets.drawn_objects import body_ranges, draw_object


@pytest.fixture(scope="module")
def bench() -> GripTrials:
    config, rng = bare_config(""), np.random.default_rng(3)
    body = draw_object(
        body_ranges("straight"), None, config.contact, config.hand.m_per_count, 20.0, rng
    )
    return GripTrials(body, config.contact, config.guard.full_grip_n, False, rng)


@pytest.mark.parametrize("direction", ["top", "side"])
def test_what_just_moves_it_does_and_a_little_less_does_not(
    bench: GripTrials, direction: str
) -> None:
    known = bench.impulses(direction)
    assert bench.tried(bench.impact(direction, known.just))[1] >= JUST_M
    assert bench.tried(bench.impact(direction, 0.95 * known.just))[1] < JUST_M
    assert bench.tried(bench.impact(direction, known.aim))[1] == pytest.approx(AIM_M, rel=0.15)
