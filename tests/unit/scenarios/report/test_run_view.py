"""The rule's values on a page exceed their limit where the slip monitor registered slip."""

import msgspec
import numpy as np
import pytest

from detector.decision import DecisionRule, RuleSettings
from grasp.control.slip_monitor import SlipMonitor, SlipSettings
from scenarios.report.run_view import decided, in_words

CUSUM = RuleSettings(kind="cusum", limit=6.0, drift=0.3, threshold=0.6)
SAMPLES, PERIOD_NS = 3000, 10_000_000


def watched(settings: RuleSettings, seed: int) -> tuple[np.ndarray, ...]:
    """Probabilities, and for each sample whether it is armed, masked, registered, an event.

    The monitor is armed after a while, and masked for closings at random times."""
    rng = np.random.default_rng(seed)
    monitor = SlipMonitor(DecisionRule(settings, 3), SlipSettings())
    level = np.repeat(rng.uniform(-3.0, 3.0, SAMPLES // 20), 20)
    p = 1.0 / (1.0 + np.exp(-(level[:, None] + rng.normal(0.0, 1.0, (SAMPLES, 3)))))
    status = []
    for i in range(SAMPLES):
        now_ns = i * PERIOD_NS
        slip = monitor.update(now_ns, p[i])
        status.append((slip.armed, slip.masked, slip.registered, slip.event))
        if i == 100:  # after the sample, as the controller does
            monitor.arm()
            status[-1] = (True, False, False, False)
        elif i > 100 and rng.random() < 0.01:
            monitor.closing(now_ns)
    return p, *np.array(status).T


@pytest.mark.parametrize("fusion", ["any", "mean"])
@pytest.mark.parametrize("seed", range(3))
def test_summed_log_odds_exceed_the_limit_where_slip_is_registered(fusion: str, seed: int) -> None:
    settings = msgspec.structs.replace(CUSUM, fusion=fusion)
    p, armed, masked, registered, event = watched(settings, seed)
    shown = decided(settings, p, armed, masked)
    above = (np.nan_to_num(shown) > settings.limit).any(axis=1)
    assert event.sum() > 5
    assert above[event].all()
    assert registered[above].all()


def test_a_rule_of_count_and_sum_says_both_conditions_and_the_end() -> None:
    rule = RuleSettings(kind="either", threshold=0.7, drift=-0.85, limit=20.0, quiet=0.3, release=5)
    assert in_words(rule) == (
        "slip is registered when a finger stays above 0.7 for 2 samples in a row, or the sum of "
        "the log-odds of a finger, +0.85 a sample, passes 20, and ends after 5 below 0.3"
    )
