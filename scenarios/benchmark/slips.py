"""Every slip of an evaluation, and the samples around the worst ones."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from detector.decision import RuleSettings, registered_events
from detector.scores.evaluation import Evaluation, Streamed, hand_probability, scoring_reference
from scenarios.benchmark.score_file import DetectorScores, ScoredSlip, SlipTrace
from scenarios.benchmark.scoring import Contender

MAX_TRACES = 6  # per detector
BEFORE_S, AFTER_S = 0.5, 1.0  # range of a trace around the onset of slip


def evaluated(contender: Contender, evaluation: Evaluation) -> DetectorScores:
    """Scores of a detector with its evaluation, for a file."""
    rule, streams = contender.config.rule, contender.streams
    slips = [(s, slip) for s in streams for slip in scored_slips(s, rule)]
    worst = sorted(slips, key=lambda each: _badness(each[1]), reverse=True)[:MAX_TRACES]
    return DetectorScores(
        detector=contender.label, detector_hash=contender.config.detector_hash(), rule=rule,
        figures=evaluation.figures, slips=[slip for _, slip in slips],
        worst=[trace(s, slip, rule) for s, slip in worst],
    )  # fmt: skip


def scored_slips(streamed: Streamed, rule: RuleSettings) -> list[ScoredSlip]:
    """The slips of one recording that `evaluate_streams` counts."""
    recording = streamed.recording
    reference = scoring_reference(streamed)
    delays_ms = reference.score(registered_events(streamed.probabilities, rule)).events.delays_ms
    slips = reference.slips
    events = slips.truth[slips.scored]
    last = len(recording.t_s) - 1
    return [
        ScoredSlip(
            recording="/".join(Path(recording.source).parts[-2:]),
            onset_s=float(recording.t_s[first]),
            delay_ms=_known(float(delay)),
            kind=_kind(streamed),
            speed_mps=_speed_mps(streamed, first, after),
            slid_mm=None if slips.path_mm is None
            else float(slips.path_mm[min(after, last)] - slips.path_mm[first]),
        )
        for (first, after), delay in zip(events, delays_ms, strict=True)
    ]  # fmt: skip


def trace(streamed: Streamed, slip: ScoredSlip, rule: RuleSettings) -> SlipTrace:
    """Samples around a slip of that recording."""
    recording = streamed.recording
    t_s = recording.t_s - slip.onset_s
    inside = (t_s >= -BEFORE_S) & (t_s <= AFTER_S)
    before = inside & (t_s < 0.0)
    # no sample precedes a slip at the first sample
    rest = recording.counts[before if before.any() else inside].mean(axis=0)
    pressed = (rest - recording.counts[inside]).sum(axis=2)  # pressing is negative
    labels = streamed.labels[inside]
    edges = np.flatnonzero(np.diff(labels, prepend=False, append=False)).reshape(-1, 2)
    times = t_s[inside]
    return SlipTrace(
        slip=slip,
        t_s=_rounded(times, 4),
        pressed=[_rounded(finger, 1) for finger in pressed.T],
        probabilities=_rounded(hand_probability(streamed, rule)[inside], 4),
        slipping=[
            (float(times[first]), float(times[min(after, len(times) - 1)]))
            for first, after in edges
        ],
    )


def _badness(slip: ScoredSlip) -> tuple[float, float]:
    """Sort key: largest for a miss, then by delay, then by distance."""
    late_ms = math.inf if slip.delay_ms is None else slip.delay_ms
    return late_ms, slip.slid_mm or 0.0


def _kind(streamed: Streamed) -> str:
    metadata = streamed.recording.metadata
    return "" if metadata is None else metadata.cause or metadata.motion


def _speed_mps(streamed: Streamed, first: int, after: int) -> float | None:
    metadata, speed = streamed.recording.metadata, streamed.recording.contact_speed_mps
    if metadata is not None and metadata.speed_mps > 0.0:
        return metadata.speed_mps
    turns = metadata is not None and metadata.spin_radps > 0.0  # no single speed
    return None if speed is None or turns else float(speed[first:after].max())


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _rounded(values: Any, digits: int) -> list[float]:
    out: list[float] = np.round(np.asarray(values, np.float64), digits).tolist()
    return out
