"""Sampling of training data: shares of recordings by cause, and crops around impacts."""

import msgspec
import numpy as np
import pytest

from detector.recordings import Recording
from detector.training.sequences import (
    AFTER_IMPACT,
    BEFORE_IMPACT,
    IMPACT_SAMPLES,
    finger_sequences,
    random_crops,
    sampling_shares,
)
from tests.unit.detector.impact_recordings import impact_recording
from tests.unit.detector.toy_recordings import toys


def of_cause(recording: Recording, cause: str) -> Recording:
    assert recording.metadata is not None
    return msgspec.structs.replace(
        recording, metadata=msgspec.structs.replace(recording.metadata, cause=cause)
    )


MADE = [of_cause(r, c) for r, c in zip(toys("train", 4, 0), "aaab", strict=True)]


def test_recordings_are_sampled_in_proportion_to_their_samples() -> None:
    lengths = np.array([len(r.t_s) for r in MADE])
    assert sampling_shares(MADE, 0.0) == pytest.approx(lengths / lengths.sum())


def test_with_full_evenness_rare_and_common_causes_are_sampled_equally() -> None:
    assert sampling_shares(MADE, 1.0)[3] == pytest.approx(0.5)


def test_crop_around_an_impact_has_it_in_the_samples_with_a_loss() -> None:
    impact, warm, crop = 400, 20, 160
    fingers = finger_sequences([*toys("train", 3, 0), impact_recording((4.0, 0.003))], "slip")
    assert fingers.impacts.tolist() == [[3, impact]]
    batch = random_crops(
        fingers, np.random.default_rng(0), 12, crop, warm, fresh=0.0, near_impacts=1.0
    )
    assert set(np.bincount(batch.hands)) == {3}
    onset = batch.labels.argmax(axis=1)  # the label rises three samples after the impact
    assert (batch.labels.sum(axis=1) == IMPACT_SAMPLES).all()
    assert onset.min() >= warm + BEFORE_IMPACT
    assert onset.max() <= warm + crop - AFTER_IMPACT + 3


def test_crop_around_an_early_impact_starts_at_the_first_sample() -> None:
    fingers = finger_sequences([impact_recording((0.5, 0.003))], "slip")
    batch = random_crops(fingers, np.random.default_rng(0), 6, 100, 99, fresh=1.0, near_impacts=1.0)
    assert (batch.labels.sum(axis=1) == IMPACT_SAMPLES).all()
