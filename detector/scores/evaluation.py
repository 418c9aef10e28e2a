"""One sheet of figures for a detector and a decision rule on labelled recordings.

How sure a figure is: 95 % bootstrap intervals over what is independent. Samples of one stroke are
not: of a data set whole recordings are drawn, of a single recording whole strokes and pauses.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cache

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings, mean_probability, registered_events
from detector.interface import SlipDetector
from detector.recordings import LabelName, Recording
from detector.scores.events import (
    EARLY_S,
    EventMetrics,
    Events,
    Judgement,
    Slips,
    judge,
    pooled,
    slips_of,
)
from detector.scores.impacts import Impact, ImpactScore, answers, impact_score, impacts_of
from detector.scores.metrics import (
    Confusion,
    Floats,
    Labels,
    Ranking,
    auc,
    calibration_error,
    confusion,
)
from detector.scores.quantiles import Quantiles, quantile, quantiles
from drivers.errors import BadFile

WARM_UP_SAMPLES = 100  # the paper's window: what comes earlier no detector has to know
HAND_FINGERS = 3
# the pad shears before the contact slides, and what has moved began to before it had gone far
# enough for the label: detecting that is early, not false
PRE_SLIDING_S = 0.3
Interval = tuple[float, float]
LOW, HIGH = 0.025, 0.975
RESAMPLES_OF_A_SET, RESAMPLES_OF_A_RECORDING = 300, 1000
SLIDE = "slide"  # false events on recordings of the paper's kind, beside the causes of the others


class Evaluation(EventMetrics, frozen=True, kw_only=True):
    """Figures of events, of samples and of cost; None where undefined."""

    detector: str
    data: str
    label: str
    n_samples: int
    accuracy: float
    weighted_precision: float
    weighted_f1: float
    slip_f1: float
    balanced_accuracy: float | None
    auc: float | None
    false_events_per_min_by_cause: dict[str, float]
    false_events_per_min_hand: float | None  # as if every recording had three fingers
    ece: float
    compute_us: Quantiles | None  # one update of all fingers; needs a clock
    intervals: dict[str, Interval]  # 95 %, over recordings, or over strokes and pauses of one
    threshold: float  # on the probability, of `accuracy` and its kin
    impacts: ImpactScore | None
    confusion: Confusion
    recordings: int


class Streamed(msgspec.Struct, frozen=True, eq=False):
    """A recording and what a detector said of it, frame by frame."""

    recording: Recording
    probabilities: Floats  # (n, fingers)
    spent_us: Floats  # (n,), or none
    label: LabelName = "slip"

    @property
    def labels(self) -> Labels:
        """(n,) by the chosen label; raises BadFile where the recording lacks it."""
        return self.recording.label(self.label)


def stream(
    detector: SlipDetector, counts: NDArray[np.int16], clock_ns: Callable[[], int] | None = None
) -> tuple[Floats, Floats]:
    """Reset, then feed frames (n, fingers, 6) one by one: probabilities (n, fingers), and
    microseconds of each update (n,), none without a clock."""
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
    """Stream every recording through the detector made for its fingers and their taxels."""
    made = cache(make)
    return [
        Streamed(r, *stream(made(r.fingers, r.taxels), r.counts, clock_ns), label)
        for r in recordings
    ]


class Judged(msgspec.Struct, frozen=True, eq=False):
    """What became of one recording's slips, and of its impacts (see `scores.impacts`)."""

    events: Judgement
    moved_m: Floats
    answers_ms: Floats
    weak: Labels


class Scored(msgspec.Struct, frozen=True, eq=False):
    """What any rule is judged by on one recording; the arrays are of its impacts."""

    slips: Slips
    impacts: list[Impact]
    moved_m: Floats
    weak: Labels

    def judged(self, registered: Events) -> Judged:
        """By the events (m, 2) that a rule makes."""
        delays_ms = answers(registered, self.impacts, self.slips.t_s)
        return Judged(judge(registered, self.slips), self.moved_m, delays_ms, self.weak)


