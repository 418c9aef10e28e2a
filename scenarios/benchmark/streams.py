"""The benchmark's recordings: detection of slip, slip that lasts, taps, and false alarms.

Every recording is streamed once through a detector that gets the counts alone; all thresholds are
then scored from its output. An interval is over recordings, each of which has its own object, hand
and texture.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings, registered_events
from detector.recordings import Recording, read
from detector.scores.evaluation import (
    HAND_FINGERS,
    WARM_UP_SAMPLES,
    Streamed,
    cause_of,
    hand_probability,
    stream,
    stroke_intervals,
)
from detector.scores.events import MERGE_GAP_S, true_events
from detector.scores.impacts import FAR_M, SOON_MS, UNMOVED_M, Impact, impact_delays, impacts_of
from detector.scores.metrics import Confusion, Ranking, auc, confusion
from detector.scores.quantiles import quantile
from drivers.errors import UsageError
from drivers.interfaces import PERIOD_S
from scenarios.acquire.datasets.build import build
from scenarios.acquire.datasets.causes import LEAST_SLIP_M
from scenarios.benchmark.lifts import SMOOTH_M
from scenarios.benchmark.protocol import Protocol, SplitName
from scenarios.rigs.workers import Workers, results
from scenarios.trial.config import TrialConfig

Floats = NDArray[np.float64]
Labels = NDArray[np.bool_]
T = TypeVar("T")
# forces that the hand or arm changes by itself, and other causes without slip
ACTUATION = (
    "force_steps", "contact_made_and_broken", "arm_vibration", "grasped_closing_and_tightening",
    "grasped_lift_acceleration", "grasped_set_down", "grasped_arm_vibration",
)  # fmt: skip
SLIDES = ("paper", "sliding")  # sets with slip of known onset
LASTING_S, LOOKED_S = 0.2, 2.0  # after onset: where the status is looked at
FAST_MPS = 0.01  # slides slower than that are not counted as lasting slip
SPEEDS_MPS = {
    "10-20 mm/s": (FAST_MPS, 0.02), "20-50 mm/s": (0.02, 0.05), "above 50 mm/s": (0.05, math.inf),
}  # fmt: skip
AGAIN_S = 1.0  # from the first motion of a tap until the status is nominal, or the next disturbance
EARLY, LATE = 30, 10  # samples around true sliding in which an event is no false alarm
RESAMPLES = 300
NO_RESULT_S = 300.0  # of all workers; the longest recording or lift takes a tenth of it


class Alarms(msgspec.Struct, frozen=True):
    """Events of one recording that begin although nothing slides, and its time without slip."""

    false: int
    hand_s: float  # of a hand; one finger counts as a third of a hand
    on_s: float  # of that, with slip registered


class Figure(msgspec.Struct, frozen=True):
    """A value with its 95 % interval; None where undefined, infinite where more was missed."""

    value: float | None
    low: float | None = None
    high: float | None = None


class Tap(msgspec.Struct, frozen=True):
    """One tap by one rule. ``delay_ms``: of those that moved the object by 2 mm; else None."""

    recording: int
    smooth: bool
    moved: bool
    right: bool
    delay_ms: float | None


class StreamScores(msgspec.Struct, frozen=True):
    """Scores of a detector with its rule on the recordings of a split."""

    auc: Figure
    balanced_accuracy: Figure
    recall: Figure
    delay_p50_ms: Figure
    delay_p90_ms: Figure
    false_per_min: Figure
    false_per_min_actuation: Figure
    lingering: Figure  # share of the time without slip in which it is registered
    sustained: Figure  # share of lasting slip, 10 mm/s and faster, that is reported
    sustained_by_speed: dict[str, Figure]
    sustained_smooth: Figure
    sustained_rough: Figure
    dropped_per_s: Figure  # times a second of sliding that the status is nominal again


def ensure_recordings(
    protocol: Protocol, split: SplitName, folder: Path, workers: Workers,
    progress: Callable[[int, int], None], layout: str = "",
) -> dict[str, list[Path]]:  # fmt: skip
    """Build what is missing of a split's recordings; returns their files by set. Raises UsageError
    for a folder with other content."""
    plans = {name: protocol.jobs(name, split, layout) for name in protocol.recordings}
    total, before = sum(map(len, plans.values())), 0
    for name, jobs in plans.items():
        origin = protocol.dataset(name, split, layout)

        def shown(done: int, of: int, before: int = before) -> None:
            progress(before + done, total)

        build(jobs, origin, folder / name, workers, shown)
        before += len(jobs)
    return {name: [folder / name / job.path for job in jobs] for name, jobs in plans.items()}


class _Task(msgspec.Struct, frozen=True):
    config: TrialConfig
    path: str


def _probabilities(task: _Task) -> tuple[str, Floats]:
    counts = read(task.path).counts  # the labels are dropped before the detector sees anything
    made = task.config.make_detector(counts.shape[1], counts.shape[2])
    return task.path, stream(made, counts)[0]


def give_up(detector: str, silent_s: float) -> None:
    """Raise UsageError if its workers have given no result for NO_RESULT_S."""
    if silent_s >= NO_RESULT_S:
        problem = f"{detector}: no result for {NO_RESULT_S / 60:g} minutes, so it was ended"
        raise UsageError(problem, "its `update` must return within the sample period")


def stream_files(
    config: TrialConfig, files: dict[str, list[Path]], workers: Workers,
    progress: Callable[[int, int], None],
) -> dict[str, list[Streamed]]:  # fmt: skip
    """The detector's output on every recording, by set."""
    tasks = [_Task(config, str(path)) for paths in files.values() for path in paths]
    found: dict[str, Floats] = {}
    progress(0, len(tasks))
    quiet = partial(give_up, config.detector_label)
    for done, (path, p) in enumerate(results(_probabilities, tasks, workers, quiet), 1):
        found[path] = p
        progress(done, len(tasks))
    none = np.empty(0)
    return {
        name: [Streamed(read(path), found[str(path)], none) for path in paths]
        for name, paths in files.items()
    }


