"""Delay against false events: points, table and chart of a tiny grid."""

import math
from pathlib import Path

import pytest

from detector.recordings import write
from studies import detector_curves as study
from studies.runner import main
from tests.unit.detector.toys import toys


def test_a_detector_leaves_its_points_its_line_and_its_curve(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    for recording in toys("test", 2, 50):
        write(tmp_path / f"{recording.source}.npz", recording)
    words = ["energy", "--data", str(tmp_path), "--jobs", "1", "--out", str(tmp_path)]
    assert main("detector_curves", study.STUDY, words) == 0
    assert "| `energy` |" in capsys.readouterr().out
    assert "human grip reflex" in (tmp_path / "chart.svg").read_text()


def test_the_table_has_the_quickest_rule_within_the_budget() -> None:
    points = [(0.0, math.inf, math.inf), (0.8, 90.0, 200.0), (3.0, 40.0, 80.0)]
    text = study.table([study.Row("tcn", 0.9, (30.0, 40.0), points)])
    assert text.endswith("| `tcn` | 90 | 200 | 90.0 | 30 | 40 |")


def test_what_never_came_is_drawn_above_the_axis_on_its_detector_s_line() -> None:
    assert study.shown_ms(study.SHOWN_MS, 3) == study.SHOWN_MS
    lines = [study.shown_ms(math.inf, line) for line in range(3)]
    assert lines == [study.SHOWN_MS + study.LINE_MS * k for k in (1, 2, 3)]
