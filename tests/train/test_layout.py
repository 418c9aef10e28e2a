"""A network for fingertips of another layout: trained, exported, read back, and told apart."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from detector.interface import load_detector  # noqa: E402
from detector.recordings import Recording  # noqa: E402
from detector.training.export import export  # noqa: E402
from detector.training.fit import Training  # noqa: E402
from detector.training.sequences import digest  # noqa: E402
from detector.training.settings import TrainSettings  # noqa: E402
from drivers.errors import UsageError  # noqa: E402
from tests.unit.detector.toys import toys  # noqa: E402

pytestmark = pytest.mark.train

QUICK = TrainSettings(steps=20, batch=4, crop=60, validations=2)


def eight(recordings: list[Recording]) -> list[Recording]:
    """The same with two more taxels."""
    return [
        msgspec.structs.replace(r, counts=np.concatenate([r.counts, r.counts[:, :, :2]], axis=2))
        for r in recordings
    ]


TRAIN, VALIDATION = eight(toys("train", 6, 0)), eight(toys("validation", 2, 100))


@pytest.mark.parametrize("name", ["tcn", "gru", "tcn-paper"])
def test_a_network_of_eight_taxels_is_trained_exported_and_refused_by_six(
    name: str, tmp_path: Path
) -> None:
    settings = QUICK
    if name == "tcn-paper":
        settings = msgspec.structs.replace(QUICK, dense=False, balance="undersample", batch=32)
    made = Training(name, settings, TRAIN, VALIDATION, digest(TRAIN))
    made.run(5.0, None, lambda progress: None)
    path = tmp_path / "mine.onnx"
    export(made, VALIDATION, path, "here")
    detector = load_detector("mine", {"weights": str(path)}, 3, 8)
    assert detector.update(np.zeros((3, 8), np.int16)).shape == (3,)
    with pytest.raises(UsageError, match="'mine' was made for fingertips of 8 taxels, not of 6"):
        load_detector("mine", {"weights": str(path)}, 3, 6)


def test_an_image_of_taxels_has_no_place_for_more() -> None:
    with pytest.raises(UsageError, match="'freq-cnn' was made for fingertips of 6 taxels"):
        Training("freq-cnn", QUICK, TRAIN, VALIDATION, digest(TRAIN))


def test_recordings_of_two_layouts_train_nothing() -> None:
    mixed = [*TRAIN, *toys("train", 1, 50)]
    with pytest.raises(UsageError, match="6 and 8 taxels"):
        Training("tcn", QUICK, mixed, VALIDATION, digest(mixed))
