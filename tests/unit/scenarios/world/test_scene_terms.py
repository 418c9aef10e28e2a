"""A pull on what is held, damaged fingertips, an object wider than planned."""

from collections.abc import Callable

import numpy as np
import pytest

from scenarios.lift import lift
from scenarios.world import laws
from scenarios.world.contact import Contact
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.scene_terms import Damage, DamageSettings, Pull, PullSettings
from scenarios.world.world_settings import Level
from tests.unit.scenarios.conftest import config, judged
from tests.unit.scenarios.world.test_contact import body

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


def test_lost_gain_leaves_its_share_of_every_change_from_rest() -> None:
    felt = damaged(gain_lost=0.75)
    rest = felt(codes(0)).astype(float)
    change = felt(codes(1)) - rest
    assert change == pytest.approx(0.25 * (codes(1) - rest), abs=0.5 + 4 * NOISE)
    deaf = damaged(gain_lost=1.0)
    heard = np.array([deaf(codes(0 if k == 0 else 1)) for k in range(400)])
    assert abs(heard - codes(0)).max() <= 2
    assert heard[1:].std() == pytest.approx(codes(0).std(), rel=0.01)
    assert 0.25 < (heard - codes(0)).std() < 0.4


def test_pull_begins_once_when_the_arm_has_stood_long_enough_in_the_air() -> None:
    pull = Pull(PullSettings(force_n=5.0, after_s=0.2), 0)
    told = [
        (0, 0.0, 0.0), (500, 0.0, 0.0),  # on the table
        (600, 0.1, 0.1), (700, 0.2, 0.1),  # on its way up
        (800, 0.2, 0.0), (899, 0.2, 0.0), (900, 0.2, 0.0), (2000, 0.2, 0.0),
    ]  # fmt: skip
    assert [pull.begins(t * MS, height, rise) for t, height, rise in told] == [False] * 6 + [
        True, False,
    ]  # fmt: skip
    assert not Pull(PullSettings(), 0).begins(10**12, 1.0, 0.0)


def test_force_of_a_pull_ramps_up_stands_and_ramps_down() -> None:
    held = Contact(ContactSettings(), body(), Level.SLIDER)
    assert laws.pull_force(held.state, 1.0) == 0.0
    held.pull(PullSettings(force_n=8.0, ramp_s=0.1, lasts_s=0.3), 1.0)
    at = {0.9: 0.0, 1.05: 4.0, 1.1: 8.0, 1.4: 8.0, 1.45: 4.0, 1.6: 0.0}
    assert {t: laws.pull_force(held.state, t) for t in at} == pytest.approx(at, abs=1e-9)


def test_held_object_bears_a_pull_within_its_friction_and_is_lost_to_one_beyond() -> None:
    plain, light = judged(), judged("pull.force_n=3")
    assert light.success and plain.slip_distance_m == pytest.approx(light.slip_distance_m, abs=1e-3)
    heavy = judged("pull.force_n=40", "pull.lasts_s=1")
    assert not heavy.success


@pytest.mark.parametrize("seed", [1, 2])
def test_hand_with_one_living_taxel_a_finger_is_refused_although_that_one_feels_the_object(
    seed: int,
) -> None:
    finished = lift.run(config("damage.taxels_lost=0.84"), seed, None)
    assert finished.failure is not None
    assert finished.failure.message.startswith("fingertip_deaf: 5 of finger A's 6 taxels")
