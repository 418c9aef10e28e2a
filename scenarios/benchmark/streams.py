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

from detector.decision import RuleSettings, registered_events
from detector.recordings import MOVED_M, read
from detector.scores.evaluation import WARM_UP_SAMPLES, Streamed, scored_samples, stream
from detector.scores.events import MERGE_GAP_S, EventOutcomes, score_events, slides_of, true_events
from detector.scores.figures import Figure, figure, samples_of
from detector.scores.impacts import WATCHED_S, Impact, impact_delays, impacts_of
from detector.scores.metrics import Floats, Labels
from drivers.errors import UsageError
from scenarios.acquire.datasets.build import Progress, build
from scenarios.acquire.datasets.causes import LEAST_SLIP_M
from scenarios.benchmark.protocol import Protocol, SplitName
from scenarios.rigs.workers import Workers, results
from scenarios.trial.config import TrialConfig

T = TypeVar("T")
R = TypeVar("R")
TAPS, QUARTER = "mallet", 4  # set of taps; a quick run has a quarter of it
LASTING_S, LOOKED_S = 0.2, 2.0  # after onset: where the status is looked at
FAST_MPS = 0.01  # slides slower than that are not counted as lasting slip
# in this time an object that slides at the speed of a lift, 0.1 m/s, moves `lifts.TOO_FAR_M`
TOO_LATE_MS = 200.0
AGAIN_S = 1.0  # from the first motion of a tap until the status is nominal, or the next disturbance
NO_RESULT_S = 300.0  # of all workers; the longest recording or lift takes a tenth of it


class Tap(msgspec.Struct, frozen=True):
    """One tap by one rule. ``delay_ms``: of those that moved the object by 1 mm; else None."""

    recording: int
    moved: bool
    quality: float  # from 0 to 1
    delay_ms: float | None


