"""What one threshold hears of blows, and answers of those that move nothing."""

import numpy as np
import pytest

from detector.decision import RuleSettings
from scripts.last_draw import Struck
from scripts.tap_thresholds import Asked, Heard, ask, at_most_idle, table

RULE = RuleSettings(threshold=0.5, consecutive=2, fusion="any", release=3)


def blow(moved_mm: float, says: float, late_samples: int = 3) -> Heard:
    """Struck at 1 s; so sure from so many samples later on, for a tenth of a second."""
    t_s = np.arange(300) * 0.01
    p = np.full((300, 3), 0.01)
    p[100 + late_samples : 110 + late_samples] = says
    counts = np.zeros((300, 3, 6), np.int16)
    return Heard(Struck("can", moved_mm, 1.0, 1.0, 2.5, t_s, counts), p)


BLOWS = [blow(3.0, 0.9), blow(3.0, 0.6), blow(3.0, 0.9, 20), blow(0.1, 0.7), blow(0.1, 0.02),
         blow(1.0, 0.9)]  # fmt: skip


@pytest.mark.parametrize(
    ("threshold", "heard", "answered"), [(0.5, 2, 1), (0.65, 1, 1), (0.8, 1, 0), (0.95, 0, 0)]
)
def test_blows_count_as_heard_within_a_tenth_of_a_second_and_idle_ones_as_answered_at_all(
    threshold: float, heard: int, answered: int
) -> None:
    assert ask(BLOWS, RULE, threshold) == Asked(threshold, heard, 3, answered, 2)


def test_alarm_that_began_before_the_blow_is_no_answer_to_it() -> None:
    early = blow(3.0, 0.9, -20)
    assert ask([early, *BLOWS], RULE, 0.5).heard == 2


def test_share_at_one_idle_blow_in_twenty_lies_between_the_thresholds_about_it() -> None:
    asked = [Asked(0.5, 90, 100, 10, 100), Asked(0.7, 70, 100, 0, 100)]
    assert at_most_idle(asked) == pytest.approx(0.8)
    assert at_most_idle(asked[:1]) is None


def test_table_has_the_packaged_rule_and_the_share_at_the_aim_last() -> None:
    asked = [Asked(0.5, 90, 100, 10, 100), Asked(0.7, 70, 100, 0, 100)]
    *_, packaged, last = table({"tcn": asked}, {"tcn": asked[0]}).splitlines()
    assert "packaged, 0.500" in packaged
    assert last == "| at 5 % of the idle ones | 80 % | 5 % |"
