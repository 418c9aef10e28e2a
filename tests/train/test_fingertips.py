"""Whether what the ideal observer hears of another fingertip is told of the same blows."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

pytest.importorskip("torch")

from detector.blows import blows_of
from detector.recordings import Recording
from scenarios.rigs.workers import Workers
from scenarios.studies.detectors import fingertips
from scenarios.studies.detectors.fingertips import (
    ANEW,
    AS_IT_IS,
    LESSER,
    Felt,
    differences,
    jobs_of,
    lessened,
    study,
    tables,
)
from tests.unit.detector.blow_toys import struck

pytestmark = pytest.mark.train

FINGERTIPS = (*LESSER, *ANEW)
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
    usual, fast = (jobs_of(BY_TITLE[t], 0.01)[0] for t in (AS_IT_IS, "200 samples a second"))
    assert fast.samples == 2 * usual.samples


def test_lesser_fingertips_are_made_of_the_recordings_as_they_are_and_no_others() -> None:
    assert {felt.folder for felt in LESSER} == {"run"}
    others = [felt.folder for felt in ANEW[1:]]
    assert len(others) == len(set(others)) and "run" not in others


def test_half_the_samples_and_half_the_taxels_leave_every_blow_where_it_was() -> None:
    made = struck((3.0, 0.003), (4.5, 0.0))
    found = lessened(made, Felt("half", taxels=(0, 4), every=2), 0)
    assert (found.counts == made.counts[::2][:, :, [0, 4]]).all()
    for one, other in zip(blows_of(made), blows_of(found), strict=True):
        assert found.t_s[other.struck] - made.t_s[one.struck] in (0.0, pytest.approx(0.01))
        assert one.moved_m == other.moved_m


def test_noise_is_added_to_the_counts_alone() -> None:
    made = struck((3.0, 0.003))
    found = lessened(made, Felt("noisy", noise=4.0), 0)
    assert np.std(found.counts - made.counts) == pytest.approx(0.65 * 15**0.5, rel=0.05)
    assert (found.t_s == made.t_s).all() and found.metadata == made.metadata


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
    monkeypatch.setattr(fingertips, "LESSER", felts)
    monkeypatch.setattr(fingertips, "TIMES_S", (0.05,))
    monkeypatch.setattr(
        fingertips, "recorded",
        lambda felt, *_: [hand(i, 1.0 if felt.folder == "louder" else 0.0) for i in range(24)],
    )  # fmt: skip
    (rows,) = study(Path("nowhere"), 1.0, 0.0, Workers(1), ignored)
    of = {(row.felt, row.told.title): row for row in rows}
    far = of["louder", "2 mm or more"]
    assert far.told.auc > 0.9 and far.auc_more[1] > 0.0
    assert of[AS_IT_IS, "2 mm or more"].auc_more == (0.0, 0.0, 0.0)
    printed = tables([rows])
    assert printed.index("2 mm or more:") < printed.index("1-2 mm:") < printed.index("0.5-1 mm:")
    assert "| as it is |" in printed and "| – |" in printed