def score_streams(
    sets: dict[str, list[Streamed]], rule: RuleSettings, threshold: float
) -> StreamScores:
    """Scores of a rule; ``threshold`` is that of single samples."""
    delays = [slide_delays_ms(s, rule) for name in SLIDES for s in sets[name]]
    alarms = [(false_alarms(s, rule), s) for each in sets.values() for s in each]
    caused = [(a, s) for a, s in alarms if cause_of(s.recording) in ACTUATION]
    parts = [samples(s, rule) for s in sets["paper"]]
    lasting = [_lasting(s, rule) for s in sets["sliding"]]

    def reported(keep: Callable[[Slide], bool]) -> Figure:
        return figure(_reported, [[x for x in each if keep(x)] for each in lasting])

    return StreamScores(
        auc=sample_auc(parts),
        balanced_accuracy=figure(_balanced, [confusion(p > threshold, y) for p, y in parts]),
        recall=figure(_recall, delays),
        delay_p50_ms=figure(partial(_delay, 0.5), delays),
        delay_p90_ms=figure(partial(_delay, 0.9), delays),
        false_per_min=figure(_rate, [a for a, _ in alarms]),
        false_per_min_actuation=figure(_rate, [a for a, _ in caused]),
        lingering=figure(_lingering, [a for a, _ in alarms]),
        sustained=reported(lambda x: True),
        sustained_by_speed={
            name: reported(lambda x, low=low, high=high: low <= x.speed_mps < high)  # type: ignore[misc]
            for name, (low, high) in SPEEDS_MPS.items()
        },
        sustained_smooth=reported(lambda x: x.smooth),
        sustained_rough=reported(lambda x: not x.smooth),
        dropped_per_s=figure(_dropped, lasting),
    )  # fmt: skip


def samples(s: Streamed, rule: RuleSettings) -> tuple[Floats, Labels]:
    """Probabilities and labels of the samples that count."""
    after = slice(WARM_UP_SAMPLES, None)
    return hand_probability(s, rule)[after], s.labels[after]


def sample_auc(parts: Sequence[tuple[Floats, Labels]]) -> Figure:
    """AUC over the samples of recordings; of a single one, the interval is over its strokes."""
    p, labels = (np.concatenate(column) for column in zip(*parts, strict=True))
    if len(parts) == 1:
        low, high = stroke_intervals(p, labels, 0.5).get("auc", (None, None))
        return Figure(auc(p, labels), low, high)
    ranking, block = Ranking(p, labels), np.repeat(range(len(parts)), [len(y) for _, y in parts])
    areas = [
        ranking.auc(np.bincount(chosen, minlength=len(parts))[block].astype(np.float64))
        for chosen in resamples(len(parts))
    ]
    return _bounded(auc(p, labels), areas)


