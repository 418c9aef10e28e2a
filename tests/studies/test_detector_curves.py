"""Delay against false alarms: points, table and chart of a tiny grid."""

from pathlib import Path

import pytest

from detector.recordings import write
from studies import detector_curves as study
from studies.runner import main
from tests.unit.detector.toy_recordings import toys


def test_small_study_gives_points_table_and_chart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    for recording in toys("test", 2, 50):
        write(tmp_path / f"{recording.source}.npz", recording)
    words = ["energy", "--data", str(tmp_path), "--jobs", "1", "--out", str(tmp_path)]
    assert main("detector_curves", study.STUDY, words) == 0
    assert "| `energy` |" in capsys.readouterr().out
    assert "human grip reflex" in (tmp_path / "chart.svg").read_text()
