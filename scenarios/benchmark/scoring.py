"""Detectors compared on data sets: streamed once, then scored, tuned, tabled and charted."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeVar

import msgspec
import numpy as np

from detector.blows import blows_of
from detector.decision import RuleSettings, registered_events
from detector.interface import SlipDetector
from detector.network_file import is_weights, read_network
from detector.own import is_code
from detector.recordings import LabelName, Recording, Split
from detector.scores.evaluation import (
    HAND_FINGERS,
    WARM_UP_SAMPLES,
    Evaluation,
    Streamed,
    evaluate_streams,
    events_by_label,
    scored,
    spoken,
    stream_recordings,
)
from detector.scores.metrics import best_border
from detector.scores.sweep import SweepPoint, at_the_budget, best, rules, sweep
from drivers.errors import UsageError
from grasp.clock import stopwatch_ns
from grasp.settings import names
from scenarios.benchmark.data_sets import read_set
from scenarios.campaign.config import load_config
from scenarios.rigs.own_settings import Files
from scenarios.trial.config import FORMULAS, TrialConfig


class SweptThreshold(msgspec.Struct, frozen=True):
    """What makes the mean recall of both classes greatest, of a detector of one number."""

    section: str
    setting: str
    value: float
    balanced_accuracy: float
    samples: int

    @property
    def assignment(self) -> str:
        """For `--set`."""
        return f"{self.section}.{self.setting}={self.value:g}"


T = TypeVar("T")
Tell = Callable[[int, int], None]  # how much is done, of how much


def silent(done: int, total: int) -> None:
    """Nobody is told."""


def told(items: Sequence[T], tell: Tell) -> Iterator[T]:
    """The items, each told before the next is asked for."""
    for done, item in enumerate(items, 1):
        yield item
        tell(done, len(items))


class Scores(Evaluation, frozen=True):
    """An evaluation, and of what it is: weights or formula, and rule, as results carry it."""

    detector_hash: str  # see `TrialConfig.detector_hash`


class Contender(msgspec.Struct, frozen=True, eq=False):
    """A detector with its configuration, and what it said of the recordings."""

    config: TrialConfig
    detector: SlipDetector
    streams: list[Streamed]
    data: str

    def evaluation(self) -> Scores:
        """The sheet at the detector's own threshold and rule."""
        sheet = evaluate_streams(self.detector, self.config.rule, self.streams, self.data)
        named = {**msgspec.structs.asdict(sheet), "detector": self.label}
        return Scores(**named, detector_hash=self.config.detector_hash())

    @property
    def label(self) -> str:
        """What it is called beside others: two files may call theirs the same."""
        word = self.config.detector_name
        return word if is_code(word) or is_weights(word) else self.detector.name

    def points(self, tell: Tell = silent) -> list[SweepPoint]:
        """Every rule and threshold of the sweep."""
        return sweep(self.streams, told(list(rules(self.config.rule)), tell))


def read_split(
    folders: Sequence[Path],
    split: Split | Literal["all"],
    tell: Callable[[str], None] = lambda line: None,
) -> list[Recording]:
    """Recordings of one split of several data sets. A set of which some is not there is told, and
    those are left out and told that are too short for anything of them to be scored.

    Raises BadFile for an empty one and for a folder of several, UsageError where all are too short.
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
    tell: Tell = silent,
) -> Contender:
    """Stream the named detector, as configured, over the recordings."""
    config = load_config("can", "simulated", name, files, assignments)
    heard = told(recordings, tell)
    streams = stream_recordings(config.make_detector, heard, stopwatch_ns, label)
    return Contender(
        config, config.make_detector(recordings[0].fingers, recordings[0].taxels), streams, data
    )


def named(
    name: str, recordings: Sequence[Recording], data: str, swept_on: Sequence[Path] = (),
    tell: Tell = silent,
) -> Contender:  # fmt: skip
    """A contender by name, or by the file of its weights; the threshold of a detector of one number
    swept on the split `train` of some folders, where they are given."""
    if is_weights(name) and (card := read_network(Path(name)).card).name in names("detectors"):
        chosen = (f"network.weights={name}",)
        return contender(card.name, recordings, data, assignments=chosen, tell=tell)
    if name not in FORMULAS or not swept_on:
        return contender(name, recordings, data, tell=tell)
    swept = sweep_threshold(contender(name, read_split(swept_on, "train"), "train", tell=tell))
    return contender(name, recordings, data, assignments=(swept.assignment,), tell=tell)


def tune_rule(made: Contender, budget_per_min: float, tell: Tell = silent) -> SweepPoint | None:
    """The quickest rule within the budget of false events a minute over three fingers."""
    points = made.points(tell)
    points += sweep(made.streams, at_the_budget(points, budget_per_min))
    return best(points, budget_per_min)


class StandsOn(msgspec.Struct, frozen=True):
    """What ``tune_rule`` judged a rule by, blows left out."""

    minutes: float  # of a hand's rest
    slips: int
    caught: int
    false: int


def stands_on(streams: Sequence[Streamed], rule: RuleSettings) -> StandsOn:
    """Of some of the streams that the rule was tuned on."""
    judged = [
        scored(s, events_by_label(s.label), WARM_UP_SAMPLES, blows_of(s.recording), apart=True)
        .judged(registered_events(s.probabilities, rule))
        .events
        for s in streams
    ]
    rest = zip(streams, judged, strict=True)
    hand_s = sum(j.static_s * s.recording.fingers / HAND_FINGERS for s, j in rest)
    slips, missed = sum(len(j.delays_ms) for j in judged), sum(j.missed for j in judged)
    return StandsOn(hand_s / 60.0, slips, slips - missed, sum(j.false for j in judged))


def require_formula(name: str) -> None:
    """Raises UsageError for a detector of more than one number."""
    if name not in FORMULAS:
        raise UsageError(f"{name} has no threshold of its own", f"one of: {', '.join(FORMULAS)}")


def threshold_of(config: TrialConfig) -> tuple[str, float]:
    """The setting of a detector of one number that reads as slip, as `--set` names it, and its
    value."""
    section = config.detector_section
    settings = getattr(config, section)
    (name,) = (f for f in settings.__struct_fields__ if f.startswith("threshold"))
    return f"{section}.{name}", float(getattr(settings, name))


def sweep_threshold(made: Contender) -> SweptThreshold:
    """The threshold with which a detector of one number has the best balanced accuracy on what was
    streamed: unbalanced, one that hears nothing is best told to say the commoner class.

    Its probability is logistic in the log of that number, so one stream tells all thresholds.
    Raises UsageError for a network.
    """
    require_formula(made.config.detector_name)
    setting, threshold = threshold_of(made.config)
    section, _, name = setting.partition(".")
    settings = getattr(made.config, section)
    p = np.concatenate([spoken(s, made.config.rule)[WARM_UP_SAMPLES:] for s in made.streams])
    labels = np.concatenate([s.labels[WARM_UP_SAMPLES:] for s in made.streams])
    border = best_border(p, labels)
    odds = border / (1.0 - border)
    value = threshold * odds ** (1.0 / settings.steepness)
    said = p > border
    balanced = float(said[labels].mean() + (~said[~labels]).mean()) / 2.0
    return SweptThreshold(section, name, float(value), balanced, len(labels))
