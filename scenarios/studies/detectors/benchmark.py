"""Detectors compared on data sets: streamed once, then scored, tuned, tabled and charted."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import msgspec

from detector.interface import SlipDetector
from detector.recordings import LabelName, Recording, Split, read_dataset
from detector.scores.evaluation import (
    Evaluation,
    Streamed,
    evaluate_streams,
    stream_recordings,
)
from detector.scores.sweep import SweepPoint, best, rules, sweep
from grasp.clock import stopwatch_ns
from scenarios.campaign.config import load_config
from scenarios.trial.config import TrialConfig


class Contender(msgspec.Struct, frozen=True, eq=False):
    """A detector with its configuration, and what it said of the recordings."""

    config: TrialConfig
    detector: SlipDetector
    streams: list[Streamed]
    data: str

    def evaluation(self) -> Evaluation:
        """The sheet at the detector's own threshold and rule."""
        return evaluate_streams(self.detector, self.config.rule, self.streams, self.data)

    def points(self) -> list[SweepPoint]:
        """Every rule and threshold of the sweep."""
        return sweep(self.streams, rules(self.config.rule))


def read_split(folders: Sequence[Path], split: Split | Literal["all"]) -> list[Recording]:
    """Recordings of one split of several data sets; raises BadFile for an empty one."""
    wanted = None if split == "all" else split
    return [r for folder in folders for r in read_dataset(folder, wanted)]


def contender(
    name: str,
    recordings: Sequence[Recording],
    data: str,
    label: LabelName = "slip",
    file: Path | None = None,
    assignments: Sequence[str] = (),
) -> Contender:
    """Stream the named detector, as configured, over the recordings."""
    config = load_config("can", "simulated", name, file, assignments)
    streams = stream_recordings(config.make_detector, recordings, stopwatch_ns, label)
    return Contender(
        config, config.make_detector(recordings[0].fingers, recordings[0].taxels), streams, data
    )


def tune_rule(made: Contender, budget_per_min: float) -> SweepPoint | None:
    """The quickest rule within the budget of false events a minute over three fingers."""
    return best(made.points(), budget_per_min)
