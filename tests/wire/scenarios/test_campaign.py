"""Campaigns under a user's hands: killed, interrupted, resumed, on one job or two."""

from pathlib import Path

import pytest

from tests.wire.scenarios.campaigns import (
    campaign_file,
    finished,
    interrupt,
    rows,
    started,
    workers_of,
)
from tests.wire.waiting import PATIENCE_S, until

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


@pytest.mark.slow
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
