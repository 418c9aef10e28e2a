"""The ensemble that says of every sample what could be known of it."""

import msgspec
import numpy as np
import pytest

pytest.importorskip("torch")

from detector.scores.evaluation import Streamed
from detector.training.sample_observer import features, fused_features, held_out
from tests.unit.detector.blow_toys import struck
from tests.unit.detector.toys import toy

pytestmark = pytest.mark.train


def told(recording, seed=0):
    p = np.random.default_rng(seed).uniform(0.01, 0.99, (len(recording.t_s), recording.fingers))
    return Streamed(recording, p, np.empty(0))


def test_what_is_known_of_a_sample_rests_on_none_that_comes_later() -> None:
    recording = toy(0, "test")
    changed = recording.counts.copy()
    changed[200:] += 50
    other = msgspec.structs.replace(recording, counts=changed)
    said = [told(recording)]
    now, then = features(recording, said), features(other, said)
    assert np.array_equal(now[:200], then[:200])
    assert not np.array_equal(now[200:], then[200:])
    later = features(recording, said, ahead=20)
    assert np.array_equal(later[:180], now[20:200])


def test_a_head_for_a_hand_does_not_know_which_finger_it_was() -> None:
    recording = struck((2.0, 0.003))
    said = told(recording)
    turned = Streamed(recording, said.probabilities[:, ::-1], np.empty(0))
    assert np.array_equal(fused_features(said), fused_features(turned))


def test_a_recording_is_told_by_an_ensemble_that_has_not_learnt_from_it() -> None:
    """One whose labels are turned round is told as the others are: by their labels."""
    recordings = [toy(k, "test") for k in range(4)]
    last = recordings[3]
    recordings[3] = msgspec.structs.replace(last, slip=~last.slip)
    known = [
        np.stack([slip + 0.0, 1.0 - slip], axis=1).astype(np.float32)
        for slip in (r.slip if i < 3 else last.slip for i, r in enumerate(recordings))
    ]
    said = held_out(recordings, known, folds=4)
    assert ((said[3][:, 0] > 0.5) == last.slip).all()
    assert [len(p) for p in said] == [len(r.t_s) for r in recordings]
