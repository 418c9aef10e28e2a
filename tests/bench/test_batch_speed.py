"""Lift scenes a second and core at L1, by NumPy and compiled; aim 5,000."""

import time
from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from scenarios.studies.physics import yardsticks
from tests.unit.scenarios.world.ladder import ladder_batch as batch


def scenes_a_second(run: Callable[[], object], count: int) -> float:
    run()
    best = 0.0
    for _ in range(5):
        start = time.thread_time()
        run()
        best = max(best, count / (time.thread_time() - start))
    return best


@pytest.mark.bench
def test_lift_scenes_of_1600_ms_a_second_and_core() -> None:
    rng, count = np.random.default_rng(1), 2048
    plain = yardsticks.lift()
    scenes = [
        msgspec.structs.replace(
            plain, body=msgspec.structs.replace(plain.body, mass_kg=rng.uniform(0.25, 0.45))
        )
        for _ in range(count)
    ]
    start = time.thread_time()
    packed = batch.pack(scenes)
    print(f"\npacking {count} scenes: {(time.thread_time() - start) / count * 1e6:.0f} us a scene")
    for step_s in (4e-3, 1e-3):
        compiled = scenes_a_second(lambda h=step_s: batch.run(packed, h), count)
        array = scenes_a_second(lambda h=step_s: batch.run_numpy(packed, h), count)
        print(
            f"step {step_s * 1e3:g} ms: compiled {compiled:.0f}, NumPy {array:.0f} scenes a second"
        )
