"""`grasp report`: path of the page, and files that it must not overwrite."""

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
