"""What a training is shown that a hand may have and its data has not."""

import numpy as np
import pytest

from detector.training import augment as module
from detector.training.augment import augment

BATCH, TIME, TAXELS = 400, 60, 6


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Nothing but the turns is changed, until a test asks for more."""
    still = {"GAIN": 1.0, "OFFSET_COUNTS": 0.0, "NOISE_COUNTS": 0.0, "LOST_SHARE": 0.0,
             "DEAD_SHARE": 0.0, "STUCK_SHARE": 0.0, "SWAPPED_SHARE": 0.0}  # fmt: skip
    for name, value in still.items():
        monkeypatch.setattr(module, name, value)
    monkeypatch.setattr(module, "symmetries", lambda taxels: np.tile(np.arange(taxels), (4, 1)))
    return monkeypatch


def ramps() -> np.ndarray:
    """Counts that rise, of each taxel from a hundred of its own."""
    rising = np.arange(TIME)[:, None] + 100.0 * np.arange(TAXELS)
    return np.tile(rising.astype(np.float32), (BATCH, 1, 1))


def ours(seed: int = 0) -> np.ndarray:
    return augment(ramps(), "ours", np.random.default_rng(seed))


def test_a_stuck_taxel_stays_where_it_stood_and_the_others_move_on(
    alone: pytest.MonkeyPatch,
) -> None:
    alone.setattr(module, "STUCK_SHARE", 0.1)
    changed = ours()
    stuck = (np.diff(changed, axis=1) == 0).all(axis=1)
    assert 0.07 < stuck.mean() < 0.13
    assert np.array_equal(changed[:, 0], ramps()[:, 0])
    assert np.array_equal(changed.transpose(0, 2, 1)[~stuck], ramps().transpose(0, 2, 1)[~stuck])


def test_two_taxels_of_a_finger_stand_in_each_other_s_place(alone: pytest.MonkeyPatch) -> None:
    alone.setattr(module, "SWAPPED_SHARE", 0.3)
    orders = np.round(ours()[:, 0] / 100).astype(int)
    elsewhere = (orders != np.arange(TAXELS)).sum(axis=1)
    assert set(elsewhere) == {0, 2}
    assert 0.22 < (elsewhere == 2).mean() < 0.38
    assert all(sorted(order) == list(range(TAXELS)) for order in orders)
    pairs = {tuple(np.flatnonzero(order != np.arange(TAXELS))) for order in orders[elsewhere == 2]}
    assert len(pairs) == TAXELS * (TAXELS - 1) // 2


def test_the_same_draw_is_the_same_change_and_its_argument_stays() -> None:
    counts = ramps()
    assert np.array_equal(ours(3), ours(3))
    augment(counts, "ours", np.random.default_rng(3))
    assert np.array_equal(counts, ramps())