def resamples(units: int) -> list[NDArray[np.intp]]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, units, units) for _ in range(RESAMPLES)]


def figure(statistic: Callable[[Sequence[T]], float | None], units: Sequence[T]) -> Figure:
    """The statistic with its bootstrap interval over units."""
    drawn = [statistic([units[i] for i in chosen]) for chosen in resamples(len(units))]
    return _bounded(statistic(units), drawn)


def _bounded(value: float | None, drawn: Sequence[float | None]) -> Figure:
    ordered = sorted(each for each in drawn if each is not None)
    if value is None or not ordered:
        return Figure(None)
    return Figure(float(value), float(quantile(ordered, 0.025)), float(quantile(ordered, 0.975)))


def _balanced(cells: Sequence[Confusion]) -> float | None:
    return Confusion(*np.sum([msgspec.structs.astuple(c) for c in cells], axis=0)).balanced_accuracy


def _recall(delays_ms: Sequence[Floats]) -> float | None:
    every = np.concatenate(delays_ms)
    return float(np.isfinite(every).mean()) if len(every) else None


def _delay(share: float, delays_ms: Sequence[Floats]) -> float | None:
    every = np.concatenate(delays_ms)
    return quantile(np.sort(every), share) if len(every) else None


# Slips and false alarms, by the true motion of the surface over the pad


def _grounded(slides: Labels) -> Labels:
    """Samples (n,) at which an event may begin without being false: the surface slides, has slid
    within LATE samples, or will within EARLY, because the pad shears before it slides."""
    shifts = range(-EARLY, LATE + 1)
    padded = np.pad(slides, (LATE, EARLY))
    near = [padded[LATE - k : len(padded) - EARLY - k] for k in shifts]
    grounded: Labels = np.logical_or.reduce(near)
    return grounded


def false_alarms(s: Streamed, rule: RuleSettings) -> Alarms:
    """Events that begin although nothing slides. The time of a tap does not count."""
    slides = s.recording.label("slip_true")
    counted = ~_grounded(slides) & (np.arange(len(slides)) >= WARM_UP_SAMPLES)
    for tap in impacts_of(s.recording):
        counted[tap.start : tap.end] = False
    starts = registered_events(s.probabilities, rule)[:, 0]
    hands = s.recording.fingers / HAND_FINGERS
    on = registered(s, rule)
    return Alarms(
        int(counted[starts].sum()), counted.sum() * PERIOD_S * hands,
        (counted & on).sum() * PERIOD_S * hands,
    )  # fmt: skip


def _rate(chosen: Sequence[Alarms]) -> float | None:
    seconds = sum(each.hand_s for each in chosen)
    return 60.0 * sum(each.false for each in chosen) / seconds if seconds else None


def _lingering(chosen: Sequence[Alarms]) -> float | None:
    seconds = sum(each.hand_s for each in chosen)
    return sum(each.on_s for each in chosen) / seconds if seconds else None


def slide_delays_ms(s: Streamed, rule: RuleSettings) -> Floats:
    """Delay (k,) from the onset of each slide of LEAST_SLIP_M or more to the event that reports it:
    0 if it began before, infinite if there is none. A slide at whose onset the event of the slide
    before is still on is left out if that was within EARLY samples, else it is missed."""
    r, slides = s.recording, s.recording.label("slip_true")
    speed_mps = np.zeros(len(slides)) if r.contact_speed_mps is None else r.contact_speed_mps
    path_m = np.concatenate([[0.0], np.cumsum(speed_mps * PERIOD_S)])
    events, delays_ms, rested = registered_events(s.probabilities, rule), [], 0
    for first, after in true_events(slides, r.t_s, MERGE_GAP_S):
        from_sample, rested = max(rested, first - EARLY), after
        if first < WARM_UP_SAMPLES or path_m[after] - path_m[first] < LEAST_SLIP_M:
            continue
        starts = [start for start, _ in events if from_sample <= start < after]
        if starts:
            delays_ms.append(1e3 * (r.t_s[max(starts[0], first)] - r.t_s[first]))
        elif from_sample == first - EARLY or not any(a < from_sample < b for a, b in events):
            delays_ms.append(np.inf)
    return np.array(delays_ms, np.float64)


