"""What a series of trials says with its exit code, and at its end."""

import signal
import sqlite3
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest

from drivers.errors import CouldNotRecord
from grasp.cli import view
from grasp.cli.main import main
from scenarios.campaign import experiment as experiments
from scenarios.trial.ending import End
from scenarios.trial.result import Failure

DEAF = ("--detector", "energy", "--set", "energy.threshold_counts=400")


@pytest.mark.parametrize(("scenario", "code"), [("lift", 1), ("tap", 0)])
def test_lift_that_fails_has_exit_code_1_and_missed_tap_0_also_when_nothing_is_left_to_run(
    scenario: str, code: int, tmp_path: Path
) -> None:
    words = ["run", scenario, "--rig", "simulated", "--trials", "1", *DEAF]
    words += ["--runs", str(tmp_path), "--out", str(tmp_path / "rows.sqlite"), "--json"]
    assert main(words) == code
    assert main([*words, "--resume"]) == code


LIFTS = ("run", "lift", "--rig", "simulated", "--trials", "2")
CLOSED = End("the arm stands", "the hand is closed", "to let go, run `grasp release`")


def test_series_told_as_json_says_of_each_trial_what_became_of_it_beside_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*LIFTS, "--runs", str(tmp_path), "--json"]) == 0
    out, err = capsys.readouterr()
    assert msgspec.json.decode(out)["summary"]["trials"] == 2
    assert [line.split()[:2] for line in err.splitlines()] == [["seed", "0"], ["seed", "1"]]


def test_series_that_was_complete_says_so_and_why_it_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "lift", "--rig", "simulated", "--trials", "1", *DEAF]
    words += ["--runs", str(tmp_path), "--out", str(tmp_path / "rows.sqlite")]
    assert main(words) == 1
    capsys.readouterr()
    assert main([*words, "--resume"]) == 1
    said = capsys.readouterr().err
    assert "1 trial is in" in said and "none is left to run" in said and "--resume" not in said
    assert "1 of 1 trials did not succeed: exit code 1" in said


def test_a_panel_says_which_of_all_trials_is_shown_also_of_those_that_are_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []

    class Panel:
        """In place of what draws."""

        def take(self, message: Any) -> None:
            if isinstance(message, view.Glimpse) and told[-1:] != [message.trial]:
                told.append(message.trial)

        def close(self) -> None:
            pass

    monkeypatch.setattr(view, "make", lambda _: Panel())
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    words = [
        *LIFTS,
        *DEAF,
        "--pace",
        "max",
        "--runs",
        str(tmp_path),
        "--out",
        str(tmp_path / "rows.sqlite"),
    ]
    assert main(words) == 1
    assert told == ["trial 1 of 2", "trial 2 of 2"]
    with sqlite3.connect(tmp_path / "rows.sqlite") as db:
        db.execute("DELETE FROM trials WHERE trial = 1")
    db.close()
    told.clear()
    assert main([*words, "--resume"]) == 1
    assert told == ["trial 2 of 2"]
    told.clear()
    main(["run", "lift", "--rig", "simulated", *DEAF, "--pace", "max", "--runs", str(tmp_path)])
    assert told == [""]


def altered(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
    """Has the first trial of a series be its last, as the hardware rig tells it."""
    run = experiments.run

    def told(experiment: Any, *rest: Any) -> Iterator[Any]:
        finished, row = next(iter(run(experiment, *rest)))
        failure = changes.get("failure")
        result = msgspec.structs.replace(finished.result, rig="hardware", end=changes.get("end"))
        yield msgspec.structs.replace(finished, result=result, failure=failure), row
        if changes.get("signalled"):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(experiments, "run", told)


def test_trial_that_leaves_a_closed_hand_is_told_with_the_way_out_and_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    altered(monkeypatch, end=CLOSED)
    out = tmp_path / "rows.sqlite"
    assert main([*LIFTS, *DEAF, "--runs", str(tmp_path), "--out", str(out)]) == 1
    said = [line.strip() for line in capsys.readouterr().err.splitlines()]
    assert said[-4:] == [
        "the arm stands; the hand is closed", CLOSED.advice,
        f"1 trial is in {out}: go on with --out {out} --resume",
        "grasp: 1 of 1 trials did not succeed: exit code 1",
    ]  # fmt: skip
    assert said[-5].startswith("grasp: seed 0: ")


def test_signal_right_after_a_fault_does_not_hide_arm_and_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failure = Failure("stale", "stale: the arm is silent", "", CLOSED)
    altered(monkeypatch, failure=failure, signalled=True)
    out = tmp_path / "rows.sqlite"
    assert main([*LIFTS, *DEAF, "--runs", str(tmp_path), "--out", str(out)]) == 4
    said = capsys.readouterr().err
    assert CLOSED.advice in said and "--resume" in said and "interrupted" not in said


def test_finished_lift_on_the_lab_rig_says_how_high_the_arm_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    altered(monkeypatch)
    main([*LIFTS, *DEAF[:2], "--runs", str(tmp_path)])
    assert "the arm stands 50 mm above where it let go" in capsys.readouterr().out


def test_each_trial_of_several_is_a_line_and_a_single_lift_has_its_verdict_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*DEAF, "--runs", str(tmp_path)]
    main([*LIFTS, *words])
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in lines if line.startswith("seed ")] == [
        ["seed", "0"], ["seed", "1"],
    ]  # fmt: skip
    main([*LIFTS[:-2], *words])
    assert "\nseed " not in capsys.readouterr().out


@pytest.mark.parametrize("trials", [0, 1])
def test_disk_that_fails_between_trials_is_told_with_what_is_kept(
    trials: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = experiments.run

    def told(*asked: Any) -> Iterator[Any]:
        if trials:
            yield next(iter(run(*asked)))
        raise CouldNotRecord("the disk is full", "free it")

    monkeypatch.setattr(experiments, "run", told)
    out = tmp_path / "rows.sqlite"
    assert main([*LIFTS, *DEAF, "--runs", str(tmp_path), "--out", str(out)]) == 5
    said = capsys.readouterr()
    assert "grasp: the disk is full (free it)" in said.err
    assert (f"1 trial is in {out}: go on with" in said.err) == bool(trials)
    assert ("dropped" in said.out) == bool(trials)


def test_log_of_a_lift_tells_its_phases_in_turn_and_ends_with_what_became_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["run", "lift", "--rig", "simulated", *DEAF, "--runs", str(tmp_path), "-v"])
    (log,) = tmp_path.glob("*-lift-can.log")
    assert f"log: {log}" in capsys.readouterr().err
    lines = [line.split(" ", 1)[1] for line in log.read_text().splitlines()]
    phases = [line.partition(" phase ")[2] for line in lines if " phase " in line]
    assert phases.index("approach") < phases.index("grasp") < phases.index("lift")
    assert all(a != b for a, b in pairwise(phases))
    assert lines[0].startswith("lift of can on rig simulated, ")
    assert lines[-1].startswith("seed 0: ")
