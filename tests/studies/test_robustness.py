"""The robustness study on toy recordings."""

import numpy as np
import pytest

from detector.energy import EnergyDetector, EnergySettings
from detector.scores.evaluation import stream_recordings
from studies import robustness
from studies.robustness import GRID, NOISE_COUNTS, PAD, Row, Task, chosen, perturbed
from studies.runner import draw
from tests.unit.detector.impact_recordings import impact_recording
from tests.unit.detector.toy_recordings import toys

HAND = impact_recording((3.0, 0.003), (6.0, 0.0))


def changes(kind: str, amount: float):
    return perturbed(HAND, kind, amount).counts.astype(float) - HAND.counts


def test_a_small_study_gives_a_table_and_a_chart(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(robustness, "_recordings", lambda data, most: toys("test", 3, 20))
    tasks = [Task(k, amounts[0], ("energy",), (), 9) for k, (_, _, amounts) in GRID.items()
             if k != PAD]  # fmt: skip
    rows = [robustness.trial(task) for task in (Task("", 0.0, ("energy",), (), 9), *tasks)]
    table = robustness.STUDY.table(rows)
    assert "| none | energy |" in table and "| lost: 0.01 of the samples | energy |" in table
    (energy,) = rows[0].scores
    assert energy.taps is None and energy.accuracy > 0.5
    assert isinstance(rows[0], Row)
    draw(robustness.STUDY, rows, tmp_path / "chart.svg")
    assert (tmp_path / "chart.svg").exists()


@pytest.mark.parametrize("kind", [kind for kind in GRID if kind != PAD])
def test_neutral_amount_changes_no_sample(kind: str) -> None:
    changed = perturbed(HAND, kind, GRID[kind][1])
    assert (changed.counts == HAND.counts[: len(changed.t_s)]).all()


def test_each_perturbation_has_the_size_that_it_names() -> None:
    assert changes("noise", 2.0).std() == pytest.approx(NOISE_COUNTS * np.sqrt(3), rel=0.05)
    assert np.abs(changes("drift", 60.0)[-1]).tolist() == np.full((3, 6), 9.0).tolist()  # in 9 s
    assert changes("temperature", 10.0)[350].tolist() == np.full((3, 6), 16.0).tolist()
    lost = perturbed(HAND, "lost", 0.1).counts
    assert (lost[1:] == lost[:-1]).all(axis=(1, 2)).mean() == pytest.approx(0.1, abs=0.03)
    for kind in ("dead", "stuck", "swapped"):
        assert set(np.argwhere(changes(kind, 1.0).any(axis=0))[:, 0]) == {0}


def test_recordings_streamed_together_have_the_output_of_separate_ones() -> None:
    def energy(fingers: int, taxels: int = 6) -> EnergyDetector:
        return EnergyDetector(EnergySettings(threshold_counts=2.0), fingers, taxels)

    mixed = [*toys("test", 2, 0), impact_recording((3.0, 0.003), n=500), *toys("test", 1, 7)]
    together = robustness.stream_together(energy, mixed)
    for one, other in zip(stream_recordings(energy, mixed), together, strict=True):
        assert (one.probabilities == other.probabilities).all()
    assert len(chosen(mixed, 2)) == 2 and len(chosen(mixed, 9)) == 4
