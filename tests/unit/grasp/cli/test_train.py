"""`grasp detector train` with a fake training: options, files and messages."""

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from grasp.cli import training as train
from grasp.cli.main import main


class Card(msgspec.Struct):
    """Card of a network, reduced."""

    parameters: int
    steps: int
    training_minutes: float
    validation: dict[str, float]


class Training:
    """Fake training that records its calls."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.step, self.settings, self.stalled = 2, SimpleNamespace(steps=2), False

    def resume(self, checkpoint: Path) -> None:
        self.calls.append(f"resume {checkpoint.name}")

    def run(self, minutes: float | None, checkpoint: Path, report: Any) -> None:
        checkpoint.write_text("how far it is")
        self.calls.append("run")


@pytest.fixture
def training(monkeypatch: pytest.MonkeyPatch) -> Training:
    """Fake training and export of `grasp detector train`, without torch."""
    made = Training()
    monkeypatch.setattr(train, "need", lambda *_: None)
    monkeypatch.setattr(train, "_prepare", lambda _: (made, []))
    export = SimpleNamespace(export=lambda *_: Card(1, 2, 3.0, {"accuracy": 0.9}))
    monkeypatch.setitem(sys.modules, "detector.training.export", export)
    return made


@pytest.mark.parametrize(
    ("words", "calls", "logged"),
    [([], ["run"], ""), (["--resume"], ["resume mine.checkpoint", "run"], "step 20\n")],
)
def test_training_and_its_log_start_again_unless_resumed_and_leave_no_checkpoint(
    words: list[str], calls: list[str], logged: str, tmp_path: Path, training: Training,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "mine.log").write_text("step 20\n")
    out = tmp_path / "mine.onnx"
    assert main(["detector", "train", "tcn", "--data", ".", "--out", str(out), *words]) == 0
    assert training.calls == calls
    assert [path.name for path in tmp_path.iterdir()] == ["mine.log"]
    assert (tmp_path / "mine.log").read_text() == logged
    assert "accuracy on validation 0.900" in capsys.readouterr().out


def test_existing_weights_are_overwritten_only_with_force(
    tmp_path: Path, training: Training, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine.onnx"
    out.write_text("of last week")
    (tmp_path / "mine.toml").write_text("its rule")
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(out)]
    assert main(words) == 2
    assert f"{out} exists already" in capsys.readouterr().err
    assert training.calls == [] and out.read_text() == "of last week"
    assert main([*words, "--force"]) == 0
    assert training.calls == ["run"]
    assert "mine.toml is for other weights" in capsys.readouterr().err


def test_an_unfinished_training_is_continued_or_restarted_only_on_request(
    tmp_path: Path, training: Training, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.checkpoint").write_text("of an hour ago")
    (tmp_path / "mine.log").write_text("its first hour")
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(tmp_path / "mine.onnx")]
    assert main(words) == 2
    assert "mine.checkpoint is of an unfinished training" in capsys.readouterr().err
    assert training.calls == [] and (tmp_path / "mine.log").read_text() == "its first hour"
    assert main([*words, "--force"]) == 0


def test_an_interrupted_training_states_its_checkpoint_and_how_to_continue(
    tmp_path: Path, training: Training, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def run(minutes: float | None, checkpoint: Path, report: Any) -> None:
        checkpoint.write_text("how far it is")
        training.step, training.settings.steps = 120, 2000
        raise KeyboardInterrupt

    monkeypatch.setattr(training, "run", run)
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(tmp_path / "mine.onnx")]
    assert main(words) == 130
    expected = (
        f"interrupted at step 120 of 2000, saved in {tmp_path / 'mine.checkpoint'} (to continue"
    )
    output = capsys.readouterr().err
    assert expected in output and "with --resume" in output
    assert (tmp_path / "mine.checkpoint").is_file() and not (tmp_path / "mine.onnx").exists()


def test_no_network_is_trained_on_an_incomplete_data_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(train, "need", lambda *_: None)
    monkeypatch.setitem(sys.modules, "detector.training.export", SimpleNamespace(export=None))
    (tmp_path / "dataset.json").write_text('{"recordings": 84}')
    out = tmp_path / "mine.onnx"
    words = ["detector", "train", "tcn", "--data", str(tmp_path), "--out", str(out)]
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{tmp_path}: 0 of 84 recordings exist (`grasp dataset build` continues" in line
    assert not list(tmp_path.glob("mine*"))