def ensure_recordings(
    protocol: Protocol, split: SplitName, folder: Path, workers: Workers,
    progress: Progress, layout: str = "", quick: bool = False,
) -> dict[str, list[Path]]:  # fmt: skip
    """Build what is missing of a split's recordings; returns their files by set. ``quick``: the
    first quarter of the taps. Raises UsageError for a folder with other content."""
    plans = {name: protocol.jobs(name, split, layout) for name in protocol.recordings}
    folders = {name: folder / name for name in plans}
    if quick:
        plans[TAPS] = plans[TAPS][: len(plans[TAPS]) // QUARTER]
        folders[TAPS] = folder / f"{TAPS}-quick"
    total, before = sum(map(len, plans.values())), 0
    for name, jobs in plans.items():
        origin = protocol.dataset(name, split, layout)

        def shown(done: int, of: int, before: int = before) -> None:
            progress(before + done, total)

        build(jobs, origin, folders[name], workers, shown)
        before += len(jobs)
    return {name: [folders[name] / job.path for job in jobs] for name, jobs in plans.items()}


def _probabilities(config: TrialConfig, path: Path) -> Floats:
    counts = read(path).counts  # the labels are dropped before the detector sees anything
    return stream(config.make_detector(counts.shape[1], counts.shape[2]), counts)[0]


def in_order(
    work: Callable[[T], R], tasks: Sequence[T], detector: str, workers: Workers,
    progress: Progress,
) -> list[R]:  # fmt: skip
    """Results of the tasks. Raises as `give_up`."""
    found: dict[int, R] = {}
    progress(0, len(tasks))
    numbered = results(
        partial(_numbered, work), list(enumerate(tasks)), workers, partial(give_up, detector)
    )
    for done, (number, result) in enumerate(numbered, 1):
        found[number] = result
        progress(done, len(tasks))
    return [found[number] for number in range(len(tasks))]


def _numbered(work: Callable[[T], R], task: tuple[int, T]) -> tuple[int, R]:
    return task[0], work(task[1])


def give_up(detector: str, silent_s: float) -> None:
    """Raise UsageError if its workers have given no result for NO_RESULT_S."""
    if silent_s >= NO_RESULT_S:
        problem = f"{detector}: no result for {NO_RESULT_S / 60:g} minutes, so it was ended"
        raise UsageError(problem, "its `update` must return within the sample period")


def stream_files(
    config: TrialConfig, files: dict[str, list[Path]], workers: Workers, progress: Progress
) -> dict[str, list[Streamed]]:
    """The detector's output on every recording, by set."""
    paths, none = [path for each in files.values() for path in each], np.empty(0)
    work = partial(_probabilities, config)
    outputs = iter(in_order(work, paths, config.detector_label, workers, progress))
    return {
        name: [Streamed(read(path), next(outputs), none) for path in each]
        for name, each in files.items()
    }


def score_streams(sets: dict[str, list[Streamed]], rule: RuleSettings) -> dict[str, Figure]:
    """Figures of a rule by name."""
    every = [slide_outcomes(s, rule) for each in sets.values() for s in each]
    return {
        "auc": samples_of([scored_samples(s, rule) for s in sets["paper"]]).auc(),
        "lingering": figure(_lingering, every),  # share of the time without slip
        # share of lasting slip that is reported
        "sustained": figure(_reported, [_lasting(s, rule) for s in sets["sliding"]]),
    }


def slide_outcomes(s: Streamed, rule: RuleSettings) -> EventOutcomes:
    """Slips and false alarms by the true motion of the surface over the pad, without the time of
    taps. A slip whose event began before it has delay 0."""
    r, slides = s.recording, s.recording.label("slip_true")
    taps = np.zeros(len(slides), np.bool_)
    for tap in impacts_of(r):
        taps[tap.start : tap.end] = True
    speed_mps = np.zeros(len(slides)) if r.contact_speed_mps is None else r.contact_speed_mps
    true = slides_of(
        slides, r.t_s, speed_mps, least_m=LEAST_SLIP_M, first_sample=WARM_UP_SAMPLES,
        excluded=taps, fingers=r.fingers,
    )  # fmt: skip
    found = score_events(registered_events(s.probabilities, rule), true)
    return msgspec.structs.replace(found, delays_ms=np.maximum(found.delays_ms, 0.0))


def _lingering(outcomes: Sequence[EventOutcomes]) -> float | None:
    seconds = sum(o.hand_s for o in outcomes)
    return sum(o.lingering_s for o in outcomes) / seconds if seconds else None


# Slip that lasts


def registered(s: Streamed, rule: RuleSettings) -> Labels:
    """Samples (n,) with slip registered."""
    on = np.zeros(len(s.probabilities), np.bool_)
    for first, after in registered_events(s.probabilities, rule):
        on[first:after] = True
    return on


def _lasting(s: Streamed, rule: RuleSettings) -> Labels:
    """Samples (n,) of lasting slip, from LASTING_S to LOOKED_S after its onset: whether slip is
    registered."""
    r, on, seen = s.recording, registered(s, rule), [np.zeros(0, np.bool_)]
    if r.slip_true is None or r.contact_speed_mps is None:
        return seen[0]
    for first, after in true_events(r.slip_true, r.t_s, MERGE_GAP_S):
        begin, end = np.searchsorted(r.t_s, r.t_s[first] + np.array([LASTING_S, LOOKED_S]))
        if first >= WARM_UP_SAMPLES and r.contact_speed_mps[first:after].mean() >= FAST_MPS:
            seen.append(on[begin : min(end, after)])
    return np.concatenate(seen)


def _reported(chosen: Sequence[Labels]) -> float | None:
    every = np.concatenate(chosen)
    return float(every.mean()) if len(every) else None


# Taps


def score_taps(streams: Sequence[Streamed], rule: RuleSettings) -> list[Tap]:
    """All taps of the set `mallet`. The quality of one that moved the object by 1 mm falls with
    the delay from the first motion, to 0 at TOO_LATE_MS or if the status is not nominal again
    within 1 s or before the next disturbance. After others nothing may be registered."""
    taps = []
    for number, s in enumerate(streams):
        impacts = _impacts(s)
        events, t_s = registered_events(s.probabilities, rule), s.recording.t_s
        on, delays_ms = registered(s, rule), impact_delays(events, impacts, t_s)
        for k, (tap, delay_ms) in enumerate(zip(impacts, delays_ms.tolist(), strict=True)):
            until_s = t_s[tap.onset] + AGAIN_S
            following = impacts[k + 1].start if k + 1 < len(impacts) else len(t_s)
            last = min(int(np.searchsorted(t_s, until_s)), following) - 1
            moved = tap.moved_m >= MOVED_M
            fails = on[last] if moved else on[tap.start : tap.end].any()
            quality = 0.0 if fails else _promptness(delay_ms) if moved else 1.0
            taps.append(Tap(number, moved, quality, delay_ms if moved else None))  # fmt: skip
    return taps


def oracle_taps(streams: Sequence[Streamed], delay_ms: float) -> list[Tap]:
    """The same taps, with slip registered that long after the first motion and never without."""
    delay_ms = delay_ms if delay_ms < 1e3 * WATCHED_S else math.inf
    return [
        Tap(number, moved, _promptness(delay_ms) if moved else 1.0, delay_ms if moved else None)
        for number, s in enumerate(streams) for tap in _impacts(s)
        for moved in [tap.moved_m >= MOVED_M]
    ]  # fmt: skip


def _promptness(delay_ms: float) -> float:
    return min(max(1.0 - delay_ms / TOO_LATE_MS, 0.0), 1.0)


def _impacts(s: Streamed) -> list[Impact]:
    return [each for each in impacts_of(s.recording) if each.start >= WARM_UP_SAMPLES]
