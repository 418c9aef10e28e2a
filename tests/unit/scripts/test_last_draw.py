"""The seeds of the last draw: one a trial."""

import itertools

from scripts.last_draw import FIRST_SEED, OBJECTS, SEEDS, STRENGTHS, Draw

DRAW = Draw(FIRST_SEED, taps=8, lifts=10)


def seeds_of(name: str) -> list[int]:
    return [*itertools.chain(*DRAW.of_taps(name)), *DRAW.of_lifts(name)]


def test_no_two_trials_of_the_draw_have_one_hand() -> None:
    every = [seed for name in OBJECTS for seed in seeds_of(name)]
    assert len(set(every)) == len(every) == len(OBJECTS) * (8 * len(STRENGTHS) + 10)
    assert min(every) == FIRST_SEED


def test_a_draw_of_more_trials_than_an_object_has_seeds_is_told() -> None:
    assert not Draw(0, taps=8, lifts=SEEDS - 8 * len(STRENGTHS)).overlaps
    assert Draw(0, taps=8, lifts=SEEDS - 8 * len(STRENGTHS) + 1).overlaps
