"""The chart of a benchmark: needs the extra `exports`."""

from pathlib import Path
from typing import Any

from grasp.files import save_figure
from scenarios.benchmark.score_file import Cost, ScoreFile
from scenarios.report.export import pyplot
from scenarios.report.page import palette
from scenarios.report.score_page import (
    DELAY,
    END_MS,
    RIGHT_AXIS,
    SHOWN_MS,
    by_threshold,
    lowest,
    places,
)

COLOURS = 6  # of the palette
SIZE_INCHES, DPI = (7.0, 4.0), 100.0
TICKS_MS = 50


def draw_scores(file: ScoreFile, costs: dict[str, Cost], out: Path) -> None:
    """Draw the share done right over the delay. A dot with its interval is a detector's rule, its
    line has other thresholds; the legend, best first, has the cost of an update. Raises OSError."""
    plt, n = pyplot(), len(file.detectors)
    figure, axes = plt.subplots(figsize=SIZE_INCHES, layout="constrained")
    axes.axvspan(SHOWN_MS, END_MS, color=palette("grid"), lw=0)
    drawn = places(file.oracle, n, n)
    axes.plot(*_columns(drawn), "--", color=palette("soft"), lw=1.2,
              label="oracle: every slip\nis reported that late")  # fmt: skip
    dots: list[tuple[float, Any]] = []
    for line, each in enumerate(file.detectors):
        points = places(by_threshold(each), line, n)
        drawn += points
        look: dict[str, Any] = {"color": palette(f"s{line % COLOURS}"), "lw": 1.2}
        axes.plot(*_columns(points), "-" if line < COLOURS else ":", **look)
        cost = f", {costs[each.detector].update_us:.0f} µs" if each.detector in costs else ""
        for (x, y), p in zip(places(each.own, line, n), each.own, strict=False):
            right = p.right
            ends = [abs(100.0 * (y if end is None else end) - y) for end in (right.low, right.high)]
            look |= {"fmt": "o" if line < COLOURS else "s", "ms": 6, "capsize": 3}
            error = [[ends[0]], [ends[1]]]
            dot = axes.errorbar(x, y, error, label=f"{Path(each.detector).name}{cost}", **look)
            dots.append((y, dot))
    ticks = range(0, int(SHOWN_MS) + 1, TICKS_MS)
    axes.set(xlim=(0.0, END_MS), ylim=(lowest(drawn), 101.0), xlabel=DELAY, ylabel=RIGHT_AXIS)
    axes.set_xticks(ticks)
    axes.grid(color=palette("grid"))
    axes.set_axisbelow(True)
    best_first = [dot for _, dot in sorted(dots, key=lambda each: -each[0])]
    figure.legend(handles=[*best_first, *axes.lines[:1]], loc="outside right upper", fontsize=9,
                  frameon=False, title="one update")  # fmt: skip
    save_figure(figure, out, DPI)
    plt.close(figure)


def _columns(points: list[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [y for _, y in points]
