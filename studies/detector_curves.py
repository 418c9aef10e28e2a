"""Delay against false alarms of every decision rule, and accuracy against the cost of an update.

Measure cost with `--jobs 1`: parallel workers slow each other down.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from detector.interface import DETECTORS
from detector.scores.sweep import pareto_front
from grasp.cli.detector import check_named
from grasp.cli.parser import Parser
from scenarios.benchmark.scoring import contender, read_split
from scenarios.campaign.config import load_config
from studies.runner import Study, add_data, markdown

PAPER_DELAY_MS, PAPER_ACCURACY, PAPER_COMPUTE_US = 134.0, 0.913, 21_000.0
PAPER_FALSE_PER_MIN = 100.0  # estimate: 7.6 % of static samples, three fingers, two in a row
HUMAN_MS, HUMAN_DEVIATION_MS = 74.0, 9.0  # Johansson and Westling 1987
SHOWN_MS = 300.0  # the chart shows later delays and misses above this, one line per detector
LINE_MS = 9.0
LEAST_PER_MIN = 0.1  # shown instead of zero on the logarithmic axis
BUDGET_PER_MIN = 1.0


class Task(msgspec.Struct, frozen=True):
    """A detector to be evaluated."""

    detector: str
    digest: str  # of its weights, settings and rule
    data: tuple[str, ...]


class Row(msgspec.Struct, frozen=True):
    """Result of a detector. ``points``: false alarms a minute of a hand, least median and 90 %
    delay, ms; infinite if missed."""

    detector: str
    accuracy: float
    compute_us: tuple[float, float]  # p50, p90 of one update of all fingers
    points: list[tuple[float, float, float]]


def add_options(parser: Parser) -> None:
    parser.add_argument("detector", nargs="*", default=DETECTORS, metavar="NAME|FILE.onnx",
                        help="(default: the packaged ones)")  # fmt: skip
    add_data(parser)


def grid(args: argparse.Namespace) -> list[Task]:
    check_named(args.detector)
    data = tuple(map(str, args.data))
    digests = [load_config("can", "simulated", name).detector_hash() for name in args.detector]
    return [Task(*each, data) for each in zip(args.detector, digests, strict=True)]


def trial(task: Task) -> Row:
    made = contender(task.detector, read_split([Path(f) for f in task.data], "test"), "test")
    sheet = made.evaluation()
    points = [(p.false_per_min, p.delay_ms, p.p90_delay_ms) for p in pareto_front(made.points())]
    cost = sheet.compute_us
    spent = (cost.p50, cost.p90) if cost else (float("nan"), float("nan"))
    return Row(made.label, sheet.accuracy, spent, points)


def table(rows: Sequence[Row]) -> str:
    within = [[p for p in row.points if p[0] <= BUDGET_PER_MIN] for row in rows]
    best = [points[-1] if points else (0.0, float("inf"), float("inf")) for points in within]
    return markdown({
        "detector": [f"`{row.detector}`" for row in rows],
        f"p50, ms, at {BUDGET_PER_MIN:g} false alarm a minute": [f"{p[1]:.0f}" for p in best],
        "p90, ms, by the same rule": [f"{p[2]:.0f}" for p in best],
        "accuracy, %": [f"{100 * row.accuracy:.1f}" for row in rows],
        "update p50, µs": [f"{row.compute_us[0]:.0f}" for row in rows],
        "p90, µs": [f"{row.compute_us[1]:.0f}" for row in rows],
    })  # fmt: skip


def chart(rows: Sequence[Row], figure: Any) -> None:
    speed, cost = figure.subplots(1, 2, width_ratios=(3, 2))
    for line, row in enumerate(rows):
        color = f"C{line}"
        rates = [max(rate, LEAST_PER_MIN) for rate, *_ in row.points]
        medians, p90s = ([shown_ms(p[i], line) for p in row.points] for i in (1, 2))
        speed.step(rates, medians, color=color, where="post", label=row.detector)
        speed.step(rates, p90s, color=color, where="post", lw=0.6, ls=":")
        cost.plot(row.compute_us[0], 100 * row.accuracy, "o", color=color, label=row.detector)
        cost.hlines(100 * row.accuracy, *row.compute_us, color=color, lw=1)
    top = shown_ms(float("inf"), len(rows))
    speed.axhspan(SHOWN_MS, top, color="#f2f2f2")
    speed.axhspan(HUMAN_MS - HUMAN_DEVIATION_MS, HUMAN_MS + HUMAN_DEVIATION_MS, color="#f0d9c0",
                  label="human grip reflex")  # fmt: skip
    speed.plot(PAPER_FALSE_PER_MIN, PAPER_DELAY_MS, "k*", ms=11, label="paper, real data")
    speed.set(xscale="log", xlim=(LEAST_PER_MIN, 300.0), ylim=(-10.0, top),
              xlabel="false alarms a minute of a hand",
              ylabel="delay from the label's rise, ms: median, and 90 % (dotted)")  # fmt: skip
    ticks = range(0, int(SHOWN_MS) + 1, 50)
    speed.set_yticks([*ticks, (SHOWN_MS + top) / 2], [*map(str, ticks), "missed,\nor later"])
    cost.plot(PAPER_COMPUTE_US, 100 * PAPER_ACCURACY, "k*", ms=11, label="paper, real data")
    cost.set(xscale="log", xlabel="one update, µs: median, and a line to 90 %",
             ylabel="accuracy of samples, %")  # fmt: skip
    for axes in (speed, cost):
        axes.legend(fontsize=8, frameon=False)


def shown_ms(delay_ms: float, line: int) -> float:
    """Height of a delay in the chart; delays beyond the axis get the line of their detector."""
    return delay_ms if delay_ms <= SHOWN_MS else SHOWN_MS + LINE_MS * (line + 1)


STUDY = Study("delay against false alarms, and accuracy against cost", grid, trial, Row, table,
              chart, add_options, (12.0, 5.5))  # fmt: skip
