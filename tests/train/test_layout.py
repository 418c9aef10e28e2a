"""A network for another layout of fingertips: trained, exported, lifted with, and refused."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from detector.loading import load_detector  # noqa: E402
from detector.recordings import Recording, read  # noqa: E402
from detector.training.export import export  # noqa: E402
from detector.training.fit import Training  # noqa: E402
from detector.training.sequences import digest  # noqa: E402
from detector.training.settings import TrainSettings  # noqa: E402
from drivers.errors import UsageError  # noqa: E402
from grasp.cli import exits  # noqa: E402
from grasp.cli.main import main  # noqa: E402
from scenarios.acquire.config import layout_file  # noqa: E402
from scenarios.lift.scoring import LiftOutcome, LiftResult  # noqa: E402
from tests.unit.detector.toy_recordings import toys  # noqa: E402

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
def test_network_of_eight_taxels_is_trained_exported_and_refused_for_six(
    name: str, tmp_path: Path
) -> None:
    settings = QUICK
    if name == "tcn-paper":
        settings = msgspec.structs.replace(QUICK, dense=False, balance="undersample", batch=32)
    made = Training(name, settings, TRAIN, VALIDATION, digest(TRAIN))
    made.run(5.0, None, lambda loss, score: None)
    path = tmp_path / "mine.onnx"
    export(made, VALIDATION, path, "here")
    detector = load_detector("mine", {"weights": str(path)}, 3, 8)
    assert detector.update(np.zeros((3, 8), np.int16)).shape == (3,)
    with pytest.raises(UsageError, match="'mine' was made for fingertips of 8 taxels, not of 6"):
        load_detector("mine", {"weights": str(path)}, 3, 6)


def test_frequency_cnn_is_refused_for_eight_taxels() -> None:
    with pytest.raises(UsageError, match="'freq-cnn-paper' was made for fingertips of 6 taxels"):
        Training("freq-cnn-paper", QUICK, TRAIN, VALIDATION, digest(TRAIN))


def test_recordings_of_two_layouts_are_refused() -> None:
    mixed = [*TRAIN, *toys("train", 1, 50)]
    with pytest.raises(UsageError, match="6 and 8 taxels"):
        Training("tcn", QUICK, mixed, VALIDATION, digest(mixed))


STROKES = """
name = "eight"
seed = 77
layout = "eight"
static_samples = 900
slip_samples = 700
recording_samples = 500
least_recordings = 3
[[rows]]
motion = "primary"
speed = 0.05
percent = { planar = 100.0 }
[randomise]
"surface.texture_rms_m" = [0.00005, 0.0004]
"surface.friction_kinetic" = [0.55, 1.0]
"""


@pytest.mark.timeout(600)  # twenty seconds of processor time, all of it beside other work
def test_from_an_acquisition_to_a_lift_with_eight_taxels_as_a_user_types_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    eight_taxels = ("--config", str(layout_file("eight")), "--rig", "simulated", "--pace", "max")
    runs, data, weights = tmp_path / "runs", tmp_path / "set", tmp_path / "mine.onnx"
    (tmp_path / "strokes.toml").write_text(STROKES)

    def typed(*words: str) -> int:
        return main([*words, "--json"])

    acquired = typed("run", "acquire", *eight_taxels, "--seconds", "2", "--runs", str(runs))
    assert acquired == exits.SUCCESS
    (samples,) = runs.glob("*/samples.npz")
    assert read(samples).taxels == 8

    built = typed("dataset", "build", str(tmp_path / "strokes.toml"), "--out", str(data))
    assert built == exits.SUCCESS
    quick = ("--steps", "20", "--out", str(weights))
    assert typed("detector", "train", "tcn", "--data", str(data), *quick) == exits.SUCCESS

    capsys.readouterr()
    chosen = ("--detector", "tcn", "--set", f"network.weights={weights}", "--runs", str(runs))
    lifted = typed("run", "lift", *eight_taxels, *chosen)
    assert lifted in (exits.SUCCESS, exits.TRIAL_FAILED)  # a network of 20 steps may miss slip
    result = msgspec.json.decode(capsys.readouterr().out, type=LiftResult)
    assert result.outcome not in (LiftOutcome.FAULT, LiftOutcome.INTERNAL_ERROR)

    assert typed("run", "lift", "--rig", "simulated", *chosen) == exits.USAGE
    assert "made for fingertips of 8 taxels, not of 6" in capsys.readouterr().out
