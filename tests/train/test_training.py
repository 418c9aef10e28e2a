"""Training: learning, resuming, export, and the command."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from detector.decision import RuleSettings  # noqa: E402
from detector.network import run_network  # noqa: E402
from detector.network_file import read_network  # noqa: E402
from detector.recordings import write  # noqa: E402
from detector.scores.evaluation import evaluate_streams, stream, stream_recordings  # noqa: E402
from detector.training.export import export  # noqa: E402
from detector.training.fit import Training  # noqa: E402
from detector.training.networks import odds_of, parts_of  # noqa: E402
from detector.training.sequences import Windows, digest, finger_sequences  # noqa: E402
from detector.training.settings import ARCHITECTURES, TrainSettings  # noqa: E402
from detector.training.validation import Score, calibration, likelihood  # noqa: E402
from drivers.errors import BadFile  # noqa: E402
from grasp.cli.main import main  # noqa: E402
from tests.unit.detector.toy_recordings import toys  # noqa: E402

pytestmark = pytest.mark.train

TRAIN, VALIDATION = toys("train", 6, 0), toys("validation", 2, 100)
QUICK = TrainSettings(steps=30, batch=4, crop=60, validations=3)


def training(name: str = "tcn", **changes: object) -> Training:
    settings = msgspec.structs.replace(QUICK, **changes)
    if name not in ("tcn", "gru"):
        settings = msgspec.structs.replace(settings, dense=False, balance="undersample", batch=32)
    return Training(name, settings, TRAIN, VALIDATION, digest(TRAIN))


def ignore(loss: float, score: Score | None) -> None:
    """No one watches."""


@pytest.mark.parametrize("name", ["tcn", "gru"])
def test_network_learns_to_detect_bursts(name: str, tmp_path: Path) -> None:
    t = training(name, steps=250, batch=8, validations=2)
    t.run(5.0, None, ignore)
    export(t, VALIDATION, tmp_path / "n.onnx", "here")
    loaded = read_network(tmp_path / "n.onnx")
    unseen = toys("test", 2, 200)
    streams = stream_recordings(lambda fingers, taxels: run_network(loaded, fingers), unseen)
    sheet = evaluate_streams(run_network(loaded, 1), RuleSettings(), streams, "toys")
    auc, ece = sheet["auc"], sheet["ece"]
    assert auc is not None and auc > 0.9
    assert ece is not None and ece < 0.15
    assert loaded.card.commit == "here"


def test_each_of_two_averaged_networks_learns_as_if_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    pair, arch = training("tcn", steps=5, validations=1), ARCHITECTURES["tcn"]
    pair.run(5.0, None, ignore)
    alone = {"tcn": msgspec.structs.replace(arch, parts=arch.parts[:1])}
    monkeypatch.setattr("detector.training.settings.ARCHITECTURES", alone)
    one = training("tcn", steps=5, validations=1)
    one.run(5.0, None, ignore)
    (expected,), (part, _) = parts_of(one.network), parts_of(pair.network)
    for key, value in expected.state_dict().items():
        assert torch.equal(value, part.state_dict()[key]), key


@pytest.mark.parametrize("name", ["tcn", "tcn-paper"])
def test_resumed_training_gives_the_weights_of_an_uninterrupted_one(
    name: str, tmp_path: Path
) -> None:
    whole = training(name)
    whole.run(5.0, None, ignore)

    first = training(name)

    def interrupt(loss: float, score: Score | None) -> None:
        if first.step == 17:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        first.run(5.0, tmp_path / "c", interrupt)
    second = training(name)
    second.resume(tmp_path / "c")
    assert second.step == 17
    second.run(5.0, None, ignore)
    assert second.best == whole.best
    for key, value in whole.network.state_dict().items():
        assert torch.equal(value, second.network.state_dict()[key]), key


def test_a_checkpoint_that_is_foreign_or_damaged_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c"
    training().save(path)
    others = Training("tcn", QUICK, TRAIN, VALIDATION, "others")
    for other in (training(seed=3), training("gru"), others):
        with pytest.raises(BadFile, match="other settings, data or another network") as refused:
            other.resume(path)
        assert "--force" in refused.value.remedy
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(BadFile, match="cannot be read"):
        training().resume(path)
    with pytest.raises(BadFile, match="no such file"):
        training().resume(tmp_path / "none")


def test_a_checkpoint_that_would_run_code_is_refused(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> object:
            return (Path.touch, (tmp_path / "ran",))

    torch.save({"identity": Evil()}, tmp_path / "c")
    with pytest.raises(BadFile):
        training().resume(tmp_path / "c")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("name", ["tcn", "gru", "tcn-paper", "freq-cnn-paper"])
def test_exported_network_streams_the_output_of_validation(name: str, tmp_path: Path) -> None:
    t = training(name, steps=4, validations=1)
    t.run(5.0, None, ignore)
    card = export(t, VALIDATION, tmp_path / "n.onnx", "")
    odds = odds_of(t.network, t.arch, VALIDATION[:1])[0]
    expected = 1 / (1 + np.exp(-(odds + card.shift) / card.temperature))
    streamed = stream(run_network(read_network(tmp_path / "n.onnx"), 1), VALIDATION[0].counts)[0]
    assert np.abs(streamed - expected).max() < 1e-5


def test_training_that_runs_out_of_time_gives_a_usable_network(tmp_path: Path) -> None:
    t = training(steps=10_000, validations=1)
    t.run(0.002, None, ignore)
    assert 0 < t.step < 10_000
    assert t.best is not None


def test_undersampled_epoch_has_equal_numbers_of_both_classes() -> None:
    windows = Windows(finger_sequences(TRAIN, "slip"), 100)
    chosen = windows.epoch(np.random.default_rng(0), "undersample")
    assert windows.labels[chosen].mean() == 0.5
    assert len(np.unique(chosen)) == len(chosen)
    batch = windows.take(chosen[:5])
    assert batch.counts.shape == (5, 100, 6)
    assert batch.labels[:, 0].tolist() == windows.labels[chosen[:5]].tolist()


def test_calibration_undoes_overconfidence_and_a_wrong_prior() -> None:
    rng = np.random.default_rng(0)
    odds = rng.normal(0, 2, 20_000)
    labels = rng.random(20_000) < 1 / (1 + np.exp(-odds))
    temperature, shift = calibration(odds * 3 + 1.5, labels)
    assert temperature == pytest.approx(3.0, rel=0.1)
    assert shift == pytest.approx(-1.5, abs=0.2)
    assert likelihood(odds, labels) < likelihood(odds * 3 + 1.5, labels)


def test_command_trains_logs_resumes_and_its_weights_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for i, recording in enumerate([*TRAIN, *VALIDATION]):
        write(tmp_path / f"{i}.npz", recording)
    out = tmp_path / "mine.onnx"
    words = ["detector", "train", "gru", "--data", str(tmp_path), "--out", str(out)]
    assert main([*words, "--steps", "20"]) == 0
    assert "processor minutes" in capsys.readouterr().out
    assert "validation loss" in out.with_suffix(".log").read_text()
    assert not out.with_suffix(".checkpoint").exists()
    assert main([*words, "--steps", "20", "--resume"]) == 2
    assert "no such file" in capsys.readouterr().err
