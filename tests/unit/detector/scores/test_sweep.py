"""Sweep of decision rules: points agree with the evaluation, the best keeps to its budget."""

import numpy as np
import pytest
from numpy.typing import NDArray

from detector.decision import RuleSettings
from detector.recordings import Recording
from detector.scores.evaluation import Streamed, evaluate_streams
from detector.scores.sweep import best, rules, sweep
from tests.unit.detector.scores.test_evaluation import Scripted, flags, times


def noisy(seed: int, fingers: int = 1) -> Streamed:
    """Delayed response to slip, with noise that sometimes looks like slip."""
    rng = np.random.default_rng(seed)
    slip = flags(300, 60, 400, 60, 300, 60, 200)
    response = np.convolve(slip, np.ones(6) / 6)[: len(slip)]
    odds = 8 * response - 4 + rng.normal(0, 2, len(slip)) + 5 * (rng.random(len(slip)) < 0.01)
    p: NDArray[np.float64] = 1 / (1 + np.exp(-odds))
    counts = np.zeros((len(slip), fingers, 6), np.int16)
    made = Recording(times(len(slip)), counts, slip, None, "made")
    return Streamed(made, np.repeat(p[:, None], fingers, axis=1), np.empty(0))


STREAMS = [noisy(seed) for seed in range(3)]


def test_sweep_point_equals_the_evaluation_of_its_rule() -> None:
    for p in sweep(STREAMS, list(rules(RuleSettings()))[::40]):
        sheet = evaluate_streams(Scripted(np.zeros(1)), p.rule, STREAMS, "made")
        assert p.false_per_min == sheet["false_per_min"]
        assert p.recall == sheet["recall"]
        swept = (p.delay_ms, p.p90_delay_ms, p.p99_delay_ms)
        assert swept == tuple(sheet[f"delay_{share}_ms"] for share in ("p50", "p90", "p99"))


def test_best_rule_is_the_fastest_within_the_budget() -> None:
    points = sweep(STREAMS, rules(RuleSettings()))
    for budget in (0.0, 5.0, 60.0):
        chosen = best(points, budget)
        assert chosen is not None
        assert chosen.false_per_min <= budget
        quicker = [p for p in points if p.mean_delay_ms < chosen.mean_delay_ms]
        assert all(p.false_per_min > budget for p in quicker)
    assert best([], 1.0) is None


def test_single_finger_counts_as_a_third_of_a_hand() -> None:
    rule = RuleSettings()
    (alone,), (hand,) = sweep([noisy(0)], [rule]), sweep([noisy(0, fingers=3)], [rule])
    assert alone.false_per_min == pytest.approx(3 * hand.false_per_min)
