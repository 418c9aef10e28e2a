"""How late the paper's network with the paper's rule is on the paper's set: how much of it is
signal and how much training. The authors: 113 ms at an accuracy of 91.3 %. A yardstick: no
parameter of the fingertip is fitted to it.
"""

from collections.abc import Callable, Sequence
from typing import Literal, get_args

import msgspec
import numpy as np

from detector.decision import RuleSettings
from detector.recordings import Recording, Split
from detector.scores.evaluation import WARM_UP_SAMPLES, Streamed, judge_stream
from detector.scores.events import EventSettings
from detector.scores.quantiles import quantile
from detector.scores.sweep import MISS_MS
from detector.training.fit import Training
from detector.training.sequences import digest
from detector.training.settings import DEFAULTS, WINDOWS, TrainSettings
from detector.training.validation import odds_of
from drivers.errors import UsageError
from scenarios.benchmark.scoring import too_short

NETWORK = "tcn-paper"
RULE = RuleSettings(kind="consecutive", consecutive=2, threshold=0.5)  # the paper's
AUTHORS_MS, AUTHORS_ACCURACY = 113.0, 0.913  # Grover et al. 2022
Recipe = Literal["dense", "paper"]
RECIPES: tuple[Recipe, ...] = get_args(Recipe)


class Delay(msgspec.Struct, frozen=True, kw_only=True):
    """Of one training on the split `train`, on the split `test`. Delays from the label's rise on;
    a slip that was missed is later than any, and counts half a second in the mean."""

    data: str
    recipe: Recipe
    seed: int
    steps: int
    minutes: float  # of the processor
    accuracy: float
    median_ms: float
    mean_ms: float
    p90_ms: float
    p99_ms: float
    slips: int
    missed: int
    false_per_min: float


def settings_of(recipe: Recipe, steps: int, seed: int) -> TrainSettings:
    """dense: learns from every sample; paper: from the last of each window, as many of either
    class, as the authors did."""
    table = msgspec.structs.asdict(DEFAULTS[NETWORK]) | (WINDOWS if recipe == "paper" else {})
    return msgspec.convert(table | {"steps": steps, "seed": seed}, TrainSettings)


def measure(
    recordings: Sequence[Recording], data: str, recipe: Recipe, steps: int, seed: int,
    tell: Callable[[int, int], None] = lambda step, steps: None,
) -> Delay:  # fmt: skip
    """Train anew, then listen to the split `test`. Raises UsageError where a split is empty, or
    nothing of what is listened to could be scored."""
    train, validation, test = (_split(recordings, split) for split in get_args(Split))
    if all(len(r.t_s) <= WARM_UP_SAMPLES for r in test):
        raise UsageError(f"the split test: {too_short(len(test))}", "a larger share of a data set")
    settings = settings_of(recipe, steps, seed)
    training = Training(NETWORK, settings, train, validation, digest([*train, *validation]))
    training.run(float("inf"), None, lambda p: tell(p.step, p.steps))
    odds = odds_of(training.network, training.arch, test)
    return _judged(test, odds, data, recipe, training)


def _split(recordings: Sequence[Recording], split: str) -> list[Recording]:
    found = [r for r in recordings if r.metadata is not None and r.metadata.split == split]
    if not found:
        raise UsageError(f"no recording of the split {split}", "give a larger share of a data set")
    return found


def _judged(
    test: Sequence[Recording], odds: Sequence[np.ndarray], data: str, recipe: Recipe,
    training: Training,
) -> Delay:  # fmt: skip
    streams = [
        Streamed(r, 1.0 / (1.0 + np.exp(-z)), np.empty(0)) for r, z in zip(test, odds, strict=True)
    ]
    judged = [judge_stream(s, RULE, EventSettings(), WARM_UP_SAMPLES, ()).events for s in streams]
    delays = np.sort(np.concatenate([j.delays_ms for j in judged]))
    right = np.concatenate([
        ((s.probabilities.max(axis=1) > RULE.threshold) == s.labels)[WARM_UP_SAMPLES:]
        for s in streams
    ])  # fmt: skip
    return Delay(
        data=data, recipe=recipe, seed=training.settings.seed, steps=training.step,
        minutes=training.minutes, accuracy=float(right.mean()),
        median_ms=quantile(delays, 0.5), mean_ms=float(np.minimum(delays, MISS_MS).mean()),
        p90_ms=quantile(delays, 0.9), p99_ms=quantile(delays, 0.99), slips=len(delays),
        missed=sum(j.missed for j in judged),
        false_per_min=60.0 * sum(j.false for j in judged) / sum(j.static_s for j in judged),
    )  # fmt: skip


def table(rows: Sequence[Delay]) -> str:
    """Markdown, the authors' figure last."""
    lines = [
        "| data | recipe | seed | steps (processor min) | accuracy, % | delay, ms, p50 / p90 / p99 "
        "| mean, a miss 500 | missed | false a minute |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r.data} | {r.recipe} | {r.seed} | {r.steps} ({r.minutes:.1f}) "
        f"| {100 * r.accuracy:.1f} | {r.median_ms:.0f} / {r.p90_ms:.0f} / {r.p99_ms:.0f} "
        f"| {r.mean_ms:.0f} | {r.missed} of {r.slips} | {r.false_per_min:.1f} |"
        for r in rows
    ]
    authors = f"{100 * AUTHORS_ACCURACY:.1f} | | {AUTHORS_MS:.0f}"
    return "\n".join([*lines, f"| the authors' | paper | | | {authors} | | |"])
