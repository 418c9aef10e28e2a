"""The paper's network with other windows, without layer norm and with other augmentation.

Each variant trains on the same number of samples; the paper's rule scores it on the split `test`.
A step uses the second half of stretches as long as the window. The paper uses only the last sample
of each window, which costs a hundred times more. Trainings run one after the other and ignore
`--jobs`. Needs the extra `train`.
"""

import argparse
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from detector.recordings import read_dataset
from detector.scores.quantiles import Quantiles
from detector.training.augment import Augmentation
from detector.training.settings import DEFAULTS, TrainSettings
from grasp.cli.options import need, whole
from grasp.cli.parser import Parser
from scenarios.benchmark.data_sets import require_whole
from scenarios.benchmark.scoring import contender, read_split
from scenarios.trial.result import versions
from studies.runner import Study, add_data, markdown

NETWORK = "tcn-paper"
SAMPLES_PER_STEP = 3200  # training uses half of them
# accuracy by window in the authors' training reports, 400 epochs
PAPER_WINDOWS = (10, 20, 30, 40, 50, 60, 70, 80, 90, 100)
PAPER_ACCURACY = (81.0, 82.4, 87.3, 87.6, 88.2, 89.6, 90.1, 90.2, 90.8, 90.8)


class Variant(msgspec.Struct, frozen=True):
    """The default is the paper's network as its authors ran it."""

    window: int = 100
    norm: bool = True
    augmentation: Augmentation = "as-run"


VARIANTS = {
    **{f"window-{window}": Variant(window) for window in (10, 30, 50, 70, 100)},
    "no-layer-norm": Variant(norm=False),
    "augmentation-paper": Variant(augmentation="paper"),
    "augmentation-ours": Variant(augmentation="ours"),
    "augmentation-none": Variant(augmentation="none"),
}


class Task(msgspec.Struct, frozen=True):
    """A training of one variant."""

    variant: str
    seed: int
    steps: int
    data: tuple[str, ...]
    weights: str


class Row(msgspec.Struct, frozen=True):
    """Scores of a training on the split `test`."""

    variant: str
    seed: int
    minutes: float  # of the processor
    accuracy: float
    accuracy_interval: tuple[float, float]
    delay_ms: Quantiles | None  # infinite where missed
    recall: float
    false_per_min: float
    compute_us: float  # median of one update


def add_options(parser: Parser) -> None:
    add_data(parser)
    parser.add_argument("--variants", nargs="+", choices=VARIANTS, default=[*VARIANTS],
                        help="(default: all)")  # fmt: skip
    parser.add_argument("--steps", type=whole(1, 10**7), default=1500, metavar="N",
                        help="of each training (default: %(default)s)")  # fmt: skip
    parser.add_argument("--seeds", type=whole(1, 100), default=2, metavar="N",
                        help="(default: %(default)s)")  # fmt: skip


def grid(args: argparse.Namespace) -> list[Task]:
    need("train", "torch", "onnx")
    require_whole(args.data)
    args.jobs = 0  # in this process: torch makes a worker so large that the leak check ends it
    data = tuple(map(str, args.data))
    return [
        Task(variant, seed, args.steps, data, str(args.out / f"{variant}-{seed}.onnx"))
        for seed, variant in itertools.product(range(args.seeds), args.variants)
    ]


def settings_of(variant: Variant, steps: int, seed: int) -> TrainSettings:
    """Training settings with one validation at the end, so that it selects nothing."""
    half = variant.window // 2
    return msgspec.structs.replace(
        DEFAULTS[NETWORK], steps=steps, seed=seed, validations=1, window=variant.window,
        norm=variant.norm, augmentation=variant.augmentation, fresh=0.0,
        batch=SAMPLES_PER_STEP // variant.window, crop=variant.window - half, warm=half,
    )  # fmt: skip


