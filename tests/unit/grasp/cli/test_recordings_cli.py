"""Commands for recordings: replay of runs, scores of fingertip recordings."""

import re
from pathlib import Path

import pytest

from tests.unit.grasp.cli.test_cli import call, run_json


def test_replay_checks_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call("run", "lift", "--runs", str(tmp_path), capsys=capsys)
    folder = str(next(tmp_path.iterdir()))
    code, out, _ = call("replay", folder, "--check", capsys=capsys)
    assert code == 0
    assert "as recorded" in out
    code, result = run_json(capsys, "replay", folder)
    assert result["same"] is True


def test_run_is_found_by_the_name_that_runs_lists(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    error = call("run", "lift", "--set", "controller.grip_force_n=20", capsys=capsys)[2]
    assert "grip force 20 N is reduced to guard.force_limit_n, 10 N" in error
    name = call("runs", capsys=capsys)[1].split()[0]
    assert call("replay", name, "--check", capsys=capsys)[0] == 0
    for words in (("report", name), ("export", name), ("export", name, "--to", "layout")):
        code, out, _ = call(*words, capsys=capsys)
        assert code == 0 and Path(out.strip()).parent == Path("runs") / name, words
    for words in (("report",), ("export",), ("replay", "--check")):  # the last run
        code, _, error = call(*words, capsys=capsys)
        assert code == 0 and f"last run: runs/{name}" in error, words
    code, _, error = call("export", "--to", "csv", "--out", "y.gif", capsys=capsys)
    assert code == 2 and "says gif, --to says csv" in error and not Path("y.gif").exists()
    code, _, error = call("replay", "no-run", capsys=capsys)
    assert code == 2 and "such as runs/NAME" in error


def test_several_runs_are_exported_as_a_data_set_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("grasp.cli.options.find_spec", lambda name: None)
    for words, problem in {
        ("a", "b"): "2 RUNs cannot be exported together as csv",
        ("a", "b", "--to", "lerobot"): "not installed: pyarrow (make install-exports, or",
        ("a", "--to", "lerobot", "--out", str(tmp_path)): "is a folder",
        ("a", "--to", "lerobot", "--out", "x.csv"): "says csv, --to says lerobot",
    }.items():
        code, _, error = call("export", *words, capsys=capsys)
        assert code == 2 and problem in error, error
    monkeypatch.undo()
    monkeypatch.setattr("grasp.cli.recordings.need", lambda *_: None)
    code, _, error = call("export", "a", "b", "--to", "lerobot", capsys=capsys)
    assert code == 2 and "--out is missing" in error


def stroke_csv(path: Path) -> Path:
    rows = ["t_s,p0,p1,p2,p3,p4,p5,slip"]
    for k in range(400):
        slip = 150 <= k < 210 or 300 <= k < 360
        size = 30 if slip else 1
        values = [str(-100 + (size if (k + i) % 2 else -size)) for i in range(6)]
        rows.append(f"{k * 0.01:.2f},{','.join(values)},{int(slip)}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_fingertip_recording_shows_events_commands_and_score(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = stroke_csv(tmp_path / "strokes.csv")
    words = ("replay", "--tactile", str(path), "--detector", "energy")
    code, out, _ = call(*words, capsys=capsys)
    assert code == 0
    assert "label: slip begins" in out
    assert "registered at finger A" in out
    assert "close A" in out
    assert re.search(r"slips +2\n  missed +0\n", out)
    (tmp_path / "own.toml").write_text("[energy]\nthreshold_counts = 400.0\n")
    code, other, _ = call(*words, "--config", str(tmp_path / "own.toml"), capsys=capsys)
    assert code == 0 and other != out


def test_detector_is_scored_on_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = stroke_csv(tmp_path / "strokes.csv")
    code, scores = run_json(capsys, "detector", "evaluate", "energy", "--recording", str(path))
    assert code == 0
    assert scores["figures"]["samples"]["value"] == 300
    assert scores["figures"]["auc"]["value"] > 0.9


def test_suspicious_recording_is_reported_before_its_score(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rest is not subtracted, p5 is stuck, each frame is there twice, and nothing is a slip."""
    path = tmp_path / "odd.csv"
    rows = [f"{k / 100},{430 + k // 2 % 7},{'430,' * 4}430,0" for k in range(300)]
    path.write_text("\n".join(["t_s,p0,p1,p2,p3,p4,p5,slip", *rows]) + "\n")
    words = ("detector", "evaluate", "energy", "--recording", str(path))
    code, out, error = call(*words, capsys=capsys)
    assert code == 0 and "warning" not in out
    parts = ("A's counts goes up to 431 and down to 430", "never change: p1, p2, p3, p4, p5",
             "repeat in pairs", "is 0 throughout")  # fmt: skip
    for part in parts:
        assert error.count(part) == 1, part
    warnings = run_json(capsys, *words)[1]["warnings"]
    assert [part in line for part, line in zip(parts, warnings, strict=True)] == [True] * 4


def test_replay_needs_no_label(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = stroke_csv(tmp_path / "strokes.csv")
    lines = [line.rpartition(",")[0] for line in path.read_text().splitlines()]
    path.write_text("\n".join(lines) + "\n")
    words = ("replay", "--tactile", str(path), "--detector", "energy")
    _, result = run_json(capsys, *words)
    assert result["evaluation"] is None and len(result["registered"]) == 2
    code, _, error = call("detector", "evaluate", "energy", "--recording", str(path), capsys=capsys)
    assert code == 2 and "has no label `slip`" in error
