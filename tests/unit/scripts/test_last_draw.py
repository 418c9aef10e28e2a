"""The seeds of the last draw: one a trial."""

import itertools

from scripts.last_draw import FIRST_SEED, OBJECTS, SEEDS, STRENGTHS, TAP_SEEDS, Draw

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
    assert alone.of_lifts(OBJECTS[0]) == range(80_040, 80_050)


def test_a_draw_of_more_trials_than_an_object_has_seeds_is_told() -> None:
    assert not Draw(0, taps=TAP_SEEDS // len(STRENGTHS), lifts=SEEDS - TAP_SEEDS).overlaps
    assert Draw(0, taps=TAP_SEEDS // len(STRENGTHS) + 1, lifts=0).overlaps
    assert Draw(0, taps=0, lifts=SEEDS - TAP_SEEDS + 1).overlaps
