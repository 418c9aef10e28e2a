"""`grasp report`: path of the page, and files that it must not overwrite."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from grasp.cli.main import main

LIFT = ("run", "lift", "--rig", "simulated", "--detector", "energy", "--pace", "max")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a lift that was run with --report."""
    folder = tmp_path_factory.mktemp("runs")
    assert main([*LIFT, "--runs", str(folder), "--report"]) in (0, 1)
    return folder


def only(runs: Path) -> Path:
    (run,) = (path.parent for path in runs.glob("*/recording.mcap"))
    return run


def test_a_page_that_cannot_be_written_changes_no_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code = main([*LIFT, "--runs", str(tmp_path)])

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("grasp.cli.recordings.write_whole", full)
    assert main([*LIFT, "--runs", str(tmp_path / "more"), "--report"]) == code
    assert "no page of seed 0" in capsys.readouterr().err


def test_the_page_is_next_to_the_recording_and_can_be_rewritten(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = only(runs) / "report.html"
    for named in (only(runs), only(runs) / "recording.mcap"):
        assert main(["report", str(named)]) == 0
        assert capsys.readouterr().out == f"{page}\n"
    assert page.stat().st_mode & 0o777 == 0o600


def test_other_files_are_not_overwritten_by_a_page(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "index.html"
    out.write_text("<!doctype html>mine")
    assert main(["report", str(only(runs)), "--out", str(out)]) == 2
    assert "exists already (name another file)" in capsys.readouterr().err
    assert out.read_text() == "<!doctype html>mine"


@pytest.mark.parametrize("to", ["svg", "gif"])
def test_other_files_are_not_overwritten_by_a_picture(
    to: str, runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / f"mine.{to}"
    out.write_text("mine")
    assert main(["export", str(only(runs)), "--to", to, "--out", str(out)]) == 2
    assert "exists already (name another file" in capsys.readouterr().err
    assert out.read_text() == "mine"


def test_the_last_line_of_a_lift_names_the_page_to_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    main([*LIFT, "--report"])
    page = only(tmp_path / "runs") / "report.html"
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == f"  open this page in a browser: {page}" and page.is_absolute()


def test_runs_are_ordered_by_the_time_in_their_results(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not by names, which have the local time, nor by the times of files, which a copy changes."""
    monkeypatch.chdir(tmp_path)
    result = json.loads((only(runs) / "result.json").read_text())
    assert result["started"].endswith("+00:00")
    recording = (only(runs) / "recording.mcap").read_bytes()
    for name, minute, changed_s in (("20260329-030000-b", 10, 3), ("20260329-020000-c", 20, 1),
                                    ("20260329-025900-a", 0, 2)):  # fmt: skip
        folder = tmp_path / "runs" / name
        folder.mkdir(parents=True)
        (folder / "recording.mcap").write_bytes(recording)
        started = {"started": f"2026-03-29T01:{minute:02d}:00.000+00:00"}
        (folder / "result.json").write_text(json.dumps(result | started))
        for file in folder.iterdir():
            os.utime(file, (changed_s, changed_s))
    assert main(["runs"]) == 0
    listed = [line.split()[0][-1] for line in capsys.readouterr().out.splitlines()]
    assert listed == ["a", "b", "c"]
    assert main(["report"]) == 0
    assert "last run: runs/20260329-020000-c" in capsys.readouterr().err


def test_an_acquisition_is_not_the_last_run(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    acquired = tmp_path / "runs" / "20991231-235959-acquire-planar"
    shutil.copytree(only(runs), acquired)
    (acquired / "samples.npz").touch()
    assert main(["report"]) == 2
    assert "no RUN given, and no lift or tap in the folder runs" in capsys.readouterr().err
    shutil.copytree(only(runs), tmp_path / "runs" / "20260329-020000-lift-can")
    assert main(["report"]) == 0
    assert "last run: runs/20260329-020000-lift-can" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["", "missing", "missing.sqlite"])
def test_a_folder_without_anything_to_report_is_refused_with_what_a_report_takes(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(tmp_path / name)]) == 2
    error = capsys.readouterr().err
    assert f"{tmp_path / name}: no recording of a run, campaign, score file or benchmark" in error
    assert "give the folder of a lift, a tap or a benchmark, a campaign's" in error


@pytest.mark.parametrize("backend", ["module://of.a.notebook", "nonsense"])
def test_a_notebooks_backend_does_not_reach_the_drawing_code(backend: str) -> None:
    pytest.importorskip("matplotlib")
    code = "from scenarios.report.export import pyplot; print(pyplot().get_backend().lower())"
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "MPLBACKEND": backend}, text=True,
        capture_output=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "agg\n"), done.stderr
