"""A pull on a held object, and damaged fingertips."""

from collections.abc import Callable

import numpy as np
import pytest

from scenarios.world.cell import PullTrigger, TaxelDamage
from scenarios.world.settings import DamageSettings, PullSettings
from tests.unit.scenarios.conftest import judged

MS = 1_000_000
NOISE = 0.3  # counts


def codes(seed: int, taxels: int = 6) -> np.ndarray:
    return np.random.default_rng(seed).integers(200, 500, (3, taxels)).astype(np.int16)


def damaged(**settings: float) -> Callable[[np.ndarray], np.ndarray]:
    return TaxelDamage(DamageSettings(**settings), NOISE, np.random.default_rng(0)).apply


@pytest.mark.parametrize("taxels", [6, 8])
def test_lost_taxels_are_constant_and_the_others_are_not(taxels: int) -> None:
    apply = damaged(taxels_lost=0.5)
    first, later = apply(codes(0, taxels)), apply(codes(1, taxels))
    constant = later == first
    assert constant.sum(axis=1).tolist() == [taxels // 2] * 3
    assert (later == codes(1, taxels))[~constant].all()


def test_pull_begins_once_after_the_arm_has_been_at_rest_in_the_air() -> None:
    pull = PullTrigger(PullSettings(force_n=5.0), 0)
    motion = [
        (0, 0.0, 0.0), (500, 0.0, 0.0),  # on the table
        (600, 0.1, 0.1), (700, 0.2, 0.1),  # on its way up
        (800, 0.2, 0.0), (899, 0.2, 0.0), (900, 0.2, 0.0), (2000, 0.2, 0.0),
    ]  # fmt: skip
    assert [pull.begins(t * MS, height, rise) for t, height, rise in motion] == [False] * 6 + [
        True, False,
    ]  # fmt: skip
    assert not PullTrigger(PullSettings(), 0).begins(10**12, 1.0, 0.0)


def test_held_object_resists_a_pull_below_its_friction_and_is_lost_to_a_stronger_one() -> None:
    plain, light = judged(), judged("pull.force_n=3")
    assert light.success and plain.slip_distance_m == pytest.approx(light.slip_distance_m, abs=1e-3)
    heavy = judged("pull.force_n=120")
    assert not heavy.success
