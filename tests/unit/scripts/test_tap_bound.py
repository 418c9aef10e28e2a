"""What could be heard of blows, and what a rule's threshold would have to be to hear them."""

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from detector.decision import RuleSettings, log_odds, registered_events
from detector.scores.evaluation import Streamed, spoken
from scripts.last_draw import Struck
from scripts.tap_bound import (
    Scored,
    by_object,
    highest_threshold,
    hits,
    interval,
    moment_of,
    recording_of,
)
from scripts.tap_bound import table as table_of

RULE = RuleSettings(threshold=0.5, consecutive=2, fusion="mean", release=3)
PERIOD_S, STRUCK = 0.01, 100


def blow(moved_mm: float, probabilities: NDArray[np.float64]) -> tuple[Struck, Streamed]:
    """Struck at 1 s, watched for 1.5 s, and what a detector says of three fingers."""
    n = len(probabilities)
    counts = np.zeros((n, 3, 6), np.int16)
    struck = Struck(
        "can", moved_mm, 0.995, 1.0, 2.495, PERIOD_S * np.arange(n, dtype=np.float64), counts
    )
    said = np.repeat(probabilities[:, None], 3, axis=1)
    return struck, Streamed(recording_of(struck), said, np.empty(0))


def pulse(late: int, says: float = 0.9) -> NDArray[np.float64]:
    p = np.full(300, 0.01)
    p[STRUCK + late : STRUCK + late + 5] = says
    return p


@pytest.mark.parametrize(
    ("moved_mm", "late", "says"), [(3.0, 3, 0.9), (3.0, 20, 0.01), (0.1, 20, 0.9), (0.1, 3, 0.9)]
)
def test_blow_that_moved_is_heard_within_a_tenth_of_a_second_and_an_idle_one_while_it_is_watched(
    moved_mm: float, late: int, says: float
) -> None:
    found = highest_threshold(*blow(moved_mm, pulse(late)), RULE)
    assert found == pytest.approx(log_odds(np.array([says]))[0])


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("moved_mm", [0.1, 3.0])
def test_rule_registers_the_blow_just_below_that_threshold_and_not_above(
    moved_mm: float, seed: int
) -> None:
    said = np.full(300, 0.01)
    said[STRUCK + 1 :] = np.random.default_rng(seed).uniform(0.02, 0.98, 300 - STRUCK - 1)
    struck, streamed = blow(moved_mm, said)
    most = 1.0 / (1.0 + np.exp(-highest_threshold(struck, streamed, RULE)))
    last = STRUCK + 10 if moved_mm == 3.0 else 249
    for threshold, heard in ((most - 1e-6, True), (most + 1e-6, False)):
        rule = msgspec.structs.replace(RULE, threshold=threshold)
        starts = registered_events(spoken(streamed, rule)[:, None], rule)[:, 0]
        assert bool((starts <= last).any()) is heard


def test_moment_of_a_blow_is_its_first_sample_and_its_class_how_far_it_moved() -> None:
    struck, _ = blow(1.4, pulse(3))
    moment = moment_of(7, struck)
    assert (moment.recording, moment.sample, moment.lasts, moment.kind) == (7, STRUCK, 150, 2)


CLASSES = np.array([0] * 20 + [3] * 10)
PLAIN = Scored("plain", np.array([*range(20), *range(10, 30, 2)], float))


@pytest.mark.parametrize(("share", "heard"), [(0.0, 0.5), (0.05, 0.5), (0.25, 0.7)])
def test_hits_are_counted_above_all_but_that_share_of_the_idle_ones(
    share: float, heard: float
) -> None:
    assert hits(PLAIN, CLASSES, 3, share) == pytest.approx(heard)


def test_interval_of_a_difference_to_itself_is_nothing() -> None:
    assert interval(PLAIN, PLAIN, CLASSES, 3, 0.05) == (0.0, 0.0)


def test_table_has_a_row_for_each_and_none_less_than_itself() -> None:
    better = Scored("better", np.where(CLASSES == 0, PLAIN.scores, 99.0))
    classes = np.r_[CLASSES, [2, 2]]
    every = [Scored(s.name, np.r_[s.scores, [0.0, 99.0]]) for s in (PLAIN, better)]
    *_, plain, best = table_of(every, every[0], classes).splitlines()
    assert plain.startswith("| `plain` | ") and plain.count("| – ") == 4
    assert best.startswith("| `better` | 100 [100, 100]") and best.endswith("| 50 |")


def test_objects_are_told_apart_at_one_threshold_for_all() -> None:
    scores = np.array([*np.linspace(0.0, 1.0, 20), 0.97, 0.5, 0.99, 2.0])
    classes = np.array([0] * 20 + [3, 3, 3, 2])
    objects = ["can"] * 20 + ["can", "box", "box", "box"]
    lines = by_object([Scored("one", scores)], objects, classes).splitlines()
    assert lines[0] == "| object | `one`, at 5 % | `one`, at 8 % |"
    assert lines[2:] == ["| box | 1 of 2 | 1 of 2 |", "| can | 1 of 1 | 1 of 1 |"]
