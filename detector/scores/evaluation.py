"""Evaluation of a detector and a decision rule on labelled recordings."""

from collections.abc import Callable, Iterable, Sequence
from functools import cache

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings, fused, registered_events
from detector.interface import SlipDetector
from detector.recordings import LabelName, Recording
from detector.scores.events import (
    EARLY_S,
    EventOutcomes,
    Events,
    Slips,
    event_figures,
    false_rate,
    score_events,
    slips_of,
)
from detector.scores.figures import Figure, figure, quantile_figures, samples_of
from detector.scores.impacts import Impact, ImpactScore, impact_delays, impact_score, impacts_of
from detector.scores.metrics import Confusion, Floats, Labels, calibration_error, confusion
from drivers.errors import BadFile

WARM_UP_SAMPLES = 100  # the paper's window: earlier samples are not scored
# The pad shears before the contact slides, and an object moves before its displacement reaches
# the label's bound: an event in this time before the label is early, not false.
PRE_SLIDING_S = 0.3
SLIDE = "slide"  # cause of recordings of the paper's kind, which have none


class Evaluation(msgspec.Struct, frozen=True):
    """Figures by name of a detector with a rule on recordings; see `evaluate_streams`."""

    detector: str
    data: str
    label: LabelName
    figures: dict[str, Figure]
    confusion: Confusion

    def __getitem__(self, name: str) -> float | None:
        """Value of a figure."""
        return self.figures[name].value


class Streamed(msgspec.Struct, frozen=True, eq=False):
    """A recording and a detector's output for each frame."""

    recording: Recording
    probabilities: Floats  # (n, fingers)
    spent_us: Floats  # (n,), or empty
    label: LabelName = "slip"

    @property
    def labels(self) -> Labels:
        """Chosen label (n,). Raises BadFile if the recording does not have it."""
        return self.recording.label(self.label)


def stream(
    detector: SlipDetector, counts: NDArray[np.int16], clock_ns: Callable[[], int] | None = None
) -> tuple[Floats, Floats]:
    """Reset the detector and stream frames (n, fingers, taxels): probabilities (n, fingers), and
    the time of each update (n,), microseconds, empty without a clock."""
    detector.reset()
    if clock_ns and len(counts):
        detector.update(counts[0])  # loads compiled code before the first timed update
        detector.reset()
    probabilities, spent_us = [], []
    for frame in counts:
        before = clock_ns() if clock_ns else 0
        probabilities.append(detector.update(frame))
        if clock_ns:
            spent_us.append((clock_ns() - before) * 1e-3)
    return np.array(probabilities), np.array(spent_us)


def stream_recordings(
    make: Callable[[int, int], SlipDetector],
    recordings: Iterable[Recording],
    clock_ns: Callable[[], int] | None = None,
    label: LabelName = "slip",
) -> list[Streamed]:
    """Stream every recording through a detector for its numbers of fingers and taxels."""
    made = cache(make)
    return [
        Streamed(r, *stream(made(r.fingers, r.taxels), r.counts, clock_ns), label)
        for r in recordings
    ]


class RecordingScore(msgspec.Struct, frozen=True, eq=False):
    """Outcomes of one recording by one rule: its slips, and its impacts (k,)."""

    events: EventOutcomes
    moved_m: Floats
    impact_delays_ms: Floats
    weak: Labels


class ScoringReference(msgspec.Struct, frozen=True, eq=False):
    """True slips and impacts (k,) of one recording, the reference for every rule."""

    slips: Slips
    impacts: list[Impact]
    moved_m: Floats
    weak: Labels

    def score(self, registered: Events) -> RecordingScore:
        """Score of the events (m, 2) that a rule registered."""
        delays_ms = impact_delays(registered, self.impacts, self.slips.t_s)
        events = score_events(registered, self.slips)
        return RecordingScore(events, self.moved_m, delays_ms, self.weak)


def scoring_reference(streamed: Streamed, exclude_impacts: bool = False) -> ScoringReference:
    """Reference of one recording. With ``exclude_impacts``, an event that starts in the time of an
    impact counts as its detection only, neither as a slip nor as false."""
    recording = streamed.recording
    speed, impacts = recording.contact_speed_mps, impacts_of(recording)
    in_impact = np.zeros(len(recording.t_s), np.bool_)
    for impact in impacts if exclude_impacts else ():
        in_impact[impact.start : impact.end] = True
    slips = slips_of(
        streamed.labels, recording.t_s, first_sample=WARM_UP_SAMPLES, excluded=in_impact,
        early_s=EARLY_S if streamed.label == "slip" else PRE_SLIDING_S,
        speed_mps=None if speed is None else speed.astype(np.float64), fingers=recording.fingers,
    )  # fmt: skip
    counted = [impact for impact in impacts if impact.start >= WARM_UP_SAMPLES]
    moved_m, weak = [impact.moved_m for impact in counted], [impact.weak for impact in counted]
    return ScoringReference(slips, counted, np.array(moved_m, np.float64), np.array(weak, np.bool_))


