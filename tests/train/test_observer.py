"""The ensemble behind the ideal observer."""

import numpy as np
import pytest

pytest.importorskip("torch")

from detector.training.observer import held_out
from drivers.errors import UsageError
from scenarios.studies.detectors.observer import BLOW_TITLES, FOLDS, Cases
from scenarios.studies.detectors.observer_study import require_every_class

pytestmark = pytest.mark.train


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


def test_a_class_in_too_few_recordings_is_refused_before_anything_is_learnt() -> None:
    kinds = len(BLOW_TITLES)
    classes = np.repeat(np.arange(kinds), FOLDS)
    groups = np.tile(np.arange(FOLDS), kinds)
    nothing = np.zeros((len(classes), 2, 3, 6))
    cases = Cases(nothing, 1, 0.01, np.ones(len(classes), np.intp), classes, groups, {}, {})
    require_every_class(cases, BLOW_TITLES)
    groups[-1] = 0
    with pytest.raises(UsageError, match=f"{BLOW_TITLES[-1]!r} is in {FOLDS - 1} recordings"):
        require_every_class(cases, BLOW_TITLES)
