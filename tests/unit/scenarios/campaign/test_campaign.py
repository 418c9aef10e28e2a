"""Campaigns: grid, rows, and behaviour on crashes and interruptions."""

import os
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from drivers.errors import BadFile, ConfigError
from scenarios.campaign.run import Progress, Work, run
from scenarios.campaign.spec import CampaignSpec, Task, combinations, read_spec, trials
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.worker import FOLDER, Row, error_row, run_trial
from scenarios.rigs.workers import Workers

TWO_OBJECTS = CampaignSpec(name="two", objects=("can", "ball"), repetitions=2)


def instant_success(trial: Task) -> tuple[Row, bytes | None]:
    """A stub for a trial."""
    return msgspec.structs.replace(error_row(trial, ""), status="done", success=True), None


def run_with(spec: CampaignSpec, out: Path, work: Work, **options: Any) -> Progress:
    return run(spec, out, Workers(2), work=work, **options)


def run_here(spec: CampaignSpec, out: Path, work: Work, **options: Any) -> Progress:
    """Run without workers, which take seconds to start."""
    return run(spec, out, Workers(0), work=work, **options)


def stored(path: Path) -> list[Row]:
    with CampaignStore.open(path) as store:
        return store.rows()


# The grid


def test_every_combination_is_run_with_every_seed() -> None:
    spec = CampaignSpec(
        name="grid", objects=("can", "ball"), seeds=(0, 3), repetitions=2,
        sweep={"rule.consecutive": (1, 2), "loop.decision_delay_s": (0.0, 0.02, 0.1),
               "controller.closing_speed_mps": (0.05,)},
    )  # fmt: skip
    found = list(trials(spec, combinations(spec)))
    assert len(found) == 2 * 2 * 3 * 1 * 2 * 2
    assert [trial.number for trial in found] == list(range(len(found)))
    assert {trial.seed for trial in found} == {0, 1, 30_000, 30_001}
    assert {trial.config.rule.consecutive for trial in found} == {1, 2}
    assert {trial.config.loop.decision_delay_s for trial in found} == {0.0, 0.02, 0.1}
    assert {trial.config.controller.closing_speed_mps for trial in found} == {0.05}


