"""No failure ends with the code of success, whatever somebody's library raises."""

import subprocess
import sys
from asyncio import CancelledError
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import GraspError
from grasp.cli import runs
from grasp.cli.main import main
from scenarios.campaign.spec import Task
from scenarios.campaign.worker import run_trial as run_task
from scenarios.lift import lift
from scenarios.trial import run_folder
from scenarios.trial.execution import FinishedTrial
from scenarios.trial.result import Failure
from tests.unit.scenarios.conftest import config


@pytest.mark.parametrize(
    "raised",
    [BrokenPipeError(32, "Broken pipe"), SystemExit(0), CancelledError(), GeneratorExit(),
     MemoryError(), ZeroDivisionError()],
    ids=repr,
)  # fmt: skip
@pytest.mark.parametrize("more", [(), ("--json",)], ids=["", "json"])
def test_what_no_code_of_ours_may_raise_is_a_bug(
    raised: BaseException, more: tuple[str, ...], monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def raises(args: object) -> int:
        raise raised

    monkeypatch.setattr(runs, "run", raises)
    assert main(["runs", *more]) == 5
    told = capsys.readouterr()
    assert type(raised).__name__ in (told.out if more else told.err)


def test_a_reader_that_has_left_is_no_failure_and_nothing_is_said() -> None:
    code = "import sys; sys.stdin.read(); from grasp.cli.main import main; sys.exit(main())"
    words = [sys.executable, "-c", code, "detector", "card"]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as done:
        assert done.stdin and done.stdout and done.stderr
        done.stdout.close()
        done.stdin.close()
        assert done.stderr.read() == b""
    assert done.returncode == 0


@pytest.mark.parametrize("raised", [ZeroDivisionError("7"), SystemExit(0), BrokenPipeError()])
def test_a_bug_in_the_judgement_leaves_no_result_and_is_told(
    raised: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    def judge(*_: object) -> None:
        raise raised

    monkeypatch.setattr(lift, "judge", judge)
    finished = lift.run(config(), 0, None)
    assert finished.result is None and finished.failure is not None
    assert finished.failure.kind == "internal"
    assert type(raised).__name__ in finished.failure.message


def test_a_bug_in_writing_the_result_hides_neither_it_nor_a_fault(
    monkeypatch: pytest.MonkeyPatch, tmp_path: object
) -> None:
    def finish(*_: object) -> None:
        raise ZeroDivisionError("7")

    monkeypatch.setattr(run_folder.RunFolder, "finish", finish)
    finished = lift.run(config(), 0, tmp_path)  # type: ignore[arg-type]
    assert finished.result is not None and finished.failure is not None
    assert (
        finished.failure.kind == "internal" and "ZeroDivisionError: 7" in finished.failure.message
    )


def test_a_grasp_error_keeps_its_own_code(monkeypatch: pytest.MonkeyPatch) -> None:
    def raises(args: object) -> int:
        raise GraspError("nothing", "look")

    monkeypatch.setattr(runs, "run", raises)
    assert main(["runs"]) == 5


class _Unread:
    """A stream to a pipe without a reader."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, _: str) -> int:
        raise BrokenPipeError(32, "Broken pipe")


@pytest.mark.parametrize("raised", [BrokenPipeError(32, "Broken pipe"), OSError(28, "full")])
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_failure_is_one_though_nobody_reads(
    raised: OSError, stream: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raises(args: object) -> int:
        print("said beside it", file=sys.stderr)
        raise raised

    monkeypatch.setattr(runs, "run", raises)
    monkeypatch.setattr(sys, stream, _Unread(getattr(sys, stream)))
    assert main(["runs"]) == 5


def test_how_arm_and_hand_were_left_is_told_though_nobody_reads_the_verdict(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdout", _Unread(sys.stdout))
    words = ["run", "lift", "--rig", "simulated", "--runs", str(tmp_path), "--pace", "max"]
    failed = Failure("device_fault", "gone", "look", None)
    monkeypatch.setattr(FinishedTrial, "failure", lambda *_: failed)
    assert main(words) == 3
    assert "gone (look)" in capfd.readouterr().err


def test_a_campaign_has_no_good_row_of_a_trial_that_could_not_be_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def finish(*_: object) -> None:
        raise ZeroDivisionError("7")

    monkeypatch.setattr(run_folder.RunFolder, "finish", finish)
    task = Task(0, "lift", 0, 0, {}, config(), "all")
    row = run_task(task).row
    assert row.status == "error" and "ZeroDivisionError" in (row.error or "")