def score_stream(s: Streamed, rule: RuleSettings, exclude_impacts: bool = False) -> RecordingScore:
    """Score of a rule on one recording; ``exclude_impacts`` as in `scoring_reference`."""
    return scoring_reference(s, exclude_impacts).score(registered_events(s.probabilities, rule))


# attributes of Confusion that are figures
OF_SAMPLES = ("balanced_accuracy", "weighted_precision", "weighted_f1", "slip_f1")


def evaluate_streams(
    detector: SlipDetector, rule: RuleSettings, streams: Sequence[Streamed], data: str
) -> Evaluation:
    """Evaluate streamed recordings, each after its first `WARM_UP_SAMPLES`.

    All fingers of a recording have one label, so a sample has one probability
    (`hand_probability`). The threshold of samples is the detector's, that of events the rule's.
    Raises BadFile for a recording with too few samples.
    """
    for recording in (s.recording for s in streams):
        if len(recording.t_s) <= WARM_UP_SAMPLES:
            remedy = f"more than {WARM_UP_SAMPLES} are needed: only those after them are scored"
            raise BadFile(recording.source, f"has {len(recording.t_s)} samples", remedy)
    scores = [score_stream(s, rule) for s in streams]
    outcomes = [each.events for each in scores]
    samples = samples_of([scored_samples(s, rule) for s in streams])
    cells = confusion(samples.p > detector.threshold, samples.labels)
    impacts = score_impacts(scores)
    figures = {
        "recordings": Figure(len(streams)),
        "samples": Figure(cells.n),
        "threshold": Figure(detector.threshold),
        "auc": samples.auc(),
        "accuracy": samples.accuracy(detector.threshold),
        **{name: Figure(getattr(cells, name)) for name in OF_SAMPLES},
        "ece": Figure(calibration_error(samples.p, samples.labels)),
        **event_figures(outcomes),
        **_by_cause(streams, outcomes),
        **quantile_figures("update", "us", np.concatenate([s.spent_us for s in streams])),
        **({} if impacts is None else impacts.figures()),
    }
    return Evaluation(detector.name, data, streams[0].label, figures, cells)


def scored_samples(streamed: Streamed, rule: RuleSettings) -> tuple[Floats, Labels]:
    """Probabilities and labels of the samples that count."""
    after = slice(WARM_UP_SAMPLES, None)
    return hand_probability(streamed, rule)[after], streamed.labels[after]


def hand_probability(streamed: Streamed, rule: RuleSettings) -> Floats:
    """Probability (n,) of a hand: by the rule's fusion, the maximum or the mean log-odds."""
    highest: Floats = fused(streamed.probabilities, rule).max(axis=1)
    return highest


def evaluate_recording(
    detector: SlipDetector,
    rule: RuleSettings,
    recording: Recording,
    clock_ns: Callable[[], int] | None = None,
) -> Evaluation:
    """Stream one recording through the detector and evaluate it; see `evaluate_streams`."""
    streamed = Streamed(recording, *stream(detector, recording.counts, clock_ns))
    return evaluate_streams(detector, rule, [streamed], recording.source)


def score_impacts(scores: Sequence[RecordingScore]) -> ImpactScore | None:
    """Score of the impacts of several recordings."""
    columns = zip(*((s.moved_m, s.impact_delays_ms, s.weak) for s in scores), strict=True)
    return impact_score(*(np.concatenate(column) for column in columns))


def cause_of(recording: Recording) -> str:
    """Cause in the metadata of a recording; `slide` for the paper's kind."""
    return (recording.metadata.cause if recording.metadata else "") or SLIDE


def _by_cause(streams: Sequence[Streamed], outcomes: Sequence[EventOutcomes]) -> dict[str, Figure]:
    of_cause: dict[str, list[EventOutcomes]] = {}
    for s, o in zip(streams, outcomes, strict=True):
        of_cause.setdefault(cause_of(s.recording), []).append(o)
    return {f"false_per_min, {cause}": figure(false_rate, of_cause[cause])
            for cause in sorted(of_cause)}  # fmt: skip
