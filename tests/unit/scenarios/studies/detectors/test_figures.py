"""The chart of detectors: what nine slips in ten are heard within, and what never came."""

import math

import pytest

from detector.decision import RuleSettings
from detector.scores.sweep import SweepPoint
from scenarios.studies.detectors.figures import (
    MOST_SHOWN_MS,
    ROW_MS,
    draw_delays,
    panels,
    shown_ms,
)


def point(rate: float, p50_ms: float, p90_ms: float) -> SweepPoint:
    return SweepPoint(RuleSettings(), rate, p50_ms, p90_ms, math.inf, 0.9, 100.0, None)


def test_what_never_came_has_a_row_of_its_detector_above_all_delays() -> None:
    assert shown_ms(MOST_SHOWN_MS, 3) == MOST_SHOWN_MS
    rows = [shown_ms(late_ms, row) for row in range(3) for late_ms in (301.0, math.inf)]
    assert rows == [MOST_SHOWN_MS + ROW_MS * k for k in (1, 1, 2, 2, 3, 3)]


def test_the_delay_of_nine_slips_in_ten_is_drawn_beside_the_median() -> None:
    pytest.importorskip("matplotlib")
    from matplotlib import pyplot as plt
    from matplotlib.collections import LineCollection

    figure, axes = panels(1, (4, 3))
    points = [point(1.0, 90.0, math.inf), point(2.0, 60.0, 200.0), point(4.0, 30.0, 80.0),
              point(8.0, 20.0, 40.0)]  # fmt: skip
    draw_delays(axes, "energy", points, "black", 1)
    lines = [
        segment.tolist()
        for drawn in axes.collections
        if isinstance(drawn, LineCollection)
        for segment in drawn.get_segments()
    ]
    missed = MOST_SHOWN_MS + 2 * ROW_MS
    level = [
        [[1.0, missed], [2.0, missed]],
        [[2.0, 200.0], [4.0, 200.0]],
        [[4.0, 80.0], [8.0, 80.0]],
    ]
    upright = [[[4.0, 80.0], [4.0, 200.0]], [[8.0, 40.0], [8.0, 80.0]]]
    assert lines == [*level, *upright]
    plt.close(figure)
