"""`grasp report` as a user meets it: where the page goes, and what stands in its way."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from grasp.cli.main import main
from grasp.cli.trials import _write_pages

LIFT = ("run", "lift", "--rig", "simulated", "--detector", "energy", "--pace", "max")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a lift that was asked for its page."""
    folder = tmp_path_factory.mktemp("runs")
    assert main([*LIFT, "--runs", str(folder), "--report"]) in (0, 1)
    return folder


def only(runs: Path) -> Path:
    (run,) = (path.parent for path in runs.glob("*/recording.mcap"))
    return run


def test_a_lift_leaves_its_page_when_asked_and_says_where(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main([*LIFT, "--runs", str(tmp_path), "--report"])
    page = only(tmp_path) / "report.html"
    assert page.read_text().startswith("<!doctype html>")
    assert capsys.readouterr().out.splitlines()[-1] == f"  page: {page}"


def test_a_page_that_cannot_be_written_changes_no_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code = main([*LIFT, "--runs", str(tmp_path)])

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("grasp.cli.report.write_whole", full)
    assert main([*LIFT, "--runs", str(tmp_path / "more"), "--report"]) == code
    assert "no page of seed 0" in capsys.readouterr().err


def test_a_trial_that_left_no_recording_has_no_page(capsys: pytest.CaptureFixture[str]) -> None:
    """As one that failed before it began."""
    _write_pages([SimpleNamespace(recording=None, seed=0)], quiet=False)
    assert capsys.readouterr() == ("", "")


def test_the_page_stands_beside_the_recording_and_is_made_again(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = only(runs) / "report.html"
    for named in (only(runs), only(runs) / "recording.mcap", runs):
        assert main(["report", str(named)]) == 0
        assert capsys.readouterr().out == f"{page}\n"
    assert page.stat().st_mode & 0o777 == 0o600


def test_a_page_goes_where_it_is_told(runs: Path, tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    assert main(["report", str(only(runs)), "--out", str(out)]) == 0
    assert out.read_text().startswith("<!doctype html>")


def test_what_is_no_page_of_ours_is_not_written_over(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "index.html"
    out.write_text("<!doctype html>mine")
    assert main(["report", str(only(runs)), "--out", str(out)]) == 2
    assert "is there already (name another file)" in capsys.readouterr().err
    assert out.read_text() == "<!doctype html>mine"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["nowhere"], "is not there (give the folder of a run"),
        (["."], "there is no recording in it (give the folder of a run"),
        (["note.txt"], "is no MCAP recording (give the path of a run's .mcap file)"),
        (["pipe.json"], "pipe.json: is no file"),
        ([".", "--out", "page.txt"], "a name that ends in .html"),
        ([".", "--out", "nowhere/page.html"], "there is no folder nowhere"),
    ],
)
def test_what_is_no_run_is_refused_with_a_remedy(
    words: list[str],
    told: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("note.txt").write_text("a note")
    os.mkfifo("pipe.json")
    assert main(["report", *words]) == 2
    assert told in capsys.readouterr().err


def test_acquisitions_among_the_runs_of_a_folder_are_passed_over(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "recording.mcap").write_bytes((only(runs) / "recording.mcap").read_bytes())
    words = ["run", "acquire", "--rig", "simulated", "--seconds", "2", "--pace", "max"]
    assert main([*words, "--runs", str(tmp_path)]) == 0
    capsys.readouterr()
    assert main(["report", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"{tmp_path}/a/report.html\n"


def test_several_runs_get_a_page_each_and_the_bad_one_is_named(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "recording.mcap").write_bytes(
            (only(runs) / "recording.mcap").read_bytes() if name != "b" else b""
        )
    assert main(["report", str(tmp_path)]) == 2
    told = capsys.readouterr()
    assert told.out.splitlines() == [str(tmp_path / name / "report.html") for name in ("a", "c")]
    assert f"{tmp_path}/b/recording.mcap: is empty" in told.err
    assert main(["report", str(tmp_path), "--out", str(tmp_path / "page.html")]) == 2
    assert "holds 3 runs" in capsys.readouterr().err
