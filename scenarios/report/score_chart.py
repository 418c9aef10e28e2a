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
    SCORE_AXIS,
    SHOWN_MS,
    TITLE,
    by_threshold,
    lowest,
    places,
)

COLOURS, SHAPES = 6, "osD^v<>p"  # of the palette; of marks
SIZE_INCHES, DPI = (7.0, 4.4), 100.0


def draw_scores(file: ScoreFile, costs: dict[str, Cost], out: Path) -> None:
    """Draw the score over the delay. A filled mark with its interval is a detector's own rule, a
    hollow one its best threshold, its line has others; the legend, best first, has the cost of an
    update. Raises OSError."""
    plt, n = pyplot(), len(file.detectors)
    figure, axes = plt.subplots(figsize=SIZE_INCHES, layout="constrained")
    axes.axvspan(SHOWN_MS, END_MS, color=palette("grid"), lw=0)
    drawn: list[tuple[float, float]] = []
    if file.references:
        drawn = places(file.references.oracle, n, n)
        axes.plot(*zip(*drawn, strict=True), "--", color=palette("soft"), lw=1.2,
                  label="oracle: registers\nevery slip that late")  # fmt: skip
    axes.axhline(0.0, ls=":", color=palette("limit"), lw=1.2, label="never registers")
    bounds = [line for line in axes.lines if not line.get_label().startswith("_")]
    handles: list[tuple[float, Any]] = []
    for line, each in enumerate(file.detectors):
        points = places(by_threshold(each), line, n)
        drawn += points
        look: dict[str, Any] = {"color": palette(f"s{line % COLOURS}"), "lw": 1.2}
        axes.plot(*zip(*points, strict=True), "-", **look)
        cost = f", {costs[each.detector].update_us:.0f} µs" if each.detector in costs else ""
        for (x, y), p in zip(places(each.rows, line, n), each.rows, strict=True):
            f, own = p.score, p == each.point
            ends = [[abs(y - 100.0 * (y if end is None else end))] for end in (f.low, f.high)]
            mark = axes.errorbar(x, y, ends, label=f"{Path(each.detector).name}{cost}",
                                 fmt=SHAPES[line % len(SHAPES)], ms=6, capsize=3,
                                 mfc=look["color"] if own else "white", **look)  # fmt: skip
            if own:
                handles.append((y, mark))
    axes.set(xlim=(0.0, END_MS), ylim=(lowest(drawn), 101.0), xlabel=DELAY, ylabel=SCORE_AXIS)
    axes.set_title(f"{TITLE}\nfilled: own rule; hollow: best threshold; line: other thresholds",
                   fontsize=10)  # fmt: skip
    axes.grid(color=palette("grid"))
    axes.set_axisbelow(True)
    best_first = [mark for _, mark in sorted(handles, key=lambda each: -each[0])]
    figure.legend(handles=[*best_first, *bounds], loc="outside right upper", fontsize=9,
                  frameon=False, title="one update")  # fmt: skip
    save_figure(figure, out, DPI)
    plt.close(figure)
