"""Small plots: where lines, dots and ticks stand."""

import math

import pytest

from scenarios.report.charts import BOTTOM, LEFT, RIGHT, TOP, Rate, rates, shares


def heights(points: str) -> list[float]:
    return [float(point.split(",")[1]) for point in points.split()]


def test_what_never_came_keeps_its_line_below_all() -> None:
    plot = shares("late", "ms", [("half", [10.0, math.inf]), ("all", [5.0, 20.0])])
    assert plot is not None
    half, everything = (heights(line.points) for line in plot.lines)
    assert half[-1] == pytest.approx((TOP + BOTTOM) / 2)
    assert everything[-1] == TOP
    assert half[0] == everything[0] == BOTTOM


def test_of_what_nothing_came_of_there_is_no_plot() -> None:
    assert shares("late", "ms", [("none", [math.inf]), ("empty", [])]) is None
    plot = shares("late", "ms", [("none", [math.inf]), ("one", [1.0])])
    assert plot is not None and [line.name for line in plot.lines] == ["one"]


def test_a_line_of_thousands_stays_short_and_ends_where_it_must() -> None:
    plot = shares("late", "ms", [("many", [i * 0.01 for i in range(20_000)])])
    assert plot is not None
    (line,) = plot.lines
    assert len(line.points.split()) <= 2 * 202
    assert line.points.split()[-1] == f"{RIGHT},{TOP}"


@pytest.mark.parametrize("most", [1e-3, 0.7, 3.0, 95.0, 12_345.0])
def test_ticks_are_few_and_round(most: float) -> None:
    plot = shares("late", "ms", [("one", [0.5 * most, most])])
    assert plot is not None
    assert 3 <= len(plot.x_ticks) <= 8
    assert plot.x_ticks[0].at == LEFT and plot.x_ticks[-1].at <= RIGHT
    assert all(len(tick.text) <= 7 for tick in plot.x_ticks)


def test_a_rate_has_its_interval_and_its_words() -> None:
    plot = rates("mass", "kg", [("gru", [Rate(1.0, "1", 15, 20, (0.5, 0.9))])])
    (dot,) = plot.lines[0].dots
    assert dot.low > dot.y > dot.high
    assert dot.words == "gru, 1: 15 of 20"


def test_names_of_places_do_not_overlap() -> None:
    found = [Rate(x, f"{x:g}", 1, 2, (0.1, 0.9)) for x in (0.0, 0.9, 0.95, 2.0)]
    plot = rates("gain", "", [("gru", found)])
    assert [tick.text for tick in plot.x_ticks] == ["0", "0.9", "2"]
    assert len(plot.lines[0].dots) == 4
