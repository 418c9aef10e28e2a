"""`grasp detector train`, without what computes: what it is asked for."""

import errno
import math
import os
import sys
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from grasp.cli import options, places, train
from grasp.cli.main import main


class Card(msgspec.Struct):
    """Of a network."""

    parameters: int
    steps: int
    training_minutes: float
    validation: dict[str, float]


class Training:
    """In place of one: what it was told."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self.step, self.settings, self.stands_still = 2, SimpleNamespace(steps=2), False

    def resume(self, checkpoint: Path) -> None:
        self.told.append(f"resume {checkpoint.name}")

    def run(self, minutes: float | None, checkpoint: Path, tell: Any) -> None:
        checkpoint.write_text("how far it is")
        self.told.append("run")


@pytest.fixture
def training(monkeypatch: pytest.MonkeyPatch) -> Training:
    """What `grasp detector train` runs and exports, without torch."""
    made = Training()
    monkeypatch.setattr(train, "need", lambda *_: None)
    monkeypatch.setattr(train, "_prepare", lambda _: (made, []))
    export = SimpleNamespace(export=lambda *_: Card(1, 2, 3.0, {"accuracy": 0.9}))
    monkeypatch.setitem(sys.modules, "detector.training.export", export)
    return made


@pytest.mark.parametrize(
    ("words", "told", "logged"),
    [([], ["run"], ""), (["--resume"], ["resume mine.checkpoint", "run"], "step 20\n")],
)
def test_training_and_its_log_begin_anew_unless_told_to_go_on_and_leave_no_checkpoint(
    words: list[str], told: list[str], logged: str, tmp_path: Path, training: Training,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "mine.log").write_text("step 20\n")
    out = tmp_path / "mine.onnx"
    assert main(["detector", "train", "tcn", "--data", ".", "--out", str(out), *words]) == 0
    assert training.told == told
    assert [path.name for path in tmp_path.iterdir()] == ["mine.log"]
    assert (tmp_path / "mine.log").read_text() == logged
    assert "accuracy on validation 0.900" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("still", "why"),
    [(True, "validation stood still (--patience)"), (False, "its minutes were spent (--minutes)")],
)
def test_a_training_that_ends_before_its_steps_says_why(
    still: bool, why: str, tmp_path: Path, training: Training, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(tmp_path / "mine.onnx")]
    assert main([*words, "--force"]) == 0
    assert "ended before" not in capsys.readouterr().err
    training.step, training.stands_still = 1, still
    assert main([*words, "--force"]) == 0
    assert f"ended before its 2 steps: {why}" in capsys.readouterr().err


def test_weights_that_are_there_are_not_written_over_unless_told_to(
    tmp_path: Path, training: Training, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine.onnx"
    out.write_text("of last week")
    (tmp_path / "mine.toml").write_text("its rule")
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(out)]
    assert main(words) == 2
    assert f"{out} is there already" in capsys.readouterr().err
    assert training.told == [] and out.read_text() == "of last week"
    assert main([*words, "--force"]) == 0
    assert training.told == ["run"]
    assert "mine.toml beside it is of other weights" in capsys.readouterr().err


def test_what_a_training_that_did_not_end_left_is_gone_on_with_or_begun_anew_on_purpose(
    tmp_path: Path, training: Training, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.checkpoint").write_text("of an hour ago")
    (tmp_path / "mine.log").write_text("its first hour")
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(tmp_path / "mine.onnx")]
    assert main(words) == 2
    assert "mine.checkpoint is of a training that did not end" in capsys.readouterr().err
    assert training.told == [] and (tmp_path / "mine.log").read_text() == "its first hour"
    assert main([*words, "--force"]) == 0


def test_a_training_tells_how_far_it_is_where_nobody_watches_a_terminal(
    tmp_path: Path, training: Training, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def run(minutes: float | None, checkpoint: Path, tell: Any) -> None:
        for step in range(1, 101):
            tell(SimpleNamespace(step=step, steps=100, loss=0.5, best=None, score=None))

    monkeypatch.setattr(training, "run", run)
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(tmp_path / "mine.onnx")]
    assert main(words) == 0
    assert "training, loss 0.500: 50 of 100" in capsys.readouterr().err


def test_a_training_that_is_interrupted_says_where_it_is_kept_and_how_it_goes_on(
    tmp_path: Path, training: Training, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def run(minutes: float | None, checkpoint: Path, tell: Any) -> None:
        checkpoint.write_text("how far it is")
        training.step, training.settings.steps = 120, 2000
        raise KeyboardInterrupt

    monkeypatch.setattr(training, "run", run)
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(tmp_path / "mine.onnx")]
    assert main(words) == 130
    told = f"interrupted at step 120 of 2000, kept in {tmp_path / 'mine.checkpoint'} (the same"
    said = capsys.readouterr().err
    assert told in said and "with --resume goes on" in said
    assert [path.name for path in tmp_path.iterdir()] == ["mine.checkpoint"]


def test_a_disk_that_fills_up_is_told_by_name_and_leaves_no_empty_log(
    tmp_path: Path, training: Training, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def run(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(training, "run", run)
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(tmp_path / "mine.onnx")]
    assert main(words) == 5
    assert f"{tmp_path / 'mine.log'}: No space left on device" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_disk_without_room_is_told_by_name_before_any_data_are_read(
    tmp_path: Path, training: Training, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    class Full(BytesIO):
        def write(self, _: Any) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def prepare(_: Any) -> Any:
        raise AssertionError("read")

    monkeypatch.setattr(places, "TemporaryFile", lambda **_: Full())
    monkeypatch.setattr(train, "_prepare", prepare)
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(tmp_path / "mine.onnx")]
    assert main(words) == 5
    assert f"{tmp_path / 'mine.checkpoint'}: No space left on device" in capsys.readouterr().err


def test_lines_of_progress_come_by_time_too_where_that_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = SimpleNamespace(now_s=0.0)
    monkeypatch.setattr("time.monotonic", lambda: clock.now_s)
    for every_s, told in ((10.0, ["2 of 1000", "4 of 1000"]), (math.inf, [])):
        clock.now_s = 0.0
        with options.progress("training", every_s=every_s) as show:
            for step in range(1, 6):
                clock.now_s += 6.0
                show(step, 1000)
        lines = capsys.readouterr().err.splitlines()
        assert [line.partition(": ")[2].partition(",")[0] for line in lines] == told


def test_what_is_learnt_is_one_of_the_labels_of_a_recording(
    tmp_path: Path, training: Training, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    asked: list[str] = []

    def prepare(args: Any) -> tuple[Training, list[Any]]:
        asked.append(args.label)
        return training, []

    monkeypatch.setattr(train, "_prepare", prepare)
    words = ["detector", "train", "tcn", "--data", ".", "--out", str(tmp_path / "mine.onnx")]
    assert main([*words, "--label", "moved"]) == 0
    assert main([*words, "--label", "luck"]) == 2
    assert asked == ["moved"]
    assert "--label" in capsys.readouterr().err


def test_weights_that_could_not_be_named_afterwards_are_not_trained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(train, "need", lambda *_: None)
    out = tmp_path / "mine.txt"
    assert main(["detector", "train", "tcn", "--data", ".", "--out", str(out)]) == 2
    assert f"--out {tmp_path / 'mine.onnx'}" in capsys.readouterr().err


def test_a_training_that_goes_on_tells_its_own_loss_from_the_first_step_on() -> None:
    told: list[str] = []
    reporter = train.Reporter(SimpleNamespace(), lambda *words: told.append(words[-1]))
    for step, loss in ((61, 0.5), (62, 0.6)):
        reporter.tell(SimpleNamespace(step=step, steps=200, loss=loss, best=None, score=None))
    assert told == ["training, loss 0.500", "training, loss 0.502"]


def test_no_network_is_trained_on_a_data_set_that_is_not_all_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(train, "need", lambda *_: None)
    monkeypatch.setitem(sys.modules, "detector.training.export", SimpleNamespace(export=None))
    (tmp_path / "dataset.json").write_text('{"recordings": 84}')
    out = tmp_path / "mine.onnx"
    words = ["detector", "train", "tcn", "--data", str(tmp_path), "--out", str(out)]
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{tmp_path}: 0 of 84 recordings are there (`grasp dataset build` goes on" in line
    assert not list(tmp_path.glob("mine*"))


@pytest.mark.parametrize(("minutes", "last"), [(1e9, 1000), (2.0, 400), (0.4, 100), (60.0, 1000)])
def test_how_far_a_training_is_ends_with_its_minutes_where_they_end_first(
    minutes: float, last: int
) -> None:
    told: list[int] = []
    reporter = train.Reporter(SimpleNamespace(), lambda step, of, words: told.append(of), minutes)
    reporter.tell(
        SimpleNamespace(step=100, steps=1000, minutes=0.5, loss=0.3, best=None, score=None)
    )
    assert told == [last]
