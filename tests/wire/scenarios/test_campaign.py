"""Campaigns under a user's hands: killed, interrupted, resumed, on one job or two."""

import json
import random
import signal
import time
from pathlib import Path

import pytest

from grasp.cli.main import main
from tests.wire.scenarios.campaigns import (
    PATIENCE_S,
    campaign_file,
    finished,
    interrupt,
    rows,
    started,
    until,
    workers_of,
)

REPETITIONS = 4


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign that nothing happened to, run by one worker."""
    folder = tmp_path_factory.mktemp("whole")
    out = folder / "whole.sqlite"
    code, _, err = finished(
        str(campaign_file(folder, REPETITIONS)), "--out", str(out), "--jobs", "1"
    )
    assert code == 0, err
    return out


def test_every_trial_has_its_row_and_the_exit_code_is_0(whole: Path) -> None:
    found = rows(whole)
    assert [row["trial"] for row in found] == list(range(2 * REPETITIONS))
    assert {row["status"] for row in found} == {"done"}


def test_kill_9_loses_no_row_and_resume_runs_the_rest(whole: Path, tmp_path: Path) -> None:
    out = tmp_path / "killed.sqlite"
    words = (str(campaign_file(tmp_path, REPETITIONS)), "--out", str(out), "--jobs", "2")
    process = started(*words)
    until(lambda: len(rows(out)) >= 3)
    process.kill()
    process.communicate(timeout=PATIENCE_S)
    before = rows(out)
    assert 3 <= len(before) < 2 * REPETITIONS
    until(lambda: not workers_of(process.pid))  # nobody outlives the command
    assert rows(out) == before

    code, _, err = finished(*words)
    assert code == 2
    assert "--resume" in err
    assert rows(out) == before

    code, _, err = finished(*words, "--resume")
    assert code == 0, err
    assert rows(out) == rows(whole)


@pytest.mark.parametrize(
    "seed",
    [pytest.param(n, marks=[] if n in (1, 3, 8) else [pytest.mark.slow]) for n in range(23)],
)
def test_no_process_outlives_its_parent_whenever_that_is_killed(seed: int, tmp_path: Path) -> None:
    delay_s = random.Random(seed).uniform(0.0, 3.0)  # after the first worker's birth
    killed_by = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP)[seed % 3]
    process = started(
        str(campaign_file(tmp_path, 1000)), "--out", str(tmp_path / "a.sqlite"), "--jobs", "2"
    )
    until(lambda: len(workers_of(process.pid)) > 0)
    time.sleep(delay_s)
    process.send_signal(killed_by)
    process.communicate(timeout=PATIENCE_S)  # until nobody has its output open
    assert process.returncode != 0
    until(lambda: not workers_of(process.pid))


def test_ctrl_c_keeps_the_rows_and_ends_all_workers(whole: Path, tmp_path: Path) -> None:
    out = tmp_path / "interrupted.sqlite"
    process = started(
        str(campaign_file(tmp_path, REPETITIONS)), "--out", str(out), "--jobs", "2"
    )  # fmt: skip
    until(lambda: len(rows(out)) >= 2)
    interrupt(process)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert f"of {2 * REPETITIONS} trials are in {out}" in err
    assert "--resume" in err
    until(lambda: not workers_of(process.pid))
    kept = rows(out)
    assert len(kept) >= 2
    assert kept == [row for row in rows(whole) if row["trial"] in {r["trial"] for r in kept}]


def test_summary_and_csv_of_a_campaign(whole: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(whole), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    (variant,) = summary["variants"]
    assert [cell["object"] for cell in variant["cells"]] == ["can", "ball"]
    assert sum(cell["trials"] for cell in variant["cells"]) == 2 * REPETITIONS
    assert main(["runs", str(whole)]) == 0
    shown = capsys.readouterr().out
    assert "75+20" in shown  # the paper's metal can
    assert main(["report", str(whole), "--to", "csv"]) == 0
    lines = whole.with_suffix(".csv").read_text().splitlines()
    assert lines[0].startswith("trial,scenario,object,profile,detector,")
    assert len(lines) == 1 + 2 * REPETITIONS
