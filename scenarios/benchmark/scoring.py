"""Streams a detector over data sets once, then scores it and tunes its rule."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeVar

import msgspec

from detector.decision import RuleSettings
from detector.interface import SlipDetector
from detector.network_file import is_weights
from detector.plugins import is_code
from detector.recordings import LabelName, Recording, Split
from detector.scores.evaluation import (
    HAND_FINGERS,
    WARM_UP_SAMPLES,
    Evaluation,
    Streamed,
    evaluate_streams,
    judge_stream,
    stream_recordings,
)
from detector.scores.sweep import SweepPoint, at_the_budget, best, rules, sweep
from drivers.errors import UsageError
from grasp.clock import stopwatch_ns
from scenarios.benchmark.data_sets import read_set
from scenarios.campaign.config import load_config
from scenarios.rigs.calibration import Files
from scenarios.trial.config import TrialConfig

T = TypeVar("T")
Tell = Callable[[int, int], None]  # progress: done, total


def _reported(items: Sequence[T], tell: Tell) -> Iterator[T]:
    """The items; progress is reported after each."""
    for done, item in enumerate(items, 1):
        yield item
        tell(done, len(items))


class Scores(Evaluation, frozen=True):
    """An evaluation with the digest of weights or formula and rule, as in results."""

    detector_hash: str  # see `TrialConfig.detector_hash`


class Contender(msgspec.Struct, frozen=True, eq=False):
    """A detector with its configuration, and its output on the recordings."""

    config: TrialConfig
    detector: SlipDetector
    streams: list[Streamed]
    data: str

    def evaluation(self) -> Scores:
        """Scores at the detector's own threshold and rule."""
        sheet = evaluate_streams(self.detector, self.config.rule, self.streams, self.data)
        named = {**msgspec.structs.asdict(sheet), "detector": self.label}
        return Scores(**named, detector_hash=self.config.detector_hash())

    @property
    def label(self) -> str:
        """Name among others: that of the file for one's own, since names inside may be equal."""
        word = self.config.detector_name
        return word if is_code(word) or is_weights(word) else self.detector.name

    def points(self, tell: Tell = lambda done, total: None) -> list[SweepPoint]:
        """Every rule and threshold of the sweep."""
        return sweep(self.streams, _reported(list(rules(self.config.rule)), tell))


def read_split(
    folders: Sequence[Path],
    split: Split | Literal["all"],
    tell: Callable[[str], None] = lambda line: None,
) -> list[Recording]:
    """Recordings of one split of several data sets, without those too short to be scored.

    ``tell`` takes a line for an incomplete set and for what was left out. Raises BadFile for an
    empty set and for a folder of several, UsageError where all recordings are too short.
    """
    wanted = None if split == "all" else split
    found = [r for folder in folders for r in read_set(folder, wanted, tell)]
    long = [r for r in found if len(r.t_s) > WARM_UP_SAMPLES]
    if found and not long:
        raise UsageError(
            f"the split {split}: {too_short(len(found))}",
            "longer recordings, or more of them: a larger --share of `grasp dataset build`",
        )
    if len(long) < len(found):
        tell(f"left out: {too_short(len(found) - len(long))}")
    return long


def too_short(recordings: int) -> str:
    return f"{recordings} recordings of at most {WARM_UP_SAMPLES} samples, of which none is scored"


def contender(
    name: str,
    recordings: Sequence[Recording],
    data: str,
    label: LabelName = "slip",
    files: Files = None,
    assignments: Sequence[str] = (),
    tell: Tell = lambda done, total: None,
) -> Contender:
    """Stream the named detector with its settings over the recordings."""
    config = load_config("can", "simulated", name, files, assignments)
    counted, first = _reported(recordings, tell), recordings[0]
    streams = stream_recordings(config.make_detector, counted, stopwatch_ns, label)
    return Contender(config, config.make_detector(first.fingers, first.taxels), streams, data)


def tune_rule(
    made: Contender, budget_per_min: float, tell: Tell = lambda done, total: None
) -> SweepPoint | None:
    """The quickest rule within a budget of false events a minute of a hand; None if none is."""
    points = made.points(tell)
    points += sweep(made.streams, at_the_budget(points, budget_per_min))
    return best(points, budget_per_min)


class Evidence(msgspec.Struct, frozen=True):
    """Events that a rule was tuned on, without taps."""

    minutes: float  # of a hand's rest
    slips: int
    caught: int
    false: int


def evidence(streams: Sequence[Streamed], rule: RuleSettings) -> Evidence:
    """What some of the streams say of the rule."""
    judged = [judge_stream(s, rule, apart=True).events for s in streams]
    rest = zip(streams, judged, strict=True)
    hand_s = sum(j.static_s * s.recording.fingers / HAND_FINGERS for s, j in rest)
    slips, missed = sum(len(j.delays_ms) for j in judged), sum(j.missed for j in judged)
    return Evidence(hand_s / 60.0, slips, slips - missed, sum(j.false for j in judged))
