"""Detection latency: delays, table and chart of a tiny grid."""

from pathlib import Path

import numpy as np
import pytest

from detector.recordings import write
from scenarios.benchmark.scoring import contender
from studies import detection_latency as study
from studies.runner import main
from tests.unit.detector.toy_recordings import toys


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for recording in toys("test", 3, 50):
        write(tmp_path / f"{recording.source}.npz", recording)
    return tmp_path


def test_delays_are_those_of_the_evaluation(data: Path) -> None:
    row = study.trial(study.Task("psd-fair", "", (str(data),), "slip"))
    sheet = contender("psd-fair", toys("test", 3, 50), "test").evaluation()
    assert len(row.delays_ms) == sheet.true_events
    assert int(np.isinf(row.delays_ms).sum()) == sheet.missed_events
    assert row.false_per_min_hand == sheet.false_events_per_min_hand


def test_the_table_and_the_chart_have_the_paper_s_figure(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    words = ["energy", "psd-fair", "--data", str(data), "--jobs", "1", "--out", str(tmp_path)]
    assert main("detection_latency", study.STUDY, words) == 0
    text = capsys.readouterr().out
    assert "| `psd-fair`, slip |" in text and "later than the paper's 113 ms" in text
    assert "paper's mean, real fingertip" in (tmp_path / "chart.svg").read_text()
