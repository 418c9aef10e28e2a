"""Evaluation of a detector on data sets, and tuning of its rule, from one pass of its output."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeVar

import msgspec
import numpy as np

from detector.decision import RuleSettings
from detector.interface import SlipDetector
from detector.network_file import is_weights
from detector.plugins import is_plugin_file
from detector.recordings import LabelName, Recording, Split
from detector.scores.evaluation import (
    WARM_UP_SAMPLES,
    Evaluation,
    Streamed,
    evaluate_streams,
    score_stream,
    scoring_reference,
    stream_recordings,
)
from detector.scores.sweep import SweepPoint, best, rules, sweep, thresholds_at_budget
from drivers.errors import UsageError
from grasp.run.clock import stopwatch_ns
from scenarios.acquire.datasets.build import Progress
from scenarios.benchmark.data_sets import read_set
from scenarios.campaign.config import load_config
from scenarios.rigs.calibration import Files
from scenarios.trial.config import TrialConfig

T = TypeVar("T")


def _with_progress(items: Sequence[T], progress: Progress) -> Iterator[T]:
    """The items; progress is reported after each."""
    for done, item in enumerate(items, 1):
        yield item
        progress(done, len(items))


class Contender(msgspec.Struct, frozen=True, eq=False):
    """A detector with its configuration, and its output on the recordings."""

    config: TrialConfig
    detector: SlipDetector
    streams: list[Streamed]
    data: str

    def evaluation(self) -> Evaluation:
        """Evaluation at the configured threshold and rule."""
        found = evaluate_streams(self.detector, self.config.rule, self.streams, self.data)
        return msgspec.structs.replace(found, detector=self.label)

    @property
    def label(self) -> str:
        """Unique name: the path for the user's files, whose inner names may be equal."""
        word = self.config.detector_name
        return word if is_plugin_file(word) or is_weights(word) else self.detector.name


def read_split(
    folders: Sequence[Path],
    split: Split | Literal["all"],
    report: Callable[[str], None] = lambda line: None,
) -> list[Recording]:
    """Recordings of one split of several data sets, without those too short to be scored.

    ``report`` gets a line for an incomplete set and for recordings left out. Raises BadFile for an
    empty set and for a folder of several sets, UsageError if all recordings are too short.
    """
    chosen = None if split == "all" else split
    recordings = [r for folder in folders for r in read_set(folder, chosen, report)]
    long = [r for r in recordings if len(r.t_s) > WARM_UP_SAMPLES]
    if recordings and not long:
        raise UsageError(
            f"the split {split}: {too_short(len(recordings))}",
            "give longer recordings, or more: a larger --share of `grasp dataset build`",
        )
    if len(long) < len(recordings):
        report(f"left out: {too_short(len(recordings) - len(long))}")
    return long


def too_short(recordings: int) -> str:
    return f"{recordings} recordings of at most {WARM_UP_SAMPLES} samples, too short to be scored"


def contender(
    name: str,
    recordings: Sequence[Recording],
    data: str,
    label: LabelName = "slip",
    files: Files = None,
    assignments: Sequence[str] = (),
    progress: Progress = lambda done, total: None,
) -> Contender:
    """Stream the recordings through the named detector with its settings."""
    config = load_config("can", "simulated", name, files, assignments)
    counted, first = _with_progress(recordings, progress), recordings[0]
    streams = stream_recordings(config.make_detector, counted, stopwatch_ns, label)
    return Contender(config, config.make_detector(first.fingers, first.taxels), streams, data)


def tune_rule(
    contender: Contender, budget_per_min: float, progress: Progress = lambda done, total: None
) -> SweepPoint | None:
    """Fastest rule within a budget of false alarms a minute of a hand; None without one."""
    candidates = _with_progress(list(rules(contender.config.rule)), progress)
    points = sweep(contender.streams, candidates)
    points += sweep(contender.streams, thresholds_at_budget(points, budget_per_min))
    return best(points, budget_per_min)


def minutes_at_rest(recordings: Sequence[Recording]) -> float:
    """Static time of a hand without impacts, minutes; one finger counts as a third of a hand."""
    none = np.empty(0)
    slips = [scoring_reference(Streamed(r, none, none), True).slips for r in recordings]
    return sum(each.static_s * each.hands for each in slips) / 60.0


class Evidence(msgspec.Struct, frozen=True):
    """Numbers of events that a rule was tuned on, without taps."""

    minutes: float  # static time of a hand
    slips: int
    caught: int
    false: int


def evidence(streams: Sequence[Streamed], rule: RuleSettings) -> Evidence:
    """Numbers of slips and false alarms of the rule on these streams."""
    outcomes = [score_stream(s, rule, exclude_impacts=True).events for s in streams]
    slips, missed = sum(len(o.delays_ms) for o in outcomes), sum(o.missed for o in outcomes)
    minutes = minutes_at_rest([s.recording for s in streams])
    return Evidence(minutes, slips, slips - missed, sum(o.false for o in outcomes))
