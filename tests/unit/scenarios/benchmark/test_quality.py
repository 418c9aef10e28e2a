"""The score: its ends, its paired differences, and its order."""

import msgspec
import numpy as np
import pytest

from scenarios.benchmark.quality import Trials, halves_agree, interval, resolved, scores


def made(lifts: float, taps: float = 1.0, alarms: int = 0, seed: int = 1) -> Trials:
    """Made-up trials: a common luck of each lift, with the given mean, and 40 hands of 4 taps."""
    luck = np.random.default_rng(0).uniform(-0.3, 0.3, 160)
    own = np.random.default_rng(seed).uniform(-0.05, 0.05, 160)
    qualities = np.clip(lifts + luck + own, 0.0, 1.0).tolist()
    return Trials(qualities, [(3.0 * taps, 3, 1.0, 1)] * 40, [(alarms, 60.0)] * 40)


SILENCE, ORACLE = made(0.3, 0.0), made(0.7)


def test_silence_has_0_the_oracle_100_and_a_false_alarm_a_minute_costs_a_hundredth() -> None:
    assert not scores(SILENCE, SILENCE, ORACLE).any()
    assert scores(ORACLE, SILENCE, ORACLE) == pytest.approx(1.0)
    quiet, loud = (made(0.6, 0.8, alarms) for alarms in (0, 2))
    raw = [scores(each, Trials([0.0] * 160, [], []), Trials([1.0] * 160, [(1, 1, 1, 1)] * 2, []))[0]
           for each in (quiet, loud)]  # fmt: skip
    assert raw[0] - raw[1] == pytest.approx(0.02)
    assert raw[0] == pytest.approx(np.mean(quiet.lifts) / 2 + (0.8 + 1.0) / 4)
    assert scores(made(0.1, 0.0, 9), SILENCE, ORACLE)[0] < 0.0


def test_a_difference_on_the_same_trials_is_resolved_where_the_scores_overlap() -> None:
    a, b = (scores(made(q, 0.8, seed=i), SILENCE, ORACLE) for i, q in ((2, 0.60), (3, 0.61)))
    one, other, less = interval(a), interval(b), interval(b - a)
    assert one.high and other.low and one.high > other.low
    assert resolved(less) and less.low and less.low > 0.0


def test_two_halves_must_order_every_resolved_pair_alike() -> None:
    rows = [made(q, 0.8, seed=i) for i, q in enumerate((0.7, 0.6, 0.6, 0.5))]
    pairs = halves_agree(rows, SILENCE, ORACLE)
    assert {(a, b) for a, b, _ in pairs} >= {(0, 1), (0, 3), (1, 3), (2, 3)}
    assert all(alike for *_, alike in pairs)
    # better than the second, but in one half alone
    lifts = [q + 0.2 if i // 8 % 2 else q - 0.05 for i, q in enumerate(rows[1].lifts)]
    uneven = msgspec.structs.replace(rows[1], lifts=lifts)
    assert halves_agree([rows[1], uneven], SILENCE, ORACLE) == [(0, 1, False)]
