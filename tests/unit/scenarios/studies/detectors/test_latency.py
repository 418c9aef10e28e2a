"""Latency as the paper counts it, and its picture."""

import json
from pathlib import Path

import numpy as np
import pytest

from detector.recordings import write
from drivers.errors import UsageError
from grasp.cli.main import main
from scenarios.benchmark.scoring import contender
from scenarios.studies.detectors.latency import latency
from tests.unit.detector.toys import toy, toys
from tests.unit.scenarios.conftest import EAGER


def test_the_mean_is_of_those_caught_and_a_miss_is_later_than_any() -> None:
    made = contender("energy", toys("test", 3, 50), "test", assignments=[EAGER])
    found = latency(made)
    sheet = made.evaluation()
    caught = [d for d in found.delays_ms if d is not None]
    assert len(found.delays_ms) == sheet.true_events
    assert found.missed == sheet.missed_events
    assert found.mean_ms == pytest.approx(np.mean(caught))
    assert found.of_all == sheet.delay_ms
    assert found.false_per_min_hand == sheet.false_events_per_min_hand
    later = [d is None or d > 113 for d in found.delays_ms]
    assert found.later_than_authors == np.mean(later)
    assert found.detector_hash == made.config.detector_hash()


def test_recordings_without_slip_are_refused() -> None:
    quiet = toy(1, "test", 160)  # shorter than what is left out and the first slip
    quiet.slip[100:] = False
    with pytest.raises(UsageError, match="no slip"):
        latency(contender("energy", [quiet], "test"))


def test_the_picture_has_the_paper_s_figure_in_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    for recording in toys("test", 3, 50):
        write(tmp_path / f"{recording.source}.npz", recording)
    out = tmp_path / "latency.svg"
    assert main(["detector", "latency", "energy", "--data", str(tmp_path), "--out", str(out)]) == 0
    assert "authors' mean, real fingertip: 113 ms" in out.read_text()
    numbers = json.loads(out.with_suffix(".json").read_text())
    assert numbers["of_all"]["count"] == len(numbers["delays_ms"])
    assert "2 in a row above 0.5" in capsys.readouterr().out
