"""The slips of an evaluation, traces of the worst ones, and their file."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.decision import RuleSettings
from detector.recordings import Recording
from detector.scores.evaluation import Streamed
from drivers.errors import BadFile
from scenarios.benchmark.score_file import ScoreFile, Source, read_scores, write_scores
from scenarios.benchmark.scoring import contender
from scenarios.benchmark.slips import evaluated, scored_slips, trace
from tests.unit.detector.toy_recordings import toys

RULE = RuleSettings(kind="consecutive", consecutive=1, threshold=0.5, fusion="any", release=1)


def streamed(delays: dict[int, int]) -> Streamed:
    """Two slips, of 50 samples from 200 and 400 on, at 50 mm/s; detected after ``delays``."""
    slip = np.zeros(600, bool)
    slip[200:250] = slip[400:450] = True
    p = np.full((600, 1), 0.1)
    for onset, late in delays.items():
        p[onset + late : onset + 50] = 0.9
    counts = np.zeros((600, 1, 6), np.int16)
    counts[200:, :, 0] = -30
    speed = np.where(slip, 0.05, 0.0).astype(np.float32)
    recording = Recording(
        np.arange(600) * 0.01, counts, slip, slip, "set/surface/one.npz", contact_speed_mps=speed
    )
    return Streamed(recording, p, np.zeros(0))


def test_trace_has_the_samples_around_its_slip_with_positive_pressing() -> None:
    one = streamed({200: 7})
    (slip, _) = scored_slips(one, RULE)
    shown = trace(one, slip, RULE)
    assert shown.t_s[0] == pytest.approx(-0.5) and shown.t_s[-1] == pytest.approx(1.0)
    at = shown.t_s.index(0.0)
    assert shown.pressed[0][at - 1 : at + 1] == [0.0, 30.0]
    assert shown.probabilities[at + 6 : at + 8] == [0.1, 0.9]
    assert shown.slipping == [(0.0, pytest.approx(0.5))]


def test_slips_and_misses_equal_those_of_the_evaluation() -> None:
    made = contender("psd-fair", toys("test", 4, 50), "toys")
    sheet = made.evaluation()
    kept = evaluated(made, sheet)
    assert len(kept.slips) == sheet["slips"]
    assert sum(slip.delay_ms is None for slip in kept.slips) == sheet["missed"]
    assert kept.figures["auc"].value == sheet["auc"] and kept.figures["auc"].low is not None


def test_evaluation_file_is_read_back_and_another_file_is_refused(tmp_path: Path) -> None:
    made = contender("energy", toys("test", 2, 50), "toys")
    kept = [evaluated(made, made.evaluation())]
    file = ScoreFile(source=Source("toys", "", "slip"), command="grasp", detectors=kept)
    path = tmp_path / "one.json"
    write_scores(path, file)
    assert read_scores(path)[0].detectors[0].slips == kept[0].slips
    whole = path.read_bytes()
    for other in (
        b'{"format": "something"}',
        msgspec.json.encode(msgspec.structs.replace(file, detectors=[])),
        whole.replace(b'"probabilities":[', b'"probabilities":[0.5,'),
    ):
        path.write_bytes(other)
        with pytest.raises(BadFile, match="is no file of scores"):
            read_scores(path)
