"""The ideal observer: its moments, its scores and its ensemble."""

import msgspec
import numpy as np
import pytest

from detector.recordings import Recording
from studies import ideal_observer as study
from studies.ideal_observer import (
    Cases,
    Row,
    Separation,
    cases,
    features,
    held_out,
    lifts,
    separation,
    taps,
)
from tests.unit.detector.impact_recordings import impact_recording
from tests.unit.detector.toy_recordings import toy


def lift(grip: int, onset: int | None, speed_mps: float) -> Recording:
    """A hand that grips at a sample; its object slips from another sample on."""
    counts = np.random.default_rng(0).integers(-1, 2, (900, 3, 6)).astype(np.int16)
    counts[grip:800] -= 60
    slip = np.zeros(900, bool)
    if onset is not None:
        slip[onset : onset + 80] = True
    metadata = msgspec.structs.replace(toy(0, "test").metadata, disturbances=())
    speed = np.where(slip, speed_mps, 0.0).astype(np.float32)
    t_s = np.arange(900) * 0.01
    return Recording(t_s, counts, slip, slip, "lift", metadata, contact_speed_mps=speed)


def test_a_tap_has_the_class_of_its_lasting_displacement() -> None:
    moments = taps(
        [impact_recording((3.0, 0.0), (4.5, 0.0007)), impact_recording((3.0, 0.0015), (4.5, 0.004))]
    )
    assert [(i, kind) for i, _, _, kind in moments] == [(0, 0), (0, 1), (1, 2), (1, 3)]


def test_moments_of_held_lifts_have_the_delays_of_slipping_lifts() -> None:
    moments = lifts([lift(100, 160, 0.01), lift(150, 230, 0.1), lift(200, None, 0.0)])
    assert [(m[0], m[1], m[3]) for m in moments[:2]] == [(0, 160, 1), (1, 230, 3)]
    assert {(m[0], m[3]) for m in moments[2:]} == {(2, 0)}
    assert {m[1] for m in moments[2:]} <= {260, 280}


def test_features_do_not_depend_on_what_comes_later() -> None:
    hand = impact_recording((3.0, 0.003))
    later = hand.counts.copy()
    later[305:] += 100  # five samples after the tap
    both = [cases([r], taps([r]), ()) for r in (hand, msgspec.structs.replace(hand, counts=later))]
    early, late = ([features(c, t_s) for c in both] for t_s in (0.05, 0.06))
    assert (early[0] == early[1]).all() and (late[0] != late[1]).any()


def test_hits_are_counted_above_all_but_a_twentieth_of_rest_and_shown() -> None:
    score = np.concatenate([np.arange(100.0), np.array([94.5, 93.0, 200.0, 201.0, np.nan])])
    classes = np.where(np.arange(105) >= 100, 1, 0)
    its = Cases(np.zeros((105, 100, 3, 6)), np.full(105, 50), classes, np.arange(105) % 7, {})
    found = separation(its, score, 1, "energy", "0.5-1 mm")
    assert (found.hits, found.n, found.rest) == (0.75, 4, 100)
    assert found.interval[0] <= 0.75 <= found.interval[1]
    table = study.STUDY.table([Row("tap", 0.1, [found])])
    assert "tap, 0.5-1 mm: 4, and 100 at rest" in table and "| 100 | energy |" in table
    assert isinstance(found, Separation)


@pytest.mark.train
def test_a_group_is_predicted_from_the_other_groups_only() -> None:
    """Labels agree with the features in all groups but one, where they are swapped."""
    pytest.importorskip("torch")
    rng = np.random.default_rng(0)
    groups, known = np.repeat(np.arange(5), 60), rng.standard_normal((300, 8))
    agrees = (known[:, 0] > 0).astype(np.intp)
    classes = np.where(groups == 4, 1 - agrees, agrees)
    one, other = (held_out(known, classes, groups).argmax(axis=1) for _ in range(2))
    assert (one == agrees)[groups == 4].mean() > 0.9 and (one == other).all()
