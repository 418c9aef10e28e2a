"""Reactions tried on copies of a lift: they agree with the full path, and later is worse."""

import math

import pytest

from grasp.closing import CLOSED_COUNTS
from grasp.commands import CloseFast
from grasp.guard import THUMB_ALONE
from scenarios.lift.scoring import LiftOutcome
from scenarios.studies.reaction.copies import (
    Copy,
    Grid,
    GridPoint,
    Reaction,
    SeedStudy,
    at_lift,
    find_onset,
    react,
    study,
)
from scenarios.studies.reaction.summary import summarize
from tests.unit.scenarios.conftest import config

CLOSE = CloseFast(10.0, THUMB_ALONE, CLOSED_COUNTS, 0.11)
LATE_NS = 600_000_000


@pytest.fixture(scope="module")
def ball() -> Copy:
    return at_lift(config(object_name="ball"), 1)


@pytest.fixture(scope="module")
def onset_ns(ball: Copy) -> int:
    found = find_onset(ball)
    assert found is not None
    return found


def test_a_later_answer_slips_further_until_the_ball_is_lost(ball: Copy, onset_ns: int) -> None:
    settings = config(object_name="ball")
    early, late, lost = (
        react(settings, ball, onset_ns + after_ns, CLOSE) for after_ns in (0, 100_000_000, LATE_NS)
    )
    assert early.success and late.success
    assert early.slip_distance_m is not None and late.slip_distance_m is not None
    assert early.slip_distance_m + 0.005 < late.slip_distance_m
    assert (lost.success, lost.slip_distance_m) == (False, None)


def test_a_copy_leaves_the_world_that_it_was_made_from_alone(ball: Copy, onset_ns: int) -> None:
    settings = config(object_name="ball")
    first = react(settings, ball, onset_ns, CLOSE)
    react(settings, ball, onset_ns + LATE_NS, CLOSE)
    assert react(settings, ball, onset_ns, CLOSE) == first


@pytest.mark.parametrize("name", ["can", "foam"])
def test_a_copy_agrees_with_the_full_path_given_the_same_command(name: str) -> None:
    found = study(config(object_name=name), 2, Grid((), ()), check=True)
    assert found.check is not None
    full, reduced = found.check.full, found.check.reduced
    assert full.success == reduced.success
    if full.success:
        assert full.slip_distance_m is not None
        assert reduced.slip_distance_m == pytest.approx(full.slip_distance_m, abs=1e-4)


def test_fingers_move_after_the_latency_asked_for() -> None:
    found = study(config(object_name="can"), 0, Grid((100.0,), (0.11,)), check=False)
    (point,) = found.grid
    assert point.reaction.rise_ms == pytest.approx(105, abs=15)  # a tick, and the rise itself


def test_what_never_slips_has_no_reaction() -> None:
    found = study(
        config("object.added_mass_kg=0", "object.mass_kg=0.02"), 0, Grid((0.0,), (0.1,)), True
    )
    assert found == SeedStudy("can", 0, slipped=False)


def test_curves_name_their_cliff_and_count_a_loss_as_infinite() -> None:
    held = Reaction(LiftOutcome.HELD, 0.01, 50.0)
    lost = Reaction(LiftOutcome.DROPPED, None, None)
    grid = [GridPoint(50.0, 0.1, held), GridPoint(100.0, 0.1, lost)]
    summary = summarize("default", "energy", ["ball"], [SeedStudy("ball", 0, True, grid)])
    (curve,) = summary.curves
    assert curve.cliff == (50.0, 1.0, 100.0, 0.0)
    assert [p.slip_mm.p50 for p in curve.points] == [10.0, math.inf]
