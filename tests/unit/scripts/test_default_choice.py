"""The rule that chooses the default: shares of recordings, their differences, the verdict."""

from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from detector.blows import blows_of
from detector.decision import RuleSettings
from detector.recordings import Recording
from detector.scores.evaluation import Judged, Streamed, cause_of, events_by_label, judge_stream
from scenarios.rigs.workers import Workers
from scripts.default_choice import (
    MEASURES,
    Difference,
    Shares,
    difference,
    drawn_anew,
    judged_by,
    shares,
    table,
    verdict,
)
from tests.unit.detector.blow_toys import PERIOD_S, struck
from tests.unit.detector.toys import toy

FAR, NEAR, IDLE = (2.0, 0.003), (4.0, 0.0015), (6.0, 0.0)  # when, s, and how far, m
RULE = RuleSettings(consecutive=1)
LIFTS, FAR_BLOWS, IDLE_BLOWS = MEASURES


def judged(recording: Recording, *alarms_s: float) -> Judged:
    """By a detector that is sure for one sample at each of these times."""
    p = np.zeros((len(recording.t_s), recording.fingers))
    p[[round(t / PERIOD_S) for t in alarms_s]] = 0.9
    streamed = Streamed(recording, p, np.empty(0))
    return judge_stream(streamed, RULE, events_by_label("slip"), 0, blows_of(recording))


def lift() -> Recording:
    made = toy(1, "validation")
    assert made.metadata is not None
    metadata = msgspec.structs.replace(made.metadata, set="confusers", cause="grasped_slip")
    return msgspec.structs.replace(made, metadata=metadata)


def told(recording: Recording, *alarms_s: float) -> dict[str, tuple[int, int]]:
    found = shares([recording], [[judged(recording, *alarms_s)]])
    return {name: (int(s.right[0, 0]), int(s.of[0, 0])) for name, s in found.items()}


@pytest.mark.parametrize(
    ("after_s", "registered"), [(0.03, 1), (0.13, 1), (0.16, 0)], ids=["at once", "soon", "late"]
)
def test_a_blow_that_moved_it_far_counts_if_it_is_registered_soon(
    after_s: float, registered: int
) -> None:
    """Its motion begins 30 ms after it."""
    assert told(struck(FAR, NEAR), FAR[0] + after_s)[FAR_BLOWS] == (registered, 1)


def test_an_idle_blow_counts_if_nothing_answers_it() -> None:
    assert told(struck(FAR, NEAR, IDLE))[IDLE_BLOWS] == (1, 1)
    assert told(struck(FAR, NEAR, IDLE), IDLE[0] + 0.2)[IDLE_BLOWS] == (0, 1)


def test_slips_count_in_lifts_alone() -> None:
    made = lift()
    first_s = float(made.t_s[made.slip.argmax()])
    caught, slips = told(made, first_s + 0.05)[LIFTS]
    assert caught == 1
    assert slips > 1
    assert told(toy(1, "validation"), first_s + 0.05)[LIFTS] == (0, 0)


def of_recordings(*right: Sequence[int]) -> Shares:
    """Of one blow a recording; a row a seed."""
    return Shares(np.array(right, np.float64), np.ones((len(right), len(right[0]))))


def test_seeds_weigh_alike_and_equal_networks_do_not_differ() -> None:
    some = of_recordings([1, 1, 1, 0], [0, 1, 0, 0])
    assert some.means(np.arange(4)).tolist() == [0.75, 0.25]
    same = difference(some, some)
    assert (same.value, same.interval) == (0.0, (0.0, 0.0))  # the same recordings of both
    assert same.with_seeds[0] < 0.0 < same.with_seeds[1]


def test_an_interval_narrows_with_the_recordings() -> None:
    def width(recordings: int) -> float:
        halves = [i % 2 for i in range(recordings)]
        low, high = difference(of_recordings(halves), of_recordings([1] * recordings)).interval
        assert low < -0.5 < high
        return high - low

    assert width(400) == pytest.approx(4 * 0.5 / 20, rel=0.2)  # 1.96 standard errors each way
    assert width(400) < width(25) / 3


def differing(low: float, high: float) -> Difference:
    return Difference((low + high) / 2, (low, high), (low, high))


@pytest.mark.parametrize(
    ("third", "says"),
    [((-0.02, 0.05), "tcn"), ((-0.05, 0.01), "draw"), ((-0.05, -0.01), "gru"),
     ((-0.02, -0.01), "tcn")],
)  # fmt: skip
def test_it_is_the_tcn_if_not_inferior_and_the_gru_if_the_tcn_is_worse_in_anything(
    third: tuple[float, float], says: str
) -> None:
    assert verdict([differing(0.0, 0.1), differing(-0.01, 0.1), differing(*third)]) == says


def test_the_table_tells_every_seed_and_the_difference_in_points() -> None:
    good, bad = of_recordings([1, 1, 1, 1], [1, 1, 1, 1]), of_recordings([0, 0, 0, 0])
    text, says = table(dict.fromkeys(MEASURES, good), dict.fromkeys(MEASURES, bad))
    assert says == "tcn"
    row = f"| {FAR_BLOWS} | 4 / 4 of 4 | 0 of 4 | +100.0 | [100.0, 100.0] | [100.0, 100.0] |"
    assert row in text


def test_what_is_drawn_anew_is_lifts_and_blows_of_that_seed_alone() -> None:
    made = drawn_anew(31_337, Workers(0), {"grasped_slip": 3, "grasped_blow": 3})
    assert [cause_of(r) for r in made].count("grasped_slip") == 3
    seeds = [r.metadata.seed for r in made if r.metadata is not None]
    assert len(set(seeds)) == len(made) == 6
    assert {seed // 1_000_000 for seed in seeds} == {31_337}
    found = shares(made, [judged_by("tcn", None, made)])
    assert all(s.of.sum() > 0 for s in found.values())  # each measure has what it asks of
