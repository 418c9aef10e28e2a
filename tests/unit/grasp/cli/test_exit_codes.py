"""No failure ends with the exit code of success, whatever exception a library raises."""

import sys
from asyncio import CancelledError
from pathlib import Path
from typing import Any

import pytest

from grasp.cli import recordings
from grasp.cli.main import main
from scenarios.lift.lift import lift
from scenarios.trial.execution import FinishedTrial
from scenarios.trial.result import Failure
from tests.unit.scenarios.conftest import config


def test_an_unexpected_exception_is_an_internal_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for raised in (
        BrokenPipeError(32, "Broken pipe"), SystemExit(0), CancelledError(), GeneratorExit(),
        MemoryError(), ZeroDivisionError(),
    ):  # fmt: skip

        def raises(args: object, raised: BaseException = raised) -> int:
            raise raised

        monkeypatch.setattr(recordings, "runs", raises)
        for more in ([], ["--json"]):
            assert main(["runs", *more]) == 5, raised
            error = capsys.readouterr()
            assert type(raised).__name__ in (error.out if more else error.err)


def test_a_bug_in_the_scoring_leaves_no_result_and_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for raised in (ZeroDivisionError("7"), SystemExit(0), BrokenPipeError()):

        def judge(*_: object, raised: BaseException = raised) -> None:
            raise raised

        monkeypatch.setattr(lift, "judge", judge)
        finished = lift.run(config(), 0, None)
        assert finished.result is None and finished.failure is not None
        assert finished.failure.kind == "internal"
        assert type(raised).__name__ in finished.failure.message


class _Unread:
    """A stream to a pipe without a reader."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, _: str) -> int:
        raise BrokenPipeError(32, "Broken pipe")


def test_final_state_is_reported_although_standard_output_is_closed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdout", _Unread(sys.stdout))
    words = ["run", "lift", "--rig", "simulated", "--runs", str(tmp_path), "--pace", "max"]
    failed = Failure("device_fault", "gone", "look", None)
    monkeypatch.setattr(FinishedTrial, "failure", lambda *_: failed)
    assert main(words) == 3
    assert "gone (look)" in capfd.readouterr().err