# Slip that lasts


class Slide(msgspec.Struct, frozen=True):
    """A slide from LASTING_S to LOOKED_S after its onset."""

    speed_mps: float  # mean
    smooth: bool
    samples: int
    reported: int  # samples with slip registered
    drops: int  # times that the status became nominal


def is_smooth(recording: Recording) -> bool:
    """Whether the held object is smoother than SMOOTH_M."""
    known = recording.metadata.object if recording.metadata else {}
    return float(known.get("texture_rms_m", 1.0)) < SMOOTH_M  # type: ignore[arg-type]


def registered(s: Streamed, rule: RuleSettings) -> Labels:
    """Samples (n,) with slip registered."""
    on = np.zeros(len(s.probabilities), np.bool_)
    for first, after in registered_events(s.probabilities, rule):
        on[first:after] = True
    return on


def _lasting(s: Streamed, rule: RuleSettings) -> list[Slide]:
    r, slides = s.recording, []
    if r.slip_true is None or r.contact_speed_mps is None:
        return []
    on = registered(s, rule)
    for first, after in true_events(r.slip_true, r.t_s, MERGE_GAP_S):
        begin, end = np.searchsorted(r.t_s, r.t_s[first] + np.array([LASTING_S, LOOKED_S]))
        seen = on[begin : min(end, after)]
        speed_mps = float(r.contact_speed_mps[first:after].mean())
        if len(seen) and first >= WARM_UP_SAMPLES and speed_mps >= FAST_MPS:
            drops = int((seen[:-1] & ~seen[1:]).sum())
            slides.append(Slide(speed_mps, is_smooth(r), len(seen), int(seen.sum()), drops))
    return slides


def _reported(chosen: Sequence[Sequence[Slide]]) -> float | None:
    samples = sum(slide.samples for each in chosen for slide in each)
    return sum(x.reported for each in chosen for x in each) / samples if samples else None


def _dropped(chosen: Sequence[Sequence[Slide]]) -> float | None:
    seconds = PERIOD_S * sum(slide.samples for each in chosen for slide in each)
    return sum(x.drops for each in chosen for x in each) / seconds if seconds else None


# Taps


def score_taps(streams: Sequence[Streamed], rule: RuleSettings) -> list[Tap]:
    """All taps of the set `mallet` that moved the object by 2 mm or more, or by less than 0.5 mm.

    Right means: slip registered within 100 ms of the first motion, and the status nominal again
    within 1 s or before the next disturbance; or nothing registered."""
    taps = []
    for number, s in enumerate(streams):
        impacts = _impacts(s)
        events, t_s = registered_events(s.probabilities, rule), s.recording.t_s
        on, delays_ms = registered(s, rule), impact_delays(events, impacts, t_s)
        for k, (tap, delay_ms) in enumerate(zip(impacts, delays_ms.tolist(), strict=True)):
            moved = tap.moved_m >= FAR_M
            if not moved and tap.moved_m >= UNMOVED_M:
                continue
            until_s = t_s[tap.onset] + AGAIN_S
            following = impacts[k + 1].start if k + 1 < len(impacts) else len(t_s)
            last = min(int(np.searchsorted(t_s, until_s)), following) - 1
            answered = delay_ms <= SOON_MS and not on[last]
            right = answered if moved else not on[tap.start : tap.end].any()
            smooth = is_smooth(s.recording)
            taps.append(Tap(number, smooth, moved, right, delay_ms if moved else None))
    return taps


def oracle_taps(streams: Sequence[Streamed], delay_ms: float) -> list[Tap]:
    """The same taps, with slip registered that long after the first motion and never without."""
    return [
        Tap(number, is_smooth(s.recording), moved, not moved or delay_ms <= SOON_MS,
            delay_ms if moved else None)
        for number, s in enumerate(streams) for tap in _impacts(s)
        for moved in [tap.moved_m >= FAR_M] if moved or tap.moved_m < UNMOVED_M
    ]  # fmt: skip


def _impacts(s: Streamed) -> list[Impact]:
    return [each for each in impacts_of(s.recording) if each.start >= WARM_UP_SAMPLES]
