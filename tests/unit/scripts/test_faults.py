"""The words of the fault campaign's script."""

import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from scenarios.campaign import store as campaign_store
from scenarios.studies.faults import store
from scenarios.studies.faults.store import FaultStore
from scripts import faults, figures


@pytest.mark.parametrize(("word", "count"), [("--most", "-1"), ("--most", "0"), ("--jobs", "0")])
def test_a_count_below_one_is_refused_before_a_run_is_made(
    word: str, count: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "faults.sqlite"
    monkeypatch.setattr(sys, "argv", ["faults.py", "run", "--out", str(out), word, count])
    with pytest.raises(SystemExit) as ended:
        faults.main()
    assert ended.value.code == 2
    assert not out.exists()


def test_a_number_that_is_no_run_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["faults.py", "show", "99999"])
    assert faults.main() == 2
    assert "no run 99999" in capsys.readouterr().err


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One of its own, with a module that runs rest on and a page."""
    home = tmp_path / "checkout"
    (home / "grasp" / "cli").mkdir(parents=True)
    (home / "docs").mkdir()
    for module in (faults, figures):
        monkeypatch.setattr(module, "HOME", home)
    # what it knows of a commit it never asks for again, and HEAD is another one here each time
    monkeypatch.setattr(figures, "_blobs", vars(figures)["_blobs"].__wrapped__)
    committed(home, **{"grasp/loop.py": "A = 1\n", "docs/faults.md": "none\n"})
    return home


def committed(home: Path, **files: str) -> str:
    """The commit of these."""
    who = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    for name, text in files.items():
        (home / name).write_text(text)
    for command in (("init", "-q"), ("add", "-A"), (*who, "commit", "-q", "-m", "more")):
        subprocess.run(("git", *command), cwd=home, check=True)
    said = subprocess.run(("git", "rev-parse", "--short=7", "HEAD"), cwd=home, check=True,
                          capture_output=True, text=True)  # fmt: skip
    return said.stdout.strip()


def test_a_page_that_was_written_leaves_no_row_stale(checkout: Path) -> None:
    made_with = faults.code()
    (checkout / "docs" / "faults.md").write_text("9292 of 9292 planned runs\n")
    assert faults.code() == made_with
    committed(checkout, **{"docs/faults.md": "9292\n", "grasp/cli/words.py": "B = 2\n"})
    assert faults.code() == made_with
    assert faults.stale([made_with], faults.code()) == set()


def test_rows_are_stale_once_what_they_rest_on_computes_something_else(checkout: Path) -> None:
    made_with = faults.code()
    said = committed(checkout, **{"grasp/loop.py": "# why\nA = 1\n"})
    assert faults.code() == said != made_with
    assert faults.stale([made_with], said) == set()
    now = committed(checkout, **{"grasp/loop.py": "A = 2\n"})
    assert faults.stale([made_with, said, now, "0123456"], now) == {made_with, said, "0123456"}


def test_rows_made_with_what_no_commit_has_are_stale_unless_it_is_what_is_there(
    checkout: Path,
) -> None:
    made_with = faults.code()
    (checkout / "grasp" / "loop.py").write_text("A = 3\n")
    now = faults.code()
    assert now == f"{made_with}-dirty"
    assert faults.stale([made_with, now], now) == {made_with}
    (checkout / "grasp" / "loop.py").write_text("A = 1\n")
    assert faults.stale([made_with, now], faults.code()) == {now}


def test_ctrl_c_leaves_one_line_that_says_what_is_kept_and_ends_with_130(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: Any) -> Iterator[Any]:
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(faults, "outcomes", interrupted)
    out = tmp_path / "faults.sqlite"
    monkeypatch.setattr(sys, "argv", ["faults.py", "run", "--most", "2", "--out", str(out)])
    assert faults.main() == 130
    of = len(faults.plan())
    said = capsys.readouterr()
    assert said.err == f"faults: 0 of {of} kept in {out}; the same command goes on\n"


def test_rows_that_are_made_again_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "faults.sqlite"
    monkeypatch.setattr(faults, "_make", lambda *_: None)
    monkeypatch.setattr(faults.FaultStore, "lacking",
                        lambda _, cases, old=(): cases if old else cases[1:])  # fmt: skip
    monkeypatch.setattr(faults, "stale", lambda *_: {"0123456"})
    monkeypatch.setattr(sys, "argv", ["faults.py", "run", "--stale", "--out", str(out)])
    faults.main()
    assert "1 rows made with another commit are made again" in capsys.readouterr().out


def test_progress_says_how_fast_it_is_and_how_long_it_will_take() -> None:
    assert faults.progress(60, 9_292, 60.0) == "60 of 9292, 60 a minute, 2 h 34 min left"
    assert faults.progress(9_292, 9_292, 60.0) == "9292 of 9292, 9292 a minute, 0 min left"


def test_a_page_of_a_campaign_that_lacks_runs_is_refused_unless_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, of, page = tmp_path / "faults.sqlite", len(faults.plan()), tmp_path / "faults.md"
    page.write_text(f"{faults.BEGINS}\nall\n{faults.ENDS}\n")
    monkeypatch.setattr(faults, "PAGE", page)
    monkeypatch.setattr(faults, "generated", lambda *_: "none")
    with FaultStore(out, writes=True):
        pass
    monkeypatch.setattr(sys, "argv", ["faults.py", "page", "--out", str(out)])
    assert faults.main() == 2
    assert f"{out} lacks {of} of {of} runs" in capsys.readouterr().err
    assert "all" in page.read_text()
    monkeypatch.setattr(sys, "argv", ["faults.py", "page", "--out", str(out), "--partial"])
    assert faults.main() == 0
    assert "none" in page.read_text()


@pytest.mark.parametrize("verb", ["show 17", "wire", "schedule"])
def test_a_verb_that_reads_no_rows_takes_no_file_of_them(
    verb: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["faults.py", *verb.split(), "--out", "x.sqlite"])
    with pytest.raises(SystemExit) as ended:
        faults.main()
    assert ended.value.code == 2


def test_a_disk_that_failed_is_no_reason_to_name_another_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    error = sqlite3.OperationalError("disk I/O error")
    error.sqlite_errorname = "SQLITE_IOERR_WRITE"

    class Failing:
        def execute(self, *_: object) -> None:
            raise error

        def close(self) -> None:
            """Nothing to close."""

    monkeypatch.setattr(store, "_opened", lambda path: Failing())
    monkeypatch.setattr(campaign_store, "is_full", lambda path: True)
    out = tmp_path / "faults.sqlite"
    monkeypatch.setattr(sys, "argv", ["faults.py", "run", "--out", str(out)])
    assert faults.main() == 2
    said = f"faults: {out}: the disk is full (disk I/O error) ({store.FREE})\n"
    assert capsys.readouterr().err == said
