"""The speed-accuracy chart of the detectors. Needs the extra `charts`."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from detector.scores.evaluation import Evaluation
from detector.scores.sweep import SweepPoint, frontier
from grasp.files import save_figure, write_whole

PAPER_DELAY_MS = 134.0
PAPER_FALSE_PER_MIN = 100.0  # 7.6 % of static samples, three fingers, two in a row, independent
HUMAN_MS, HUMAN_DEVIATION_MS = 74.0, 9.0  # Johansson and Westling 1987
PAPER_ACCURACY, PAPER_COMPUTE_US = 0.913, 21_000.0
MOST_SHOWN_MS = 300.0
ROW_MS = 9.0  # of those above that: one a detector, for what comes later or never
LEAST_SHOWN_PER_MIN = 0.1  # fewer are drawn there: zero has no place on a logarithmic axis
COLOURS = ("#1f5f99", "#c2571a", "#3a7d44", "#7a4fa3", "#b00020", "#777777", "#a8862b", "#21a0a0")

T = TypeVar("T")


class DetectorCurve(msgspec.Struct, frozen=True):
    """One detector: its sheet and its frontier."""

    sheet: Evaluation
    points: list[SweepPoint]


def curve(sheet: Evaluation, points: Sequence[SweepPoint]) -> DetectorCurve:
    """The sheet with the best of the points."""
    return DetectorCurve(sheet, frontier(points))


def in_colour(every: Iterable[T]) -> Iterator[tuple[T, str]]:
    """Each with its colour, which come again where there are more of them: none is left out."""
    return zip(every, cycle(COLOURS), strict=False)


def draw_detectors(curves: Mapping[str, DetectorCurve], out: Path) -> None:
    """False events against delay, accuracy against compute, into ``out``; numbers beside it."""
    figure, (speed, cost) = panels(2, (12, 5.5), (3, 2))
    for row, ((name, c), colour) in enumerate(in_colour(curves.items())):
        draw_delays(speed, name, c.points, colour, row)
        if c.sheet.compute_us is not None:
            spent, accuracy = c.sheet.compute_us, 100 * c.sheet.accuracy
            cost.plot(spent.p50, accuracy, "o", color=colour, label=name)
            cost.hlines(accuracy, spent.p50, spent.p90, color=colour, lw=1)
    _frame_speed(speed, len(curves))
    _frame_cost(cost)
    cost.legend(fontsize=8, frameon=False)  # names beside dots that lie together would overlap
    data = ", ".join(dict.fromkeys(c.sheet.data for c in curves.values()))
    figure.suptitle(f"How soon, how often wrongly, at what cost: {data}", fontsize=11)
    save(figure, out)
    text = msgspec.json.format(msgspec.json.encode(curves), indent=1)
    write_whole(out.with_suffix(".json"), text + b"\n")


def shown_ms(delay_ms: float, row: int) -> float:
    """Where a delay is drawn: what is later than the axis, or never came, above it in the row of
    its detector, so that none hides another's."""
    return delay_ms if delay_ms <= MOST_SHOWN_MS else MOST_SHOWN_MS + ROW_MS * (row + 1)


def draw_delays(axes: Any, name: str, points: Sequence[SweepPoint], colour: str, row: int) -> None:
    """The median thick, what nine slips in ten are heard within thin, by the same rules."""
    x = [max(p.false_per_min, LEAST_SHOWN_PER_MIN) for p in points]
    p90 = [shown_ms(p.p90_delay_ms, row) for p in points]
    seen = any(p.delay_ms <= MOST_SHOWN_MS for p in points)
    label = name if seen else f"{name} (later than {MOST_SHOWN_MS:g} ms)"
    axes.step(x, [shown_ms(p.delay_ms, row) for p in points], color=colour, label=label,
              where="post")  # fmt: skip
    axes.hlines(p90[:-1], x[:-1], x[1:], color=colour, lw=0.9, ls=(0, (3, 1)))
    # none to and from the rows above: the rules go to and fro there, and nothing else could be seen
    for at, (before, after) in zip(x[1:], itertools.pairwise(p90), strict=True):
        if max(before, after) <= MOST_SHOWN_MS:
            axes.vlines(at, *sorted((before, after)), color=colour, lw=0.4)


def _frame_speed(axes: Any, detectors: int) -> None:
    axes.axhline(PAPER_DELAY_MS, color="black", lw=0.8, ls="--")
    axes.plot(PAPER_FALSE_PER_MIN, PAPER_DELAY_MS, "*", color="black", ms=11)
    star = "paper, real data: 134 ms\n(false events reckoned)"
    axes.annotate(star, (PAPER_FALSE_PER_MIN, PAPER_DELAY_MS),
                  xytext=(-4, 6), textcoords="offset points", fontsize=8, ha="right")  # fmt: skip
    axes.axhspan(HUMAN_MS - HUMAN_DEVIATION_MS, HUMAN_MS + HUMAN_DEVIATION_MS, color="#f0d9c0")
    axes.annotate("human grip reflex, 74 ± 9 ms", (LEAST_SHOWN_PER_MIN, HUMAN_MS),
                  xytext=(4, -3), textcoords="offset points", fontsize=8)  # fmt: skip
    axes.set(
        xscale="log", xlabel="false events a minute, three fingers (left edge: 0.1 or fewer)",
        ylabel="delay from the rise of the label, ms: median, and 90 % (thin)",
    )  # fmt: skip
    axes.set_xlim(LEAST_SHOWN_PER_MIN, 300.0)
    axes.set_ylim(-10.0, shown_ms(math.inf, detectors))
    axes.axhspan(MOST_SHOWN_MS, shown_ms(math.inf, detectors), color="#f2f2f2")
    ticks = range(0, int(MOST_SHOWN_MS) + 1, 50)
    middle = (MOST_SHOWN_MS + shown_ms(math.inf, detectors)) / 2
    axes.set_yticks([*ticks, middle], [*map(str, ticks), "missed,\nor later"])
    # above the plot: inside it there is no place that no line needs
    axes.legend(fontsize=8, frameon=False, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))


def _frame_cost(axes: Any) -> None:
    axes.axhline(100 * PAPER_ACCURACY, color="black", lw=0.8, ls="--")
    axes.plot(PAPER_COMPUTE_US, 100 * PAPER_ACCURACY, "*", color="black", ms=11)
    axes.annotate("paper, real data: 91.3 %, 21 ms", (PAPER_COMPUTE_US, 100 * PAPER_ACCURACY),
                  xytext=(-4, 6), textcoords="offset points", fontsize=8, ha="right")  # fmt: skip
    axes.set(
        xscale="log", xlabel="one update, µs: median, and a line to 90 %",
        ylabel="accuracy a sample, %",
    )  # fmt: skip


def panels(
    columns: int, size: tuple[float, float], widths: tuple[float, ...] | None = None
) -> tuple[Any, Any]:
    """A figure of so many panels side by side, inches; equal content gives equal files."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"
    return plt.subplots(1, columns, figsize=size, width_ratios=widths, layout="constrained")


def save(figure: Any, out: Path) -> None:
    """Write and close it."""
    from matplotlib import pyplot as plt

    save_figure(figure, out, dpi=120)
    plt.close(figure)
