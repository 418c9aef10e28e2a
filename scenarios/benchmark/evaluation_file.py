"""The file of an evaluation: `grasp detector evaluate --out FILE` writes it, `grasp report FILE`
reads it."""

import math
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from detector.decision import RuleSettings, registered_events
from detector.recordings import LabelName
from detector.scores.evaluation import Streamed, scored, spoken
from detector.scores.sweep import frontier
from drivers.errors import BadFile
from scenarios.benchmark.scoring import Contender, Scores

FORMAT: Literal["grasp-evaluation"] = "grasp-evaluation"
BEGINS = f'{{"format":"{FORMAT}"'  # how our files are recognised
MOST_TRACES = 6  # of a detector
BEFORE_S, AFTER_S = 0.5, 1.0  # of a trace, around the begin of slip


class Choice(msgspec.Struct, frozen=True):
    """Scores of one rule of the sweep; a delay of None: that share of slips was missed."""

    false_per_min: float
    delay_ms: float | None
    p90_delay_ms: float | None
    p99_delay_ms: float | None = None  # older evaluations have none


class ScoredSlip(msgspec.Struct, frozen=True):
    """One slip and its delay; ``delay_ms`` None: missed."""

    recording: str
    onset_s: float
    delay_ms: float | None
    kind: str  # of motion, or what was done to what is held
    speed_mps: float | None  # as commanded, or the fastest that the contact slid
    slid_mm: float | None  # in all


class SlipTrace(msgspec.Struct, frozen=True):
    """Samples around one slip, times in seconds from its onset."""

    slip: ScoredSlip
    t_s: list[float]
    pressed: list[list[float]]  # of each finger, counts over its mean before slip began
    probabilities: list[float]
    slipping: list[tuple[float, float]]  # from, to


class Evaluated(msgspec.Struct, frozen=True):
    """One detector by one rule; ``sheet`` is what `--json` prints."""

    detector: str
    rule: RuleSettings
    sheet: dict[str, Any]
    choices: list[Choice]  # from few false events to many
    slips: list[ScoredSlip]
    worst: list[SlipTrace]


class EvaluationFile(msgspec.Struct, frozen=True, kw_only=True):
    """The file."""

    format: Literal["grasp-evaluation"] = FORMAT
    version: Literal[1] = 1
    data: str
    label: LabelName
    command: str
    versions: dict[str, str]
    detectors: list[Evaluated]


def read_evaluation(path: Path) -> EvaluationFile:
    """Raises BadFile for another file."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=EvaluationFile)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise no_evaluation(path, error) from None


def no_evaluation(path: Path, why: Exception) -> BadFile:
    """To be raised."""
    remedy = "make one: `grasp detector evaluate NAME --data DIR --out FILE.json`"
    return BadFile(path, f"is no evaluation: {why}", remedy)


def evaluated(made: Contender, sheet: Scores) -> Evaluated:
    """What the file keeps of a detector; ``sheet`` is its evaluation."""
    rule, streams = made.config.rule, made.streams
    found = [(s, slip) for s in streams for slip in scored_slips(s, rule)]
    worst = sorted(found, key=lambda each: _badness(each[1]), reverse=True)[:MOST_TRACES]
    return Evaluated(
        detector=made.label,
        rule=rule,
        sheet=msgspec.json.decode(msgspec.json.encode(sheet)),
        choices=[
            Choice(c.false_per_min, *map(_known, (c.delay_ms, c.p90_delay_ms, c.p99_delay_ms)))
            for c in frontier(made.points())
        ],
        slips=[slip for _, slip in found],
        worst=[trace(s, slip, rule) for s, slip in worst],
    )


def scored_slips(streamed: Streamed, rule: RuleSettings) -> list[ScoredSlip]:
    """Every slip of one recording that `evaluate_streams` counts."""
    recording = streamed.recording
    found = scored(streamed)
    delays_ms = found.judged(registered_events(streamed.probabilities, rule)).events.delays_ms
    slips = found.slips
    events = slips.truth[slips.counted[slips.truth[:, 0]]]
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
    """The samples around a slip of that recording."""
    recording = streamed.recording
    t_s = recording.t_s - slip.onset_s
    inside = (t_s >= -BEFORE_S) & (t_s <= AFTER_S)
    before = inside & (t_s < 0.0)
    # a slip at the first sample has nothing before it
    rest = recording.counts[before if before.any() else inside].mean(axis=0)
    pressed = (rest - recording.counts[inside]).sum(axis=2)  # pressing is negative
    labels = streamed.labels[inside]
    edges = np.flatnonzero(np.diff(labels, prepend=False, append=False)).reshape(-1, 2)
    times = t_s[inside]
    return SlipTrace(
        slip=slip,
        t_s=_rounded(times, 4),
        pressed=[_rounded(finger, 1) for finger in pressed.T],
        probabilities=_rounded(spoken(streamed, rule)[inside], 4),
        slipping=[
            (float(times[first]), float(times[min(after, len(times) - 1)]))
            for first, after in edges
        ],
    )


def _badness(slip: ScoredSlip) -> tuple[float, float]:
    """Largest for a miss, then by distance; below that by delay."""
    late_ms = math.inf if slip.delay_ms is None else slip.delay_ms
    return late_ms, slip.slid_mm or 0.0


def _kind(streamed: Streamed) -> str:
    about = streamed.recording.metadata
    return "" if about is None else about.cause or about.motion


def _speed_mps(streamed: Streamed, first: int, after: int) -> float | None:
    about, speed = streamed.recording.metadata, streamed.recording.contact_speed_mps
    if about is not None and about.speed_mps > 0.0:
        return about.speed_mps
    turns = about is not None and about.spin_radps > 0.0  # its speed is no one number
    return None if speed is None or turns else float(speed[first:after].max())


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _rounded(values: Any, digits: int) -> list[float]:
    out: list[float] = np.round(np.asarray(values, np.float64), digits).tolist()
    return out
