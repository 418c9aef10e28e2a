"""A batch gives what the single scenes give, by NumPy, compiled, and in parallel."""

import numpy as np
import pytest

from scenarios.world.ladder.levels import simulate
from scenarios.world.ladder.scene import Scene, Vibration
from scenarios.world.world_settings import Level
from tests.unit.scenarios.world.ladder import ladder_batch as batch
from tests.unit.scenarios.world.ladder.ladder_scenes import SOFT, body, changed, held, lift, tap

SHAKE = Vibration(acceleration_mps2=14.0, frequency_hz=20.0)


def scenes(kind: str, count: int = 70) -> list[Scene]:
    """More than one block of scenes, each another object."""
    rng = np.random.default_rng(5)
    plain = {
        "lift": lift(duration_s=0.8), "tap": held(tap=tap(), duration_s=0.2),
        "vibration": held(vibration=SHAKE, duration_s=0.2),
        "lost": held(body=body(mass_kg=1.5, body_above_grip_m=0.01), duration_s=0.2),
    }[kind]  # fmt: skip
    return [
        changed(plain, body=changed(plain.body, mass_kg=plain.mass_kg * rng.uniform(0.9, 1.2)))
        for _ in range(count)
    ]


@pytest.mark.parametrize("kind", ["lift", "tap", "vibration", "lost"])
def test_batch_compiled_or_not_equals_the_single_scenes(kind: str) -> None:
    packed = batch.pack(scenes(kind))
    single = [-simulate(s, Level.SLIDER, 1e-3).z_m for s in scenes(kind)]
    array = batch.run_numpy(packed, 1e-3)
    np.testing.assert_allclose(array, single, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(batch.run(packed, 1e-3), array, rtol=1e-12, atol=1e-14)
    assert np.ptp(array) > 1e-7


def test_parallel_gives_the_bits_of_serial() -> None:
    packed = batch.pack(scenes("lift"))
    serial, parallel = (batch.run(packed, 1e-3, parallel) for parallel in (False, True))
    assert parallel.tolist() == serial.tolist()
    assert 0.001 < serial.min() < serial.max() < 0.05  # numba's silent zeros would be 80 mm


def test_batch_refuses_what_its_formula_does_not_cover() -> None:
    with pytest.raises(ValueError, match="equally long"):
        batch.pack([lift(), lift(duration_s=1.0)])
    with pytest.raises(ValueError, match="relaxation"):
        batch.pack([lift(contact=changed(SOFT, relaxation_fraction=0.1))])
