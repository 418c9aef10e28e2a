import numpy as np
import pytest

from detector.decision import RuleSettings, registered_events
from detector.scores.label_free import MARGIN_SAMPLES, calibrate_rule, find_hold, tail_level
from drivers.errors import UsageError


def quiet(minutes, seed=0, scale=1.0, fingers=3):
    """Slip probabilities of a holding hand: log-odds about -4, with an exponential tail."""
    rng = np.random.default_rng(seed)
    odds = -5.0 + scale * rng.exponential(0.5, (round(6000 * minutes), fingers))
    return 1.0 / (1.0 + np.exp(-odds))


def hold_counts(n=3000, load=-60, unload_at=2600):
    counts = np.zeros((n, 3, 6), np.int16)
    counts[300:unload_at] = load
    return counts


def test_calibrated_rule_keeps_to_its_budget_on_more_data_of_the_hold() -> None:
    for rule, budget in (
        (RuleSettings(kind="consecutive", consecutive=1), 1.0),
        (RuleSettings(kind="consecutive", consecutive=2, fusion="mean"), 4.0),
        (RuleSettings(kind="cusum", drift=-4.5, threshold=0.0111, release=3), 4.0),
    ):
        rates = []
        for seed in range(5):
            found = calibrate_rule([quiet(3.0, seed)], rule, budget, 300.0)
            rates.append(len(registered_events(quiet(20.0, 100 + seed), found.rule)) / 20.0)
        assert 0.4 * budget < np.median(rates) < 2.0 * budget, rule


def test_interval_contains_the_level_and_narrows_with_more_data():
    short, long = (
        calibrate_rule([quiet(m, 1)], RuleSettings(), 1.0, 300.0) for m in (1.0, 12.0)
    )  # fmt: skip
    for found in (short, long):
        assert found.interval[0] <= found.level <= found.interval[1]
    assert np.ptp(long.interval) < 0.6 * np.ptp(short.interval)
    assert long.minutes == pytest.approx(12.0, abs=0.05)


def test_level_falls_with_the_budget():
    maxima = np.random.default_rng(0).exponential(1.0, 180)
    levels = [tail_level(maxima, budget) for budget in (0.1, 1.0, 10.0)]
    assert levels == sorted(levels, reverse=True)


def test_hold_that_looks_like_slip_or_is_too_short_is_refused():
    loud = np.full((6000, 3), 0.9999)
    with pytest.raises(UsageError, match="without slip as slip"):
        calibrate_rule([loud], RuleSettings(), 1.0, 300.0)
    with pytest.raises(UsageError, match="too few"):
        calibrate_rule([quiet(0.3)], RuleSettings(), 1.0, 300.0)
    with pytest.raises(UsageError, match="budget of 0 false alarms"):
        calibrate_rule([quiet(3.0)], RuleSettings(), 0.0, 300.0)


def test_hold_is_between_grip_and_unloading():
    hold, load = find_hold(hold_counts())
    assert (hold.start, hold.stop) == (300 + MARGIN_SAMPLES, 2599 - MARGIN_SAMPLES)
    assert load == 18 * 60


def test_unloaded_fingertips_and_a_hand_that_never_opens_are_refused():
    with pytest.raises(UsageError, match="presses nothing"):
        find_hold(hold_counts(load=-1))
    with pytest.raises(UsageError, match="presses nothing"):
        find_hold(hold_counts(load=0))
    with pytest.raises(UsageError, match="does not end unloaded"):
        find_hold(hold_counts(unload_at=3000))