def trial(task: Task) -> Row:
    from detector.training.export import export
    from detector.training.fit import Training
    from detector.training.sequences import digest

    folders = [Path(f) for f in task.data]
    learnt, validation = (
        [r for folder in folders for r in read_dataset(folder, split)]
        for split in ("train", "validation")
    )
    settings = settings_of(VARIANTS[task.variant], task.steps, task.seed)
    training = Training(NETWORK, settings, learnt, validation, digest([*learnt, *validation]))
    training.run(float("inf"), None, lambda loss, score: None)
    export(training, validation, Path(task.weights), versions()["commit"])
    chosen = (f"network.weights={task.weights}",)
    sheet = contender(NETWORK, read_split(folders, "test"), "test", assignments=chosen).evaluation()
    nan = float("nan")
    return Row(
        task.variant, task.seed, training.minutes, sheet.accuracy,
        sheet.intervals.get("accuracy", (nan, nan)), sheet.delay_ms, sheet.event_recall or 0.0,
        nan if sheet.false_events_per_min is None else sheet.false_events_per_min,
        sheet.compute_us.p50 if sheet.compute_us else nan,
    )  # fmt: skip


def table(rows: Sequence[Row]) -> str:
    names: dict[str, Sequence[object]] = {
        "variant": [row.variant for row in rows], "seed": [row.seed for row in rows],
    }  # fmt: skip
    samples = markdown(names | {
        "processor min": [f"{row.minutes:.1f}" for row in rows],
        "accuracy, %": ["{:.1f} [{:.1f}, {:.1f}]".format(
            *(100 * x for x in (row.accuracy, *row.accuracy_interval))) for row in rows],
        "update, µs": [f"{row.compute_us:.0f}" for row in rows],
    })  # fmt: skip
    found = [row.delay_ms for row in rows]
    events = markdown(names | {
        "delay, ms: p50 / p90 / p99":
            [q and f"{q.p50:.0f} / {q.p90:.0f} / {q.p99:.0f}" for q in found],
        "recall": [f"{row.recall:.3f}" for row in rows],
        "false alarms a minute": [f"{row.false_per_min:.1f}" for row in rows],
    })  # fmt: skip
    return f"{samples}\n\n{events}"


def chart(rows: Sequence[Row], figure: Any) -> None:
    """Accuracy, delay and cost over the window: one point per training, lines through the means."""
    accuracy, delay, cost = figure.subplots(1, 3)
    swept = [row for row in rows if row.variant.startswith("window-")]
    windows = np.array([VARIANTS[row.variant].window for row in swept])
    nan = float("nan")
    medians = [row.delay_ms.p50 if row.delay_ms else nan for row in swept]
    p90s = [row.delay_ms.p90 if row.delay_ms else nan for row in swept]
    accuracy.plot(PAPER_WINDOWS, PAPER_ACCURACY, "k--", lw=0.8, label="authors, real fingertip")
    for axes, values, label, style in (
        (accuracy, [100 * row.accuracy for row in swept], "ours, simulated", "C0o-"),
        (delay, medians, "median", "C0o-"), (delay, p90s, "90 %", "C1^:"),
        (cost, [row.compute_us for row in swept], "median", "C0o-"),
    ):  # fmt: skip
        axes.plot(windows, values, style[:3], ms=4, alpha=0.6)
        each = np.unique(windows)
        means = [np.array(values)[windows == window].mean() for window in each]
        axes.plot(each, means, style[:2] + style[3:], lw=1, label=label)
        axes.set_xlabel("window, samples of 10 ms")
    accuracy.set(ylabel="accuracy of samples, %")
    delay.set(ylabel="delay with the paper's rule, ms")
    cost.set(ylabel="one update of a finger, µs", ylim=(0.0, None))
    accuracy.legend(fontsize=8, frameon=False)
    delay.legend(fontsize=8, frameon=False)


STUDY = Study("the paper's network: window, layer norm, augmentation (trains)", grid, trial, Row,
              table, chart, add_options, (12.0, 3.8))  # fmt: skip
