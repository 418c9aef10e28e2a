"""Whether what the ideal observer hears of another fingertip is told of the same blows."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

pytest.importorskip("torch")

from detector.recordings import Recording
from scenarios.rigs.workers import Workers
from scenarios.studies.detectors import fingertips
from scenarios.studies.detectors.fingertips import (
    AS_IT_IS,
    FINGERTIPS,
    Felt,
    differences,
    jobs_of,
    recorded,
    study,
    tables,
)
from tests.unit.detector.blow_toys import struck

BY_TITLE = {felt.title: felt for felt in FINGERTIPS}


def ignored(done: int, total: int, what: str) -> None:
    """Nobody watches."""


def test_objects_and_blows_are_the_same_whatever_feels_them() -> None:
    base = jobs_of(BY_TITLE[AS_IT_IS], 0.01)
    for felt in FINGERTIPS:
        jobs = jobs_of(felt, 0.01)
        assert [j.path for j in jobs] == [j.path for j in base]
        for job, other in zip(jobs, base, strict=True):
            assert (job.metadata.seed, job.metadata.object, job.acts) == (
                other.metadata.seed, other.metadata.object, other.acts,
            )  # fmt: skip
            assert job.metadata.parameters == felt.fixed


def test_a_recording_lasts_as_many_seconds_at_another_rate() -> None:
    slow, fast = (
        jobs_of(BY_TITLE[f"{rate} samples a second"], 0.01)[0].samples for rate in (50, 200)
    )
    assert fast == 4 * slow


def test_only_what_differs_is_recorded_anew() -> None:
    of_run = {felt.folder for felt in FINGERTIPS if not felt.fixed and not felt.layout}
    assert of_run == {"run"}
    others = [felt.folder for felt in FINGERTIPS if felt.folder != "run"]
    assert len(others) == len(set(others)) and all(others)


def test_taxels_that_are_not_heard_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    made = struck((3.0, 0.003))
    monkeypatch.setattr(fingertips, "build", lambda *_: 0)
    monkeypatch.setattr(fingertips, "read", lambda path: made)
    felt = Felt("two", taxels=(0, 4))
    found = recorded(felt, Path("nowhere"), 0.003, Workers(1), ignored)
    assert (found[0].counts == made.counts[:, :, [0, 4]]).all()


def test_equal_scores_differ_by_nothing_and_better_ones_by_more_than_nothing() -> None:
    rng = np.random.default_rng(0)
    groups = np.repeat(np.arange(30), 10)
    moved = rng.random(300) < 0.5
    poor = moved + rng.normal(0.0, 1.5, 300)
    good = moved + rng.normal(0.0, 0.5, 300)
    same = differences((poor, moved, groups), (poor, moved, groups))
    assert same == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for more, low, high in differences((good, moved, groups), (poor, moved, groups)):
        assert 0.0 < low <= more <= high


def test_recordings_are_drawn_together_so_that_what_they_share_cancels() -> None:
    """Half the recordings are told by nobody: alone each AUC swings with how many are drawn."""
    rng = np.random.default_rng(1)
    groups = np.repeat(np.arange(20), 20)
    moved = rng.random(400) < 0.5
    told = np.where(groups < 10, moved, rng.random(400))
    better = told + 1e-9 * rng.normal(size=400)
    (_, low, high), _ = differences((better, moved, groups), (told, moved, groups))
    assert high - low < 0.02


def hand(seed: int, loud: float) -> Recording:
    rng = np.random.default_rng(seed)
    moves = rng.choice([0.0, 0.0, 0.0008, 0.0015, 0.004], 6)
    made = struck(*((3.0 + 1.5 * k, float(m)) for k, m in enumerate(moves)), n=1400)
    counts = made.counts.astype(np.float64) + rng.normal(0.0, 1.0, made.counts.shape)
    for k, m in enumerate(moves):
        counts[300 + 150 * k :] += loud * 1e4 * m
    return msgspec.structs.replace(made, counts=np.rint(counts).astype(np.int16))


def test_a_fingertip_that_feels_more_is_told_more_of(monkeypatch: pytest.MonkeyPatch) -> None:
    felts = (Felt(AS_IT_IS, folds=2), Felt("louder", "louder", folds=2))
    monkeypatch.setattr(fingertips, "FINGERTIPS", felts)
    monkeypatch.setattr(fingertips, "TIMES_S", (0.05,))
    monkeypatch.setattr(
        fingertips, "recorded",
        lambda felt, *_: [hand(i, 1.0 if felt.folder == "louder" else 0.0) for i in range(24)],
    )  # fmt: skip
    rows = study(Path("nowhere"), 1.0, Workers(1), ignored)
    of = {(row.felt, row.told.title): row for row in rows}
    far = of["louder", "2 mm or more"]
    assert far.told.auc > 0.9 and far.auc_more[1] > 0.0
    assert of[AS_IT_IS, "2 mm or more"].auc_more == (0.0, 0.0, 0.0)
    printed = tables(rows)
    assert printed.index("2 mm or more:") < printed.index("1-2 mm:") < printed.index("0.5-1 mm:")
    assert "| as it is |" in printed and "| – |" in printed
