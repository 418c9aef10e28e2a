"""A pull on what is held, damaged fingertips, an object wider than planned."""

from collections.abc import Callable

import numpy as np
import pytest

from scenarios.world.cell import Damage, Pull
from scenarios.world.settings import DamageSettings, PullSettings
from tests.unit.scenarios.conftest import judged

MS = 1_000_000
NOISE = 0.3  # counts


def codes(seed: int, taxels: int = 6) -> np.ndarray:
    return np.random.default_rng(seed).integers(200, 500, (3, taxels)).astype(np.int16)


def damaged(**settings: float) -> Callable[[np.ndarray], np.ndarray]:
    return Damage(DamageSettings(**settings), NOISE, np.random.default_rng(0)).felt


@pytest.mark.parametrize("taxels", [6, 8])
def test_lost_taxels_stand_still_and_the_others_do_not(taxels: int) -> None:
    felt = damaged(taxels_lost=0.5)
    first, later = felt(codes(0, taxels)), felt(codes(1, taxels))
    stands = later == first
    assert stands.sum(axis=1).tolist() == [taxels // 2] * 3
    assert (later == codes(1, taxels))[~stands].all()


def test_pull_begins_once_when_the_arm_has_stood_long_enough_in_the_air() -> None:
    pull = Pull(PullSettings(force_n=5.0), 0)
    told = [
        (0, 0.0, 0.0), (500, 0.0, 0.0),  # on the table
        (600, 0.1, 0.1), (700, 0.2, 0.1),  # on its way up
        (800, 0.2, 0.0), (899, 0.2, 0.0), (900, 0.2, 0.0), (2000, 0.2, 0.0),
    ]  # fmt: skip
    assert [pull.begins(t * MS, height, rise) for t, height, rise in told] == [False] * 6 + [
        True, False,
    ]  # fmt: skip
    assert not Pull(PullSettings(), 0).begins(10**12, 1.0, 0.0)


def test_held_object_bears_a_pull_within_its_friction_and_is_lost_to_one_beyond() -> None:
    plain, light = judged(), judged("pull.force_n=3")
    assert light.success and plain.slip_distance_m == pytest.approx(light.slip_distance_m, abs=1e-3)
    heavy = judged("pull.force_n=120")
    assert not heavy.success
