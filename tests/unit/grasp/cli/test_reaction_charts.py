"""`grasp chart reaction` and `hunting`, small."""

import json
from pathlib import Path

import pytest

from grasp.cli.main import main


def test_reaction_chart_leaves_a_picture_and_its_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "reaction.svg"
    words = "--objects ball --latencies 0 600 --speeds 0.11 --seeds 1 --check 1 --jobs 1"
    assert main(["chart", "reaction", *words.split(), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "cliff: ball at 110 mm/s: 100% held at 0 ms, 0% at 600 ms" in shown
    assert "tcn x4" in shown and "1 of 1 verdicts" in shown
    assert out.read_text().startswith("<?xml")
    figures = json.loads(out.with_suffix(".json").read_text())
    assert [point["success"] for point in figures["curves"][0]["points"]] == [1.0, 0.0]


def test_hunting_chart_names_the_default(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp.cli.chart.STEP_MS", 100)
    out = tmp_path / "hunting.svg"
    assert main(["chart", "hunting", "--out", str(out)]) == 0
    assert "1 compensation\n" in capsys.readouterr().out
    assert out.exists()
