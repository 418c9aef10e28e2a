"""The seeds of the last draw: one a trial; and what is said of networks' seeds together."""

import itertools

import pytest

from scripts.last_draw import (
    FIRST_SEED,
    OBJECTS,
    SEEDS,
    STRENGTHS,
    TAP_SEEDS,
    Draw,
    less_over_seeds,
    less_text,
    student,
)

DRAW = Draw(FIRST_SEED, taps=8, lifts=10)


def seeds_of(name: str) -> list[int]:
    return [*itertools.chain(*DRAW.of_taps(name)), *DRAW.of_lifts(name)]


def test_no_two_trials_of_the_draw_have_one_hand() -> None:
    every = [seed for name in OBJECTS for seed in seeds_of(name)]
    assert len(set(every)) == len(every) == len(OBJECTS) * (8 * len(STRENGTHS) + 10)
    assert min(every) == FIRST_SEED


def test_lifts_have_the_same_seeds_whether_taps_are_asked_for_or_not() -> None:
    """So that each table can be made by itself; the page's lifts of a first object are these."""
    alone = Draw(FIRST_SEED, taps=0, lifts=10)
    assert all(alone.of_lifts(name) == DRAW.of_lifts(name) for name in OBJECTS)
    assert alone.of_lifts(OBJECTS[0]) == range(130_040, 130_050)


def test_a_draw_of_more_trials_than_an_object_has_seeds_is_told() -> None:
    assert not Draw(0, taps=TAP_SEEDS // len(STRENGTHS), lifts=SEEDS - TAP_SEEDS).overlaps
    assert Draw(0, taps=TAP_SEEDS // len(STRENGTHS) + 1, lifts=0).overlaps
    assert Draw(0, taps=0, lifts=SEEDS - TAP_SEEDS + 1).overlaps


def test_a_difference_of_means_has_welchs_interval() -> None:
    """Worked by hand: variances 1 of three and 5.2 of six, so seven degrees of freedom."""
    less = less_over_seeds([1.0, 2.0, 3.0], [6.0, 8.0, 8.0, 10.0, 5.0, 11.0])
    square = 1.0 / 3.0 + 5.2 / 6.0
    freedom = square**2 / ((1.0 / 3.0) ** 2 / 2 + (5.2 / 6.0) ** 2 / 5)
    assert less.mean == pytest.approx(-6.0)
    assert less.interval is not None
    low, high = less.interval
    assert freedom == pytest.approx(6.99, abs=0.01)
    assert high - less.mean == pytest.approx(2.365 * square**0.5, rel=0.002)
    assert less.mean - low == pytest.approx(high - less.mean)


def test_students_quantile_is_that_of_the_tables_between_whole_degrees_too() -> None:
    assert student(4.0) == pytest.approx(2.776, rel=0.003)
    assert student(5.5) == pytest.approx(2.503, rel=0.003)
    assert student(9.0) == pytest.approx(2.262, rel=0.003)


def test_seeds_that_agree_or_are_too_few_have_no_spread_to_tell() -> None:
    assert less_over_seeds([0.5, 0.5], [0.25, 0.25]) == (0.25, (0.25, 0.25))
    assert less_over_seeds([0.5], [0.25, 0.75]) == (0.0, None)


def test_the_difference_that_the_pages_name_is_of_the_seeds_that_they_list() -> None:
    """docs/last-draw.md, "The real clip"."""
    tcn, gru = (0.911, 0.909, 0.927, 0.918, 0.910), (0.950, 0.947, 0.949, 0.913, 0.924)
    told = less_text((("tcn", tcn), ("gru", gru)))
    assert told.startswith("`tcn` less `gru`, in the mean: AUC -0.022 [-0.042, -0.001], ")
    assert "seeds alone" in told and "not over strokes" in told
    assert less_text((("tcn", tcn[:1]), ("gru", gru))).endswith("AUC -0.026")