def scored(streamed: Streamed, apart: bool = False) -> Scored:
    """``apart``: what begins in an impact is judged as its answer alone, neither as a slip nor as
    false."""
    recording = streamed.recording
    speed, impacts = recording.contact_speed_mps, impacts_of(recording)
    in_impact = np.zeros(len(recording.t_s), np.bool_)
    for impact in impacts if apart else ():
        in_impact[impact.struck : impact.until] = True
    slips = slips_of(
        streamed.labels, recording.t_s, first_sample=WARM_UP_SAMPLES, left_out=in_impact,
        early_s=EARLY_S if streamed.label == "slip" else PRE_SLIDING_S,
        speed_mps=None if speed is None else speed.astype(np.float64),
    )  # fmt: skip
    counted = [impact for impact in impacts if impact.struck >= WARM_UP_SAMPLES]
    moved_m, weak = [impact.moved_m for impact in counted], [impact.weak for impact in counted]
    return Scored(slips, counted, np.array(moved_m, np.float64), np.array(weak, np.bool_))


def judge_stream(streamed: Streamed, rule: RuleSettings, apart: bool = False) -> Judged:
    """What became of one recording by a rule; ``apart`` as in `scored`."""
    return scored(streamed, apart).judged(registered_events(streamed.probabilities, rule))


# as both a confusion and an evaluation call them
OF_SAMPLES = ("accuracy", "weighted_precision", "weighted_f1", "slip_f1", "balanced_accuracy")


def evaluate_streams(
    detector: SlipDetector, rule: RuleSettings, streams: Sequence[Streamed], data: str
) -> Evaluation:
    """Score what was streamed, each recording after its first `WARM_UP_SAMPLES`.

    A recording has one label for all fingers, so one probability stands for a sample (`spoken`).
    Samples are judged at the detector's own threshold, events at the rule's. Raises BadFile for a
    recording of which nothing is left to score.
    """
    for recording in (s.recording for s in streams):
        if len(recording.t_s) <= WARM_UP_SAMPLES:
            remedy = f"more than {WARM_UP_SAMPLES} are needed: only those after them are scored"
            raise BadFile(recording.source, f"has {len(recording.t_s)} samples", remedy)
    every = [judge_stream(s, rule) for s in streams]
    judged = [each.events for each in every]
    parts = [(spoken(s, rule)[WARM_UP_SAMPLES:], s.labels[WARM_UP_SAMPLES:]) for s in streams]
    p, labels = (np.concatenate(column) for column in zip(*parts, strict=True))
    cells = confusion(p > detector.threshold, labels)
    if len(streams) == 1:
        intervals = stroke_intervals(p, labels, detector.threshold)
    else:
        intervals = recording_intervals(parts, judged, detector.threshold)
    return Evaluation(
        **msgspec.structs.asdict(pooled(judged)),
        detector=detector.name,
        data=data,
        label=streams[0].label,
        n_samples=cells.n,
        **{name: getattr(cells, name) for name in OF_SAMPLES},
        auc=auc(p, labels),
        false_events_per_min_by_cause=_by_cause(streams, judged),
        false_events_per_min_hand=hand_rate(streams, judged),
        ece=calibration_error(p, labels),
        compute_us=quantiles(np.concatenate([s.spent_us for s in streams])),
        intervals=intervals,
        threshold=detector.threshold,
        impacts=score_impacts(every),
        confusion=cells,
        recordings=len(streams),
    )


def spoken(streamed: Streamed, rule: RuleSettings) -> Floats:
    """The probability (n,) of a hand: the surest finger's, or of the mean log-odds by the rule."""
    p = streamed.probabilities
    one: Floats = mean_probability(p)[:, 0] if rule.fusion == "mean" else p.max(axis=1)
    return one


def evaluate_recording(
    detector: SlipDetector,
    rule: RuleSettings,
    recording: Recording,
    clock_ns: Callable[[], int] | None = None,
) -> Evaluation:
    """Stream one recording through detector and rule and score it; see `evaluate_streams`."""
    streamed = Streamed(recording, *stream(detector, recording.counts, clock_ns))
    return evaluate_streams(detector, rule, [streamed], recording.source)


def score_impacts(judged: Sequence[Judged]) -> ImpactScore | None:
    """Of several recordings as of one."""
    columns = zip(*((j.moved_m, j.answers_ms, j.weak) for j in judged), strict=True)
    return impact_score(*(np.concatenate(column) for column in columns))


def cause_of(recording: Recording) -> str:
    """What shook the signal of a recording, `slide` for the paper's kind."""
    return (recording.metadata.cause if recording.metadata else "") or SLIDE


