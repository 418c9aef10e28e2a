"""Detection latency: delay from the rise of a slip's label to its registration.

The paper counts samples until its network with its rule registers slip: 113 ms on average, 134 ms
with computing (Grover et al. 2022, section V-B).
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from detector.recordings import LabelName
from detector.scores.evaluation import (
    hand_rate,
    score_stream,
)
from detector.scores.quantiles import quantiles
from drivers.errors import UsageError
from grasp.cli.detector import check_named
from grasp.cli.parser import Parser
from scenarios.benchmark.scoring import contender, read_split
from scenarios.campaign.config import load_config
from studies.runner import Study, add_data, markdown

PAPER_MS = 113.0
BIN_MS, SHOWN_MS = 10.0, 400.0


class Task(msgspec.Struct, frozen=True):
    """A detector to be evaluated."""

    detector: str
    digest: str  # of its weights, settings and rule
    data: tuple[str, ...]
    label: LabelName


class Row(msgspec.Struct, frozen=True):
    """Delays of every slip in ms, infinite where missed."""

    detector: str
    label: LabelName
    delays_ms: list[float]
    false_per_min_hand: float
    accuracy: float


def add_options(parser: Parser) -> None:
    parser.add_argument("detector", nargs="*", default=["tcn-paper"], metavar="NAME|FILE.onnx",
                        help="(default: tcn-paper)")  # fmt: skip
    add_data(parser)
    parser.add_argument(
        "--label", choices=("slip", "slip_true"), default="slip",
        help="slip: the fingertip moves, as in the paper; slip_true: the contact itself slides",
    )  # fmt: skip


def grid(args: argparse.Namespace) -> list[Task]:
    check_named(args.detector)
    data = tuple(map(str, args.data))
    digests = [load_config("can", "simulated", name).detector_hash() for name in args.detector]
    return [Task(*each, data, args.label) for each in zip(args.detector, digests, strict=True)]


def trial(task: Task) -> Row:
    recordings = read_split([Path(f) for f in task.data], "test")
    made = contender(task.detector, recordings, "test", task.label)
    outcomes = [score_stream(s, made.config.rule).events for s in made.streams]
    delays = np.concatenate([o.delays_ms for o in outcomes])
    rate = hand_rate(made.streams, outcomes)
    if not len(delays) or rate is None:
        raise UsageError("the split test has no slip, or no rest", "give a set with both")
    return Row(made.label, task.label, delays.tolist(), rate, made.evaluation().accuracy)


def table(rows: Sequence[Row]) -> str:
    delays = [np.array(row.delays_ms) for row in rows]
    of_all = [quantiles(each) for each in delays]
    names = {"detector": [f"`{row.detector}`, {row.label}" for row in rows]}
    late = markdown(names | {
        "mean of detected, ms": [f"{mean_caught(each):.0f}" for each in delays],
        "p50, ms": [None if q is None else f"{q.p50:.0f}" for q in of_all],
        "p90, ms": [None if q is None else f"{q.p90:.0f}" for q in of_all],
        "p99, ms": [None if q is None else f"{q.p99:.0f}" for q in of_all],
        "missed": [f"{np.isinf(each).sum()} of {len(each)}" for each in delays],
    })  # fmt: skip
    at = markdown(names | {
        f"later than the paper's {PAPER_MS:.0f} ms, %":
            [f"{100 * (each > PAPER_MS).mean():.0f}" for each in delays],
        "false alarms a minute of a hand": [f"{row.false_per_min_hand:.1f}" for row in rows],
        "accuracy, %": [f"{100 * row.accuracy:.1f}" for row in rows],
    })  # fmt: skip
    return f"{late}\n\n{at}"


def mean_caught(delays_ms: Any) -> float:
    caught = delays_ms[np.isfinite(delays_ms)]
    return float(caught.mean()) if len(caught) else float("nan")


def chart(rows: Sequence[Row], figure: Any) -> None:
    """Histogram of delays, and cumulative share of slips registered."""
    histogram, share = figure.subplots(1, 2)
    edges = np.arange(-2 * BIN_MS, SHOWN_MS + BIN_MS, BIN_MS) - BIN_MS / 2
    for row in rows:
        delays = np.sort(row.delays_ms)
        histogram.hist(delays[np.isfinite(delays)], edges, histtype="step", label=row.detector)
        part = np.arange(1, len(delays) + 1) / len(delays)
        share.step(np.minimum(delays, SHOWN_MS), part, where="post", label=row.detector)
    histogram.set(ylabel="slips")
    share.set(ylabel="share of slips registered", ylim=(0.0, 1.02))
    for axes in (histogram, share):
        axes.axvline(PAPER_MS, color="black", lw=0.9, ls="--", label="paper's mean, real fingertip")
        axes.set(xlabel="delay from the label's rise, ms", xlim=(-2 * BIN_MS, SHOWN_MS))
    histogram.legend(fontsize=8, frameon=False)


STUDY = Study("detection latency beside the paper's 113 ms", grid, trial, Row, table, chart,
              add_options, (10.0, 3.8))  # fmt: skip
