"""Labels and weights of training data."""

import msgspec
import numpy as np
import pytest

from detector.training.sequences import (
    IMPACT_SAMPLES,
    UNMOVED_WEIGHT,
    digest,
    finger_sequences,
    random_crops,
    targets,
)
from tests.unit.detector.impact_recordings import impact_recording
from tests.unit.detector.toy_recordings import toys

MADE = [
    msgspec.structs.replace(r, moved_m=(np.cumsum(r.slip) * r.slip * 1e-4).astype(np.float32))
    for r in toys("train", 2, 0)
]


def test_sequences_have_the_chosen_label() -> None:
    slip, moved = (finger_sequences(MADE, label) for label in ("slip", "moved"))
    assert slip.slip_share > moved.slip_share > 0.0
    for r, label in zip(MADE, moved.labels, strict=True):
        assert r.moved_m is not None
        assert (label == (r.moved_m > 0.001)).all()


def test_digest_depends_on_the_displacement() -> None:
    still = [
        msgspec.structs.replace(r, moved_m=0 * r.moved_m) for r in MADE if r.moved_m is not None
    ]
    assert digest(still) != digest(MADE)


def test_label_of_an_impact_depends_on_its_displacement() -> None:
    recording = impact_recording((2.0, 0.003), (4.0, 0.0008), (6.0, 0.0001))
    labels, weights = targets(recording, "slip")
    assert np.flatnonzero(labels).tolist() == list(range(203, 203 + IMPACT_SAMPLES))
    assert set(weights[200:250]) == {1.0}
    assert set(weights[400:450]) == {0.0}
    assert set(weights[600:650]) == {UNMOVED_WEIGHT}
    assert weights.sum() == 900 - 50 + 50 * (UNMOVED_WEIGHT - 1)
    assert set(targets(recording, "slip_true")[1]) == {1.0}


def test_fingers_of_a_hand_are_sampled_together() -> None:
    hands = finger_sequences([*toys("train", 2, 0), impact_recording((2.0, 0.003))], "slip")
    assert hands.hands.tolist() == [0, 1, 2, 2, 2]
    batch = random_crops(hands, np.random.default_rng(0), 12, 40, 20, fresh=0.0)
    assert 12 <= len(batch.counts) <= 14
    for hand in range(int(batch.hands[-1]) + 1):
        rows = np.flatnonzero(batch.hands == hand)
        assert len(rows) in (1, 3)
        assert (batch.counts[rows] == batch.counts[rows[0]]).all()


def test_hand_has_the_same_weight_as_a_single_finger_with_as_many_samples() -> None:
    """If fingers were sampled and weighted singly, a hand of three would count nine times."""
    single = toys("train", 1, 0)
    fingers = finger_sequences([*single, impact_recording((2.0, 0.003))], "slip_true")
    rng = np.random.default_rng(0)
    weight = np.zeros(2)
    for _ in range(300):
        batch = random_crops(fingers, rng, 6, 40, 20, fresh=0.0)
        for hand in range(int(batch.hands[-1]) + 1):
            rows = batch.hands == hand
            weight[int(rows.sum() > 1)] += batch.weights[rows].sum()
    samples = np.array([len(single[0].t_s), 900])
    assert weight[1] / weight[0] == pytest.approx(samples[1] / samples[0], rel=0.25)
    whole = np.concatenate(
        [r.label("slip_true") for r in (*single, impact_recording((2.0, 0.003)))]
    )
    assert fingers.slip_share == pytest.approx(whole.mean())
