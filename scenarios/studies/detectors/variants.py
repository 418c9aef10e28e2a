"""The paper's network in other windows, with other augmentation, without layer norm: each trained
anew on the same budget, then scored on the split `test` with the paper's rule.

All learn from as many samples a step: from the second half of stretches as long as the window, so
that what is learnt is what a window that is nearly full says. The authors learn from the last
sample alone, at a hundred times the cost.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import numpy as np

from detector.network_file import read_network
from detector.recordings import Recording
from detector.scores.evaluation import Evaluation
from detector.scores.intervals import Interval
from detector.scores.quantiles import Quantiles
from detector.training.architecture import WINDOW
from detector.training.augment import Augmentation
from detector.training.export import export
from detector.training.fit import Training
from detector.training.sequences import digest
from detector.training.settings import DEFAULTS, TrainSettings
from scenarios.benchmark.scoring import contender
from scenarios.trial.result import versions

NETWORK = "tcn-paper"
SAMPLES_PER_STEP = 3200  # of which half are learnt from


class Variant(msgspec.Struct, frozen=True):
    """What is other than in the paper's network as its authors ran it."""

    name: str
    window: int = WINDOW
    norm: bool = True
    augmentation: Augmentation = "as-run"


ABLATIONS = (
    Variant("as the authors ran it"),
    Variant("no layer norm", norm=False),
    Variant("augmentation: paper's text", augmentation="paper"),
    Variant("augmentation: ours", augmentation="ours"),
    Variant("augmentation: none", augmentation="none"),
)


def window_variants(windows: Sequence[int]) -> tuple[Variant, ...]:
    """One a window."""
    return tuple(Variant(f"window {window}", window) for window in windows)


class Trained(msgspec.Struct, frozen=True, kw_only=True):
    """One training of a variant, scored on the split `test`."""

    variant: Variant
    seed: int
    steps: int
    minutes: float  # of the processor
    accuracy: float
    accuracy_interval: Interval | None  # over recordings
    weighted_f1: float
    auc: float | None
    delay_ms: Quantiles | None  # from the label's rise; infinite where missed
    recall: float | None
    false_events_per_min: float | None
    compute_us: float | None  # median of one update


class Sets(msgspec.Struct, frozen=True, eq=False):
    """The splits that a study needs."""

    train: Sequence[Recording]
    validation: Sequence[Recording]
    test: Sequence[Recording]


def settings_of(variant: Variant, steps: int, seed: int) -> TrainSettings:
    """One validation, at the end: nothing is chosen by it."""
    half = variant.window // 2
    return msgspec.structs.replace(
        DEFAULTS[NETWORK], steps=steps, seed=seed, validations=1, window=variant.window,
        norm=variant.norm, augmentation=variant.augmentation, fresh=0.0,
        batch=SAMPLES_PER_STEP // variant.window, crop=variant.window - half, warm=half,
    )  # fmt: skip


def train(
    variant: Variant, steps: int, seed: int, sets: Sets, folder: Path,
    tell: Callable[[int, int], None],
) -> Trained:  # fmt: skip
    """Train, unless ``folder`` has the weights of the very same, and score."""
    name = "".join(c if c.isalnum() else "-" for c in variant.name)
    path = folder / f"{name}-{seed}.onnx"
    data = digest([*sets.train, *sets.validation])
    if not _is_of(path, data, steps, seed):
        training = Training(
            NETWORK, settings_of(variant, steps, seed), sets.train, sets.validation, data
        )
        training.run(float("inf"), None, lambda p: tell(p.step, p.steps))
        export(training, list(sets.validation), path, versions()["commit"])
    made = contender(NETWORK, sets.test, "test", assignments=(f"network.weights={path}",))
    card = read_network(path).card
    return _scored(variant, seed, card.steps, card.training_minutes, made.evaluation())


def _is_of(path: Path, data: str, steps: int, seed: int) -> bool:
    if not path.exists():
        return False
    card = read_network(path).card
    return (card.data_digest, card.steps, card.seed) == (data, steps, seed)


def _scored(variant: Variant, seed: int, steps: int, minutes: float, sheet: Evaluation) -> Trained:
    return Trained(
        variant=variant, seed=seed, steps=steps, minutes=minutes, accuracy=sheet.accuracy,
        accuracy_interval=sheet.intervals.get("accuracy"), weighted_f1=sheet.weighted_f1,
        auc=sheet.auc, delay_ms=sheet.delay_ms, recall=sheet.event_recall,
        false_events_per_min=sheet.false_events_per_min,
        compute_us=sheet.compute_us.p50 if sheet.compute_us else None,
    )  # fmt: skip


def table(rows: Sequence[Trained]) -> str:
    """Markdown, a row a training."""
    lines = [
        "| variant | seed | steps (processor min) | accuracy, % | weighted F1, % | AUC "
        "| delay, ms: 50 / 90 / 99 % | recall | false a minute | us an update |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        low, high = r.accuracy_interval or (np.nan, np.nan)
        lines.append(
            f"| {r.variant.name} | {r.seed} | {r.steps} ({r.minutes:.1f}) "
            f"| {100 * r.accuracy:.1f} [{100 * low:.1f}, {100 * high:.1f}] "
            f"| {100 * r.weighted_f1:.1f} | {_said(r.auc, 3)} | {_delay(r.delay_ms)} "
            f"| {_said(r.recall, 3)} | {_said(r.false_events_per_min, 1)} "
            f"| {_said(r.compute_us, 0)} |"
        )
    return "\n".join(lines)


def _said(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _delay(delay: Quantiles | None) -> str:
    return "–" if delay is None else f"{delay.p50:.0f} / {delay.p90:.0f} / {delay.p99:.0f}"
