"""Probes of the values at which settings of the decision rule take effect."""

from typing import Any

import numpy as np

from detector.decision import DecisionRule, RuleSettings


def registers(samples: list[tuple[float, ...]], **settings: Any) -> list[bool]:
    """Whether slip is registered after each sample of log-odds."""
    rule = DecisionRule(RuleSettings(**settings), len(samples[0]))
    registered = []
    for sample in samples:
        rule.update(1.0 / (1.0 + np.exp(-np.array(sample))))
        registered.append(rule.registered)
    return registered


def summed(log_odds: float, **settings: Any) -> bool:
    return registers([(log_odds,)], kind="cusum", **settings)[0]


def sure_samples(consecutive: int) -> int:
    return registers([(3.0,)] * 60, consecutive=consecutive).index(True) + 1


def quiet_samples(release: int) -> int:
    return registers([(3.0,)] * 2 + [(-3.0,)] * 100, release=release)[2:].index(False) + 1
