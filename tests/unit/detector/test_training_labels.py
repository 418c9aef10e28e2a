"""What a network learns from is a setting: slip by speed, or how far it has moved."""

import msgspec
import numpy as np
import pytest

from detector.training.sequences import (
    IMPACT_SAMPLES,
    UNMOVED_WEIGHT,
    crops,
    digest,
    fingers_of,
    targets,
)
from tests.unit.detector.impact_toys import struck
from tests.unit.detector.toys import toys

MADE = [
    msgspec.structs.replace(r, moved_m=(np.cumsum(r.slip) * r.slip * 1e-4).astype(np.float32))
    for r in toys("train", 2, 0)
]


def test_sequences_have_the_label_that_is_asked_for() -> None:
    slip, moved = (fingers_of(MADE, label) for label in ("slip", "moved"))
    assert slip.slip_share > moved.slip_share > 0.0
    for r, label in zip(MADE, moved.labels, strict=True):
        assert r.moved_m is not None
        assert (label == (r.moved_m > 0.001)).all()


def test_recordings_that_moved_otherwise_are_other_data() -> None:
    still = [
        msgspec.structs.replace(r, moved_m=0 * r.moved_m) for r in MADE if r.moved_m is not None
    ]
    assert digest(still) != digest(MADE)


def test_an_impact_teaches_by_what_it_moved_and_not_by_its_own_length() -> None:
    recording = struck((2.0, 0.003), (4.0, 0.0008), (6.0, 0.0001))
    labels, weights = targets(recording, "slip")
    assert np.flatnonzero(labels).tolist() == list(range(203, 203 + IMPACT_SAMPLES))
    assert set(weights[200:250]) == {1.0}
    assert set(weights[400:450]) == {0.0}
    assert set(weights[600:650]) == {UNMOVED_WEIGHT}
    assert weights.sum() == 900 - 50 + 50 * (UNMOVED_WEIGHT - 1)
    assert set(targets(recording, "slip_true")[1]) == {1.0}


def test_the_fingers_of_a_hand_are_drawn_together() -> None:
    hands = fingers_of([*toys("train", 2, 0), struck((2.0, 0.003))], "slip")
    assert hands.hands.tolist() == [0, 1, 2, 2, 2]
    batch = crops(hands, np.random.default_rng(0), 12, 40, 20, fresh=0.0)
    assert 12 <= len(batch.counts) <= 14
    for hand in range(int(batch.hands[-1]) + 1):
        rows = np.flatnonzero(batch.hands == hand)
        assert len(rows) in (1, 3)
        assert (batch.counts[rows] == batch.counts[rows[0]]).all()


def test_a_hand_teaches_as_much_as_a_finger_alone_of_as_many_samples() -> None:
    """Drawn and weighed finger by finger, a hand of three would count nine times."""
    single = toys("train", 1, 0)
    fingers = fingers_of([*single, struck((2.0, 0.003))], "slip_true")
    rng = np.random.default_rng(0)
    taught = np.zeros(2)
    for _ in range(300):
        batch = crops(fingers, rng, 6, 40, 20, fresh=0.0)
        for hand in range(int(batch.hands[-1]) + 1):
            rows = batch.hands == hand
            taught[int(rows.sum() > 1)] += batch.weights[rows].sum()
    samples = np.array([len(single[0].t_s), 900])
    assert taught[1] / taught[0] == pytest.approx(samples[1] / samples[0], rel=0.25)
    whole = np.concatenate([r.label("slip_true") for r in (*single, struck((2.0, 0.003)))])
    assert fingers.slip_share == pytest.approx(whole.mean())
