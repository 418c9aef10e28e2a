"""Where a setting of the decision rule takes effect."""

from typing import Any

import numpy as np

from detector.decision import RuleSettings, make_rule


def registers(samples: list[tuple[float, ...]], **settings: Any) -> list[bool]:
    """What the rule says after each sample, of log-odds."""
    rule = make_rule(RuleSettings(**settings), len(samples[0]))
    said = []
    for sample in samples:
        rule.update(1.0 / (1.0 + np.exp(-np.array(sample))))
        said.append(rule.registered)
    return said


def summed(log_odds: float, **settings: Any) -> bool:
    return registers([(log_odds,)], kind="cusum", **settings)[0]


def sure_samples(consecutive: int) -> int:
    return registers([(3.0,)] * 60, consecutive=consecutive).index(True) + 1


def quiet_samples(release: int) -> int:
    return registers([(3.0,)] * 2 + [(-3.0,)] * 100, release=release)[2:].index(False) + 1


def fingers_that_agree(fingers: int) -> int:
    sure = [(3.0,) * n + (-3.0,) * (3 - n) for n in (1, 2, 3)]
    said = [registers([sample], consecutive=1, fingers=fingers)[0] for sample in sure]
    return said.index(True) + 1
