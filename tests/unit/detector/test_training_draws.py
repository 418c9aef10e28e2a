"""What a network is shown how often: recordings of every cause, and the impacts among them."""

import msgspec
import numpy as np
import pytest

from detector.recordings import Recording
from detector.training.sequences import (
    AFTER_IMPACT,
    BEFORE_IMPACT,
    IMPACT_SAMPLES,
    crops,
    fingers_of,
    shares,
)
from tests.unit.detector.impact_toys import struck
from tests.unit.detector.toys import toys


def of_cause(recording: Recording, cause: str) -> Recording:
    assert recording.metadata is not None
    return msgspec.structs.replace(
        recording, metadata=msgspec.structs.replace(recording.metadata, cause=cause)
    )


MADE = [of_cause(r, c) for r, c in zip(toys("train", 4, 0), "aaab", strict=True)]


def test_recordings_are_drawn_as_often_as_they_have_samples() -> None:
    lengths = np.array([len(r.t_s) for r in MADE])
    assert shares(MADE, 0.0) == pytest.approx(lengths / lengths.sum())


def test_with_full_evenness_a_rare_cause_is_drawn_as_often_as_a_common_one() -> None:
    assert shares(MADE, 1.0)[3] == pytest.approx(0.5)


def test_a_stretch_that_is_drawn_for_an_impact_has_it_where_it_is_learnt_from() -> None:
    impact, warm, crop = 400, 20, 160
    fingers = fingers_of([*toys("train", 3, 0), struck((4.0, 0.003))], "slip")
    assert fingers.impacts.tolist() == [[3, impact]]
    batch = crops(fingers, np.random.default_rng(0), 12, crop, warm, fresh=0.0, near_impacts=1.0)
    assert set(np.bincount(batch.hands)) == {3}
    onset = batch.labels.argmax(axis=1)  # this impact's label rises three samples after it struck
    assert (batch.labels.sum(axis=1) == IMPACT_SAMPLES).all()
    assert onset.min() >= warm + BEFORE_IMPACT
    assert onset.max() <= warm + crop - AFTER_IMPACT + 3


def test_an_impact_in_a_recordings_first_samples_is_drawn_from_its_beginning() -> None:
    fingers = fingers_of([struck((0.5, 0.003))], "slip")
    batch = crops(fingers, np.random.default_rng(0), 6, 100, 99, fresh=1.0, near_impacts=1.0)
    assert (batch.labels.sum(axis=1) == IMPACT_SAMPLES).all()
