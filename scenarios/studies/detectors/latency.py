"""Latency as the paper defines it: how many more samples it takes, once slip has begun, until the
network with the paper's rule registers it. Theirs on average: 11.3, which is 113 ms.
"""

import msgspec
import numpy as np

from detector.recordings import LabelName
from detector.scores.evaluation import (
    WARM_UP_SAMPLES,
    events_by_label,
    hand_rate,
    judge_stream,
)
from detector.scores.quantiles import Quantiles, quantiles
from drivers.errors import UsageError
from scenarios.benchmark.scoring import Contender

AUTHORS_MS = 113.0  # Grover et al. 2022, section V-B; 134 ms with 21 ms of computing


class Latency(msgspec.Struct, frozen=True, kw_only=True):
    """Delays of one detector and rule, from the label's rise on."""

    detector: str
    detector_hash: str  # see `TrialConfig.detector_hash`
    label: LabelName
    rule: str
    delays_ms: list[float | None]  # of every slip; None: missed
    mean_ms: float  # of those caught, as the authors' is
    of_all: Quantiles  # a miss is later than any
    missed: int
    later_than_authors: float  # share of all slips, the missed among them
    false_per_min_hand: float | None
    accuracy: float


def latency(made: Contender) -> Latency:
    """Of the slips in what was streamed, by the detector's own rule; raises UsageError of none."""
    rule, label = made.config.rule, made.streams[0].label
    judged = [
        judge_stream(s, rule, events_by_label(label), WARM_UP_SAMPLES, ()).events
        for s in made.streams
    ]
    delays = np.concatenate([j.delays_ms for j in judged])
    of_all = quantiles(delays)
    if of_all is None:
        raise UsageError("no slip in these recordings", "a data set of the paper's kind")
    caught = delays[np.isfinite(delays)]
    return Latency(
        detector=made.detector.name, detector_hash=made.config.detector_hash(), label=label,
        rule=f"{rule.consecutive} in a row above {rule.threshold:g}"
        if rule.kind == "consecutive" else rule.kind,
        delays_ms=[float(d) if np.isfinite(d) else None for d in delays],
        mean_ms=float(caught.mean()) if len(caught) else float("nan"),
        of_all=of_all, missed=len(delays) - len(caught),
        later_than_authors=float((delays > AUTHORS_MS).mean()),
        false_per_min_hand=hand_rate(made.streams, judged),
        accuracy=made.evaluation().accuracy,
    )  # fmt: skip