def test_each_combination_sets_the_object_down_once_in_ten_repetitions() -> None:
    spec = CampaignSpec(name="ten", scenarios=("lift", "tap"), objects=("can", "ball"))
    found = list(trials(spec, combinations(spec)))
    sampled = [trial for trial in found if trial.set_down]
    assert sorted((t.scenario, t.config.object.name, t.repetition // 10) for t in sampled) == [
        (scenario, name, ten)
        for scenario in ("lift", "tap") for name in ("ball", "can") for ten in (0, 1)
    ]  # fmt: skip
    assert all(trial.run_config.controller.keep is not trial.set_down for trial in found)
    always = msgspec.structs.replace(spec, settings=("controller.keep=false",))
    assert all(trial.set_down for trial in trials(always, combinations(always)))


def test_a_wrong_file_is_refused_before_anything_runs(tmp_path: Path) -> None:
    for wrong, named in [
        ('objects = ["cann"]', "can"),
        ('objects = ["can"]\nprofiles = ["papr"]', "paper"),
        ('objects = ["can"]\ndetectors = ["none"]', "energy"),
        ('objects = ["can"]\n[sweep]\n"loop.decision_delay_s" = [3.0]', "decision_delay_s"),
        ('objects = ["can"]\nrepetition = 3', "repetitions"),
        ('objects = ["can"]\nsettings = ["gripper.calibration=manual"]', "guard.force_limit_n"),
    ]:
        file = tmp_path / "wrong.toml"
        file.write_text(f'name = "wrong"\n{wrong}\n')
        out = tmp_path / "out.sqlite"
        with pytest.raises(ConfigError) as error:
            run(read_spec(file), out, Workers(0))
        assert named in f"{error.value.message} {error.value.remedy}", (wrong, named)
        assert not out.exists(), (wrong, named)


# One trial


def test_a_failure_leaves_its_recording_and_a_success_none() -> None:
    spec = CampaignSpec(name="kept", objects=("can",), repetitions=1)
    (good,) = trials(spec, combinations(spec))
    row, recording = run_trial(good)
    assert (row.status, row.success, recording) == ("done", True, None)
    doomed = msgspec.structs.replace(spec, settings=("object.mass_kg=2.9",))
    (bad,) = trials(doomed, combinations(doomed))
    row, recording = run_trial(bad)
    assert row.success is False
    assert recording is not None
    assert recording.startswith(b"\x89MCAP")
    assert row.recording is None  # its path is set when it is stored
    assert recording == run_trial(msgspec.structs.replace(bad, recordings="all"))[1]


def test_a_trial_that_crashes_is_a_row_with_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(*_: Any) -> None:
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr("scenarios.campaign.worker.run_once", crash)
    spec = CampaignSpec(name="crash", objects=("can",), repetitions=1)
    (trial,) = trials(spec, combinations(spec))
    row, _ = run_trial(trial)
    assert row.status == "error"
    assert row.success is None
    assert row.error is not None and "ZeroDivisionError: on purpose" in row.error


# Accidents


def test_killed_worker_fails_only_its_own_trial(tmp_path: Path) -> None:
    def work(trial: Task) -> tuple[Row, bytes | None]:
        if trial.number == 1:
            os._exit(3)
        return instant_success(trial)

    done = run_with(TWO_OBJECTS, tmp_path / "a.sqlite", work)
    rows = stored(tmp_path / "a.sqlite")
    assert [row.status for row in rows] == ["done", "error", "done", "done"]
    assert rows[1].error == "the worker process died"
    assert (done.new, done.successes, done.errors) == (4, 3, 1)


def test_folder_of_a_killed_process_is_removed_at_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    left, used = (tmp_path / f"{FOLDER}{name}" for name in ("left", "used"))
    for folder in (left, used):
        folder.mkdir()
        (folder / "run.mcap").touch()
    script = "import fcntl, os, sys; fcntl.flock(os.open(sys.argv[1], 0), 2); print(); input()"
    words = [sys.executable, "-c", script, str(used)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        other.stdout.readline()
        run_here(TWO_OBJECTS, tmp_path / "a.sqlite", instant_success)
        assert (left.exists(), used.exists()) == (False, True)
        other.communicate(b"\n")
    run_here(TWO_OBJECTS, tmp_path / "b.sqlite", instant_success)
    assert not used.exists()


def test_resume_runs_only_missing_trials_and_those_with_an_error(tmp_path: Path) -> None:
    def crash_two(trial: Task) -> tuple[Row, bytes | None]:
        if trial.number in (0, 3):
            raise RuntimeError("on purpose")
        return instant_success(trial)

    out = tmp_path / "a.sqlite"
    assert run_here(TWO_OBJECTS, out, crash_two).errors == 2
    with sqlite3.connect(out) as db:
        db.execute("DELETE FROM trials WHERE trial = 1")
    db.close()
    ran = tmp_path / "ran"
    ran.mkdir()

    def work(trial: Task) -> tuple[Row, bytes | None]:
        (ran / str(trial.number)).touch()
        return instant_success(trial)

    done = run_here(TWO_OBJECTS, out, work, resume=True)
    assert sorted(path.name for path in ran.iterdir()) == ["0", "1", "3"]
    assert (done.done, done.total, done.errors) == (4, 4, 0)
    assert [row.status for row in stored(out)] == ["done"] * 4


def test_an_existing_file_is_refused_without_resume(tmp_path: Path) -> None:
    out = tmp_path / "a.sqlite"
    run_here(TWO_OBJECTS, out, instant_success)
    before = out.read_bytes()
    with pytest.raises(ConfigError, match="exists already"):
        run_here(TWO_OBJECTS, out, instant_success)
    assert out.read_bytes() == before


def test_resume_refuses_a_file_that_is_no_campaign(tmp_path: Path) -> None:
    out = tmp_path / "a.sqlite"
    with sqlite3.connect(out) as db:
        db.execute("CREATE TABLE precious (x)")
    db.close()
    before = out.read_bytes()
    with pytest.raises(BadFile, match="not a campaign"):
        run_here(TWO_OBJECTS, out, instant_success, resume=True)
    assert out.read_bytes() == before


def test_another_campaign_cannot_be_resumed(tmp_path: Path) -> None:
    out = tmp_path / "a.sqlite"
    run_here(TWO_OBJECTS, out, instant_success)
    other = msgspec.structs.replace(TWO_OBJECTS, repetitions=5)
    with pytest.raises(ConfigError, match="created with repetitions = 2, not 5"):
        run_here(other, out, instant_success, resume=True)
