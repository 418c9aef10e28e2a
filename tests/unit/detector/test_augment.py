"""Augmentation of training data."""

import numpy as np
import pytest

from detector.training import augment as module
from detector.training.augment import augment

BATCH, TIME, TAXELS = 400, 60, 6


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Disables every augmentation; a test enables one."""
    still = {"GAIN": 1.0, "OFFSET_COUNTS": 0.0, "NOISE_COUNTS": 0.0, "LOST_SHARE": 0.0,
             "DEAD_SHARE": 0.0, "STUCK_SHARE": 0.0, "SWAPPED_SHARE": 0.0}  # fmt: skip
    for name, value in still.items():
        monkeypatch.setattr(module, name, value)
    monkeypatch.setattr(module, "symmetries", lambda taxels: np.tile(np.arange(taxels), (4, 1)))
    return monkeypatch


def ramps() -> np.ndarray:
    """Rising counts, with another offset for each taxel."""
    rising = np.arange(TIME)[:, None] + 100.0 * np.arange(TAXELS)
    return np.tile(rising.astype(np.float32), (BATCH, 1, 1))


def ours(seed: int = 0) -> np.ndarray:
    return augment(ramps(), "ours", np.random.default_rng(seed))


def test_stuck_taxel_is_constant_and_the_others_are_unchanged(
    alone: pytest.MonkeyPatch,
) -> None:
    alone.setattr(module, "STUCK_SHARE", 0.1)
    changed = ours()
    stuck = (np.diff(changed, axis=1) == 0).all(axis=1)
    assert 0.07 < stuck.mean() < 0.13
    assert np.array_equal(changed[:, 0], ramps()[:, 0])
    assert np.array_equal(changed.transpose(0, 2, 1)[~stuck], ramps().transpose(0, 2, 1)[~stuck])


def test_two_taxels_of_a_finger_are_exchanged(alone: pytest.MonkeyPatch) -> None:
    alone.setattr(module, "SWAPPED_SHARE", 0.3)
    orders = np.round(ours()[:, 0] / 100).astype(int)
    exchanged = (orders != np.arange(TAXELS)).sum(axis=1)
    assert set(exchanged) == {0, 2}
    assert 0.22 < (exchanged == 2).mean() < 0.38
    assert all(sorted(order) == list(range(TAXELS)) for order in orders)
    pairs = {tuple(np.flatnonzero(order != np.arange(TAXELS))) for order in orders[exchanged == 2]}
    assert len(pairs) == TAXELS * (TAXELS - 1) // 2


def test_augmentation_is_reproducible_and_does_not_change_its_argument() -> None:
    counts = ramps()
    assert np.array_equal(ours(3), ours(3))
    augment(counts, "ours", np.random.default_rng(3))
    assert np.array_equal(counts, ramps())
