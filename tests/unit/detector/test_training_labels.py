"""What a network learns from is a setting: slip by speed, or how far it has moved."""

import msgspec
import numpy as np

from detector.training.sequences import digest, fingers_of
from detector.training.settings import DEFAULTS
from tests.unit.detector.toys import toys

MADE = [
    msgspec.structs.replace(r, moved_m=(np.cumsum(r.slip) * r.slip * 1e-4).astype(np.float32))
    for r in toys("train", 2, 0)
]


def test_every_default_still_learns_the_papers_label() -> None:
    assert {settings.label for settings in DEFAULTS.values()} == {"slip"}


def test_sequences_have_the_label_and_the_distance_that_are_asked_for() -> None:
    slip, near, far = (
        fingers_of(MADE, "slip"), fingers_of(MADE, "moved", 0.001), fingers_of(MADE, "moved", 0.01)
    )  # fmt: skip
    assert slip.slip_share > near.slip_share > far.slip_share > 0.0
    for r, label in zip(MADE, near.labels, strict=True):
        assert r.moved_m is not None
        assert (label == (r.moved_m > 0.001)).all()


def test_recordings_that_moved_otherwise_are_other_data() -> None:
    still = [
        msgspec.structs.replace(r, moved_m=0 * r.moved_m) for r in MADE if r.moved_m is not None
    ]
    assert digest(still) != digest(MADE)
