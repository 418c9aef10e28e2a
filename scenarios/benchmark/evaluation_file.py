"""Files of evaluations, from `grasp detector evaluate --out FILE` to `grasp report FILE`."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from detector.decision import RuleSettings, registered_events
from detector.recordings import LabelName
from detector.scores.evaluation import Streamed, hand_probability, scoring_reference
from detector.scores.sweep import pareto_front
from drivers.errors import BadFile
from scenarios.benchmark.scoring import Contender, Scores

FORMAT: Literal["grasp-evaluation"] = "grasp-evaluation"
BEGINS = f'{{"format":"{FORMAT}"'  # first characters of every evaluation file
MAX_TRACES = 6  # per detector
BEFORE_S, AFTER_S = 0.5, 1.0  # range of a trace around the onset of slip


class RuleScores(msgspec.Struct, frozen=True):
    """Scores of one rule of the sweep; a delay of None: too many slips were missed."""

    false_per_min: float
    delay_ms: float | None
    p90_delay_ms: float | None
    p99_delay_ms: float | None = None  # not in older evaluation files


class ScoredSlip(msgspec.Struct, frozen=True):
    """A slip and its delay; ``delay_ms`` None: missed."""

    recording: str
    onset_s: float
    delay_ms: float | None
    kind: str  # of motion, or the cause
    speed_mps: float | None  # commanded speed, or maximum sliding speed of the contact
    slid_mm: float | None  # total distance


class SlipTrace(msgspec.Struct, frozen=True):
    """Samples around one slip, times in seconds from its onset."""

    slip: ScoredSlip
    t_s: list[float]
    pressed: list[list[float]]  # of each finger, sum of counts above its mean before the slip
    probabilities: list[float]
    slipping: list[tuple[float, float]]  # from, to

    def __post_init__(self) -> None:
        if {len(self.probabilities), *map(len, self.pressed)} != {len(self.t_s)}:
            raise ValueError("t_s, pressed and probabilities have different lengths")


class DetectorEvaluation(msgspec.Struct, frozen=True):
    """Evaluation of a detector with a rule; ``sheet`` is the output of `--json`."""

    detector: str
    rule: RuleSettings
    sheet: dict[str, Any]
    choices: list[RuleScores]  # Pareto-optimal rules, fewest false alarms first
    slips: list[ScoredSlip]
    worst: list[SlipTrace]


class EvaluationFile(msgspec.Struct, frozen=True, kw_only=True):
    """Content of an evaluation file."""

    format: Literal["grasp-evaluation"] = FORMAT
    version: Literal[1] = 1
    data: str
    label: LabelName
    command: str
    versions: dict[str, str]
    detectors: Annotated[list[DetectorEvaluation], msgspec.Meta(min_length=1)]


def read_evaluation(path: Path) -> EvaluationFile:
    """Read an evaluation file. Raises BadFile for any other file."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=EvaluationFile)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise no_evaluation(path, error) from None


def no_evaluation(path: Path, reason: Exception) -> BadFile:
    """The error for a file that is not an evaluation."""
    remedy = "make one: `grasp detector evaluate NAME --data DIR --out FILE.json`"
    return BadFile(path, f"is not an evaluation: {reason}", remedy)


def evaluated(contender: Contender, sheet: Scores) -> DetectorEvaluation:
    """File entry of a detector with its evaluation ``sheet``."""
    rule, streams = contender.config.rule, contender.streams
    slips = [(s, slip) for s in streams for slip in scored_slips(s, rule)]
    worst = sorted(slips, key=lambda each: _badness(each[1]), reverse=True)[:MAX_TRACES]
    return DetectorEvaluation(
        detector=contender.label,
        rule=rule,
        sheet=msgspec.json.decode(msgspec.json.encode(sheet)),
        choices=[
            RuleScores(p.false_per_min, *map(_known, (p.delay_ms, p.p90_delay_ms, p.p99_delay_ms)))
            for p in pareto_front(contender.points())
        ],
        slips=[slip for _, slip in slips],
        worst=[trace(s, slip, rule) for s, slip in worst],
    )


def scored_slips(streamed: Streamed, rule: RuleSettings) -> list[ScoredSlip]:
    """The slips of one recording that `evaluate_streams` counts."""
    recording = streamed.recording
    reference = scoring_reference(streamed)
    delays_ms = reference.score(registered_events(streamed.probabilities, rule)).events.delays_ms
    slips = reference.slips
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
