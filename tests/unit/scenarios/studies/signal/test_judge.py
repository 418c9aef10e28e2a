"""A data set beside a real clip: pieces, their statistics, ranks and widths, and a classifier."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.recordings import Metadata, Recording, read_csv
from scenarios.studies.signal.judge.figures import STATISTICS, figures_of, lag_one
from scenarios.studies.signal.judge.pieces import (
    PIECE_SAMPLES,
    Piece,
    around_each_stroke,
    piece_of,
    pieces,
)
from scenarios.studies.signal.judge.report import clip_of, judge, without
from scenarios.studies.signal.judge.telling_apart import tell_apart
from scenarios.studies.signal.judge.verdict import (
    compare_pieces,
    load_changes,
    shares_inside,
    surface_trends,
)

FELT = Path(__file__).parents[6] / "shared" / "data" / "takktile_felt.csv"
STROKE, PAUSE = 60, 40  # samples


def made(
    seed: int, swing: float = 0.0, size: float = 10.0, smooth: int = 1, taxels: int = 6,
    source: int = 0,
) -> Piece:  # fmt: skip
    """Four strokes and five pauses: wandering taxels in strokes, noise in pauses; the load
    alternates by ``swing`` from pause to pause."""
    rng = np.random.default_rng(seed)
    slip = np.array(([False] * PAUSE + [True] * STROKE) * 4 + [False] * PAUSE)
    steps = rng.standard_normal((len(slip), taxels)) * np.linspace(1.0, 0.1, taxels) * size
    kernel = np.ones(smooth) / np.sqrt(smooth)
    steps = np.stack([np.convolve(column, kernel, "same") for column in steps.T], axis=1)
    counts = np.cumsum(np.where(slip[:, None], steps, 0.0), axis=0)
    pause = np.cumsum(np.diff(slip.astype(int), prepend=0) == -1)
    counts += 0.1 * size * rng.standard_normal(counts.shape)
    for k in range(5):  # only the given swing is left of the load in the pauses
        inside = (pause == k) & ~slip
        counts[inside] += (swing * (k % 2) - counts[inside].sum(axis=1).mean()) / taxels
    return piece_of(counts, slip, source)


def recording(seed: int, direction: str = "0", pieces_long: int = 1, **how: float) -> Recording:
    parts = [made(1000 * seed + k, **how) for k in range(pieces_long)]  # type: ignore[arg-type]
    counts = np.concatenate([p.counts[:PIECE_SAMPLES] for p in parts]).round().astype(np.int16)
    slip = np.concatenate([p.slip[:PIECE_SAMPLES] for p in parts])
    metadata = Metadata(
        set="slide", split="train", surface="planar", motion="primary", speed_mps=0.05,
        spin_radps=0.0, direction=direction, seed=seed,
    )  # fmt: skip
    return Recording(np.arange(len(slip)) * 0.01, counts[:, None], slip, None, "", metadata)


def test_a_recording_is_cut_into_pieces_as_long_as_the_clip() -> None:
    found = pieces([recording(1, pieces_long=2), recording(2, direction="90")])
    assert [p.source for p in found] == [0, 0, 1]
    assert [p.along for p in found] == [True, True, False]
    assert all(len(p.counts) == PIECE_SAMPLES for p in found)


def test_short_recordings_and_confusers_are_no_pieces() -> None:
    whole = recording(1)
    cut = msgspec.structs.replace(whole, counts=whole.counts[:200], slip=whole.slip[:200])
    assert pieces([cut]) == []
    shaken = msgspec.structs.replace(
        whole, metadata=msgspec.structs.replace(whole.metadata, set="confusers", cause="tap")
    )
    assert pieces([shaken]) == []


def test_each_stroke_with_its_two_pauses_is_a_piece_of_its_own() -> None:
    parts = list(around_each_stroke(made(1)))
    assert [len(p.counts) for p in parts] == [2 * PAUSE + STROKE] * 4


def test_load_that_follows_the_stroke_shows_as_a_change_from_pause_to_pause() -> None:
    swings = figures_of(made(3, swing=-500.0))
    steady = figures_of(made(3, swing=0.0))
    assert swings["load: pause to pause"] == pytest.approx(500.0, abs=5.0)
    assert swings["load: same direction"] < 10.0
    assert steady["load: pause to pause"] < 10.0
    assert swings["load: deviation over mean"] > 0.8


def test_smoother_steps_are_seen_as_smoother() -> None:
    rough, smooth = (figures_of(made(4, smooth=n)) for n in (1, 5))
    assert smooth["slip: lag 1"] > rough["slip: lag 1"] + 0.3


def test_increments_of_a_straight_line_repeat_each_other_wholly() -> None:
    alternating = np.tile([[1.0], [-1.0]], (50, 1))
    assert lag_one(alternating) == pytest.approx(-0.99)


def test_every_statistic_is_told_of_pads_with_any_number_of_taxels() -> None:
    for taxels in (4, 6, 8):
        found = figures_of(made(5, taxels=taxels))
        assert set(found) == {s.name for s in STATISTICS}
        assert np.isfinite(list(found.values())).all()


def test_a_piece_of_the_set_itself_lies_inside_and_a_louder_one_outside() -> None:
    of = [made(k, source=k) for k in range(40)]
    rows = {r.name: r for r in compare_pieces(made(99), of)}
    louder = {r.name: r for r in compare_pieces(made(99, size=100.0), of)}
    assert rows["slip: 99 % step"].inside
    assert not louder["slip: 99 % step"].inside
    inside, _, of_all = shares_inside(list(rows.values()))["slip"]
    assert inside >= 0.8 * of_all


def test_a_set_that_is_wide_enough_for_anything_is_called_wide() -> None:
    sizes = np.geomspace(0.5, 500.0, 40)
    of = [made(k, size=float(size), source=k) for k, size in enumerate(sizes)]
    row = next(r for r in compare_pieces(made(99), of) if r.name == "slip: mean step")
    assert row.inside
    assert not row.narrow


def test_changes_of_load_are_told_by_direction() -> None:
    along = pieces([recording(1, "180", swing=-400.0)])
    across = pieces([recording(2, "90", swing=-100.0)])
    found = load_changes(along + across)
    assert found["along the finger"] == pytest.approx(400.0, abs=5.0)
    assert found["other strokes"] == pytest.approx(100.0, abs=5.0)
    assert found["turning"] is None


@pytest.mark.parametrize("state", ["rest", "slip"])
def test_what_is_alike_cannot_be_told_apart_and_what_differs_can(state: str) -> None:
    of = [made(k, source=k) for k in range(16)]
    alike = tell_apart(made(99), of, state, controls=2)  # type: ignore[arg-type]
    other = tell_apart(made(99, size=40.0, smooth=4), of, state, controls=2)  # type: ignore[arg-type]
    assert alike is not None and other is not None
    assert alike.auc < 0.75
    assert alike.low <= alike.auc <= alike.high
    assert max(other.control) < 0.85 < other.auc
    assert other.rank == 100.0


def test_a_set_without_strokes_is_not_judged() -> None:
    assert judge(made(1), [], "none") is None


@pytest.mark.skipif(not FELT.exists(), reason="the authors' clip is not distributed")
def test_the_authors_clip_has_the_swing_of_load_that_made_this_judge_necessary() -> None:
    found = figures_of(clip_of(read_csv(FELT)))
    assert found["load: pause to pause"] > 500.0
    assert found["load: same direction"] < 100.0
    assert found["rest: mean step"] == pytest.approx(2.8, abs=0.1)
    assert found["slip: mean step"] == pytest.approx(12.5, abs=0.1)
    assert found["slip: largest step"] == 212.0


def test_surfaces_are_told_apart_in_the_order_of_the_paper() -> None:
    loud, quiet = made(1, size=20.0), made(2, size=2.0)
    found = surface_trends([
        msgspec.structs.replace(quiet, surface="felt"),
        msgspec.structs.replace(quiet, surface="sphere"),
        msgspec.structs.replace(loud, surface="planar"),
    ])  # fmt: skip
    assert [s.surface for s in found] == ["planar", "sphere", "felt"]
    assert [s.authors_f1 for s in found] == [94.0, 88.9, None]
    assert found[0].std > 3 * found[1].std
    assert all(0.5 < s.auc <= 1.0 for s in found)


def test_what_a_set_is_without_a_term_has_the_ranks_and_the_load() -> None:
    clip = made(3)
    found = without(clip, [recording(k, swing=100.0) for k in range(4)], "lever")
    assert found.term == "lever"
    assert 0.0 <= found.ranks["slip: mean step"] <= 100.0
    assert found.load_changes["all"] is not None and found.load_changes["all"] > 50.0
