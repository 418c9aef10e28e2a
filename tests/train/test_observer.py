"""The ensemble behind the ideal observer."""

import numpy as np
import pytest

pytest.importorskip("torch")

from detector.training.observer import held_out


def test_what_is_told_of_a_group_was_learnt_from_others_alone() -> None:
    """Labels agree with the features in all groups but one, whose labels are turned round: were it
    learnt from, it would be told by its own."""
    rng = np.random.default_rng(0)
    groups = np.repeat(np.arange(5), 60)
    features = rng.standard_normal((300, 8))
    agrees = (features[:, 0] > 0).astype(np.intp)
    classes = np.where(groups == 4, 1 - agrees, agrees)
    told = held_out(features, classes, groups, folds=5).argmax(axis=1)
    assert (told == agrees)[groups == 4].mean() > 0.9
    assert (told == agrees).mean() > 0.85


def test_equal_seeds_tell_the_same() -> None:
    rng = np.random.default_rng(1)
    features, groups = rng.standard_normal((80, 4)), np.arange(80) % 4
    classes = (features[:, 1] > 0).astype(np.intp)
    one, other = (held_out(features, classes, groups, folds=2, seed=3) for _ in range(2))
    assert (one == other).all()
