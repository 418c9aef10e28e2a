"""Which tuned rule one without labels is measured against."""

from detector.decision import RuleSettings
from detector.scores.sweep import SweepPoint
from scripts.unlabelled_rule import tuned


def rule_of(false_per_min: float, mean_delay_ms: float) -> SweepPoint:
    return SweepPoint(RuleSettings(), false_per_min, 0.0, 0.0, 0.0, 1.0, mean_delay_ms, None)


QUIET, QUICK, RESTLESS = rule_of(0.2, 300.0), rule_of(0.9, 180.0), rule_of(3.0, 90.0)


def test_it_is_the_quickest_with_no_more_false_events() -> None:
    assert tuned([QUIET, QUICK, RESTLESS], 1.0) is QUICK
    assert tuned([QUIET, QUICK, RESTLESS], 3.0) is RESTLESS


def test_it_is_the_quietest_where_all_have_more() -> None:
    assert tuned([RESTLESS, QUICK, QUIET], 0.1) is QUIET
