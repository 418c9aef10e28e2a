"""The benchmark tells a network that has hardly learnt from the packaged one."""

from pathlib import Path

import msgspec
import pytest

pytest.importorskip("torch")

from detector.recordings import read
from detector.training.export import export
from detector.training.fit import Training
from detector.training.settings import DEFAULTS
from scenarios.benchmark.run import Benchmark
from scenarios.benchmark.score_file import References
from tests.unit.scenarios.benchmark.conftest import (
    Recordings,
    benchmark,
    recordings,
    references,
    settings,
    small,
)

__all__ = ["benchmark", "recordings", "references", "small"]  # fixtures
pytestmark = [pytest.mark.train, pytest.mark.timeout(900)]


def test_a_network_of_sixty_steps_scores_less_than_the_packaged_one(
    benchmark: Benchmark, references: References, recordings: Recordings, tmp_path: Path
) -> None:
    learn = [read(path) for paths in recordings.values() for path in paths]  # those that are scored
    steps = msgspec.structs.replace(DEFAULTS["tcn"], steps=60, validations=1)
    training = Training("tcn", steps, learn, learn, "")
    training.run(60.0, None, lambda *_: None)
    path = tmp_path / "sixty.onnx"
    export(training, learn, path, "")
    hasty, packaged = (
        benchmark.detector(settings("tcn", *words), references)
        for words in ([f"network.weights={path}"], [])
    )
    assert hasty.point.raw.value < packaged.point.raw.value