def hand_rate(streams: Sequence[Streamed], judged: Sequence[Judgement]) -> float | None:
    """False events a minute of three fingers; a finger alone has a third of a hand's minutes."""
    hand_s = sum(
        j.static_s * s.recording.fingers / HAND_FINGERS
        for s, j in zip(streams, judged, strict=True)
    )
    return sum(j.false for j in judged) / hand_s * 60.0 if hand_s > 0.0 else None


def _by_cause(streams: Sequence[Streamed], judged: Sequence[Judgement]) -> dict[str, float]:
    of_cause: dict[str, list[Judgement]] = {}
    for s, j in zip(streams, judged, strict=True):
        of_cause.setdefault(cause_of(s.recording), []).append(j)
    rates = {cause: pooled(each).false_events_per_min for cause, each in sorted(of_cause.items())}
    return {cause: rate for cause, rate in rates.items() if rate is not None}


def stroke_intervals(
    probabilities: Floats, labels: Labels, threshold: float, seed: int = 0
) -> dict[str, Interval]:
    """AUC and accuracy of one recording; nothing with fewer than two strokes or two pauses."""
    block = np.concatenate([[0], np.cumsum(labels[1:] != labels[:-1])])
    is_slip = labels[np.unique(block, return_index=True)[1]]
    strokes, pauses = np.flatnonzero(is_slip), np.flatnonzero(~is_slip)
    if min(len(strokes), len(pauses)) < 2:
        return {}
    rng = np.random.default_rng(seed)
    drawn = [
        np.concatenate([rng.choice(kind, len(kind)) for kind in (strokes, pauses)])
        for _ in range(RESAMPLES_OF_A_RECORDING)
    ]
    return _of_samples(probabilities, labels, threshold, block, drawn)


def recording_intervals(
    parts: Sequence[tuple[Floats, Labels]], judged: Sequence[Judgement], threshold: float
) -> dict[str, Interval]:
    """AUC, accuracy, recall, false events a minute and median delay of several recordings."""
    rng = np.random.default_rng(0)
    drawn = [rng.integers(0, len(parts), len(parts)) for _ in range(RESAMPLES_OF_A_SET)]
    block = np.repeat(np.arange(len(parts)), [len(labels) for _, labels in parts])
    p, labels = (np.concatenate(column) for column in zip(*parts, strict=True))
    found = _of_samples(p, labels, threshold, block, drawn)
    false, missed, slips, static_s = (
        np.array([f(j) for j in judged], np.float64)
        for f in (
            lambda j: j.false, lambda j: j.missed, lambda j: len(j.delays_ms), lambda j: j.static_s,
        )
    )  # fmt: skip
    if static_s.all():
        rates = [60.0 * false[d].sum() / static_s[d].sum() for d in drawn]
        found["false_events_per_min"] = _interval(rates)
    if slips.all():
        found["event_recall"] = _interval([1 - missed[d].sum() / slips[d].sum() for d in drawn])
    if slips.any():
        delays = [np.concatenate([judged[i].delays_ms for i in d]) for d in drawn]
        found["delay_ms_p50"] = _interval([quantile(np.sort(d), 0.5) for d in delays if len(d)])
    return found


def _of_samples(
    probabilities: Floats,
    labels: Labels,
    threshold: float,
    block: NDArray[np.intp],
    drawn: Sequence[NDArray[np.intp]],
) -> dict[str, Interval]:
    """AUC and accuracy with each sample as heavy as its block was drawn often."""
    blocks = int(block[-1]) + 1
    right = np.bincount(block, (probabilities > threshold) == labels)
    size = np.bincount(block)
    ranking = Ranking(probabilities, labels)
    accuracies, areas = [], []
    for d in drawn:
        times = np.bincount(d, minlength=blocks).astype(np.float64)
        accuracies.append(float((right * times).sum() / (size * times).sum()))
        area = ranking.auc(times[block])
        if area is not None:
            areas.append(area)
    found = {"accuracy": _interval(accuracies)}
    return found | ({"auc": _interval(areas)} if areas else {})


def _interval(values: Sequence[float]) -> Interval:
    ordered = sorted(values)
    return quantile(ordered, LOW), quantile(ordered, HIGH)
