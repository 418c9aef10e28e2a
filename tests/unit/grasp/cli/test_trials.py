"""Messages and exit codes at the end of a series of trials."""

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import msgspec
import pytest

from drivers.errors import UsageError
from drivers.ur.link import preflight
from grasp.cli.lab import warn_of_height
from grasp.cli.main import main
from scenarios.campaign.config import load_for_devices
from scenarios.campaign.trial_series import TrialSeries
from scenarios.trial.final_state import FinalState
from scenarios.trial.result import Failure
from scenarios.trial.run_folder import last_start

DEAF = ("--detector", "energy", "--set", "energy.threshold_counts=400")


LIFTS = ("run", "lift", "--rig", "simulated", "--trials", "2")
CLOSED = FinalState("the arm is stationary", "the hand is closed", "to let go, run `grasp release`")


def test_resuming_a_complete_series_reports_its_failure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "lift", "--rig", "simulated", "--trials", "1", *DEAF]
    words += ["--runs", str(tmp_path), "--out", str(tmp_path / "rows.sqlite")]
    assert main(words) == 1
    capsys.readouterr()
    assert main([*words, "--resume"]) == 1
    output = capsys.readouterr().err
    assert (
        "1 trial is in" in output
        and "the series is complete" in output
        and "--resume" not in output
    )
    assert "1 of 1 trials did not succeed: exit code 1" in output


def altered(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
    """Make the first trial the last one, with results as from the hardware rig."""
    run = TrialSeries.run

    def run_once(series: TrialSeries, *rest: Any) -> Iterator[Any]:
        finished, row = next(iter(run(series, *rest)))
        failure = changes.get("failure")
        result = msgspec.structs.replace(finished.result, rig="hardware", end=changes.get("end"))
        yield msgspec.structs.replace(finished, result=result, failure=failure), row
        if changes.get("signalled"):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(TrialSeries, "run", run_once)


def test_trial_that_leaves_a_closed_hand_is_reported_with_release_and_resume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    altered(monkeypatch, end=CLOSED)
    out = tmp_path / "rows.sqlite"
    assert main([*LIFTS, *DEAF, "--runs", str(tmp_path), "--out", str(out)]) == 1
    output = [line.strip() for line in capsys.readouterr().err.splitlines()]
    assert output[-4:] == [
        "the arm is stationary; the hand is closed", CLOSED.advice,
        f"1 trial is in {out}: continue with --out {out} --resume",
        "grasp: 1 of 1 trials did not succeed: exit code 1",
    ]  # fmt: skip
    assert output[-5].startswith("grasp: seed 0: ")


def test_signal_right_after_a_fault_does_not_hide_arm_and_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failure = Failure("stale", "stale: the arm is silent", "", CLOSED)
    altered(monkeypatch, failure=failure, signalled=True)
    out = tmp_path / "rows.sqlite"
    assert main([*LIFTS, *DEAF, "--runs", str(tmp_path), "--out", str(out)]) == 4
    output = capsys.readouterr().err
    assert CLOSED.advice in output and "--resume" in output and "interrupted" not in output


def test_the_height_above_the_start_is_stated_for_the_newest_run_of_the_same_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    arm, start_m = "127.0.0.99", (0.1, 0.2, 0.3)
    config = load_for_devices("can", "hardware", None, (f"ur.host={arm}",))
    now = Mock(pose=(0.1, 0.2, 0.35, 0.0, 0.0, 0.0))
    monkeypatch.setattr(preflight, "read_status", lambda *_: (now, now))

    def result(name: str, at_s: int, **values: object) -> None:
        file = tmp_path / "runs" / name / "result.json"
        file.parent.mkdir(parents=True)
        started = f"2026-03-29T01:00:0{at_s}.000+00:00"
        file.write_text(json.dumps({"started": started, **values}))
        os.utime(file, (10 - at_s, 10 - at_s))  # as after a copy

    result("first", 1, arm=arm, home_m=start_m)
    warn_of_height(config)
    stated = "the arm stands 50 mm above where runs/first began (`grasp arm back` moves it there)"
    assert stated in capsys.readouterr().err
    for at_s, (name, values, why) in enumerate([
        ("short", {"arm": arm, "home_m": None}, "runs/short ended before the arm's start"),
        ("other", {"arm": "127.0.0.98", "home_m": start_m}, "of 127.0.0.98, not of 127.0.0.99"),
        ("old", {"home_m": start_m}, "was of no real arm, not of 127.0.0.99"),
    ], start=2):  # fmt: skip
        result(name, at_s, **values)
        warn_of_height(config)
        assert capsys.readouterr().err == "", name
        with pytest.raises(UsageError, match=why):
            last_start(arm, None)
        assert last_start(arm, Path("first")) == (Path("runs/first"), start_m)
