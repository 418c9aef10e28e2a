"""Metrics of events: the events that a decision rule registered, compared with the true slips.

The controller responds to the start of a registered event. So a slip is detected if an event starts
within it; an event that started before does not count.
"""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.scores.metrics import Floats, Labels
from detector.scores.quantiles import Quantiles, quantiles

MOVING_MPS = 1e-4  # a thirtieth of the labelling speed: the contact moves
MERGE_GAP_S = 0.1  # static gaps shorter than this do not end a slip; assumed
# an event may start this long before the label: sliding starts below its speed; assumed
EARLY_S = 0.02
RUN_UP_S = 0.3  # longest time before the label in which a moving contact counts as slip
Events = NDArray[np.intp]  # (m, 2): first sample, and the first one after


class EventMetrics(msgspec.Struct, frozen=True):
    """Metrics of the events of one or more recordings; None where undefined.

    Delays count from the rise (``delay``) and the fall (``release_delay``) of the label; negative
    is early. A missed slip has an infinite delay.
    """

    true_events: int
    missed_events: int
    registered_events: int
    false_events: int
    event_recall: float | None
    event_precision: float | None
    false_events_per_min: float | None
    delay_ms: Quantiles | None
    delay_mm: Quantiles | None
    release_delay_ms: Quantiles | None


def true_events(slip: Labels, t_s: Floats, merge_gap_s: float) -> Events:
    """Runs of slip (m, 2); runs closer than the gap are merged."""
    edges = np.flatnonzero(np.diff(slip.astype(np.int8), prepend=0, append=0))
    first, after = edges[::2], edges[1::2]
    apart = t_s[first[1:]] - t_s[after[:-1]] >= merge_gap_s
    return np.column_stack([
        first[np.concatenate([[True], apart])[: len(first)]],
        after[np.concatenate([apart, [True]])[: len(after)]],
    ])  # fmt: skip


class EventOutcomes(msgspec.Struct, frozen=True, eq=False):
    """Delays and counts of one recording by one rule; see `pooled`."""

    delays_ms: Floats  # of every slip, infinite if missed
    delays_mm: Floats | None  # distance slipped until the event, likewise
    releases_ms: Floats  # of the detected slips
    missed: int
    good: int  # registered events that start in a slip
    false: int
    static_s: float


class Slips(msgspec.Struct, frozen=True, eq=False):
    """True slips of one recording, the same for every rule."""

    truth: Events
    t_s: Floats
    earliest_s: Floats  # (m,) an event that starts at this time or later detects the slip
    counted: Labels  # (n,) slips and false alarms that start in these samples count
    static_s: float
    path_mm: Floats | None  # (n,) distance slid until each sample


def slips_of(
    slip: Labels,
    t_s: Floats,
    *,
    early_s: float = EARLY_S,
    first_sample: int = 0,
    speed_mps: Floats | None = None,
    excluded: Labels | None = None,
) -> Slips:
    """True slips from labels (n,) at times (n,). Slips and false alarms count if they start at
    ``first_sample`` or later and outside the ``excluded`` samples (n,), which are not static time
    either. With the sliding speed ``speed_mps`` (n,), an event may start as soon as the contact
    moves, and delays are also in mm."""
    counted = np.arange(len(t_s)) >= first_sample
    if excluded is not None:
        counted &= ~excluded
    truth = true_events(slip, t_s, MERGE_GAP_S)
    static = counted.copy()
    for first, after in truth:
        static[first:after] = False
    static_s = float(static.sum() * ((t_s[-1] - t_s[0]) / (len(t_s) - 1)))  # a period each
    path_mm = None
    if speed_mps is not None:  # the speed is constant until the next sample
        steps_mm = np.abs(speed_mps[:-1]) * np.diff(t_s) * 1e3
        path_mm = np.concatenate([[0.0], np.cumsum(steps_mm)])
    earliest_s = _earliest_s(truth, t_s, early_s, speed_mps, excluded)
    return Slips(truth, t_s, earliest_s, counted, static_s, path_mm)


def score_events(registered: Events, slips: Slips) -> EventOutcomes:
    """Compare registered events (m, 2) with the true slips."""
    truth, t_s, counted, path_mm = slips.truth, slips.t_s, slips.counted, slips.path_mm
    owner = _owners(registered, truth, t_s, slips.earliest_s)
    scored = np.flatnonzero(counted[truth[:, 0]])
    first = [registered[owner == i][:1, 0] for i in scored]
    detected = np.array([len(f) > 0 for f in first], np.bool_)
    onset, end = truth[scored, 0], truth[scored, 1]
    at = np.where(detected, [f[0] if len(f) else 0 for f in first], end).astype(np.intp)
    released = np.array([registered[owner == i][-1, 1] for i in scored[detected]], np.intp)
    delays_mm = None
    if path_mm is not None:  # 0 for an early event
        slipped_mm = np.maximum(_at(path_mm, at) - _at(path_mm, onset), 0.0)
        delays_mm = np.where(detected, slipped_mm, np.inf)
    return EventOutcomes(
        delays_ms=np.where(detected, _at(t_s, at) * 1e3 - _at(t_s, onset) * 1e3, np.inf),
        delays_mm=delays_mm,
        releases_ms=(_at(t_s, released) - _at(t_s, end[detected])) * 1e3,
        missed=int((~detected).sum()),
        good=int(np.isin(owner, scored).sum()),
        false=int(((owner < 0) & counted[registered[:, 0]]).sum()),
        static_s=slips.static_s,
    )


def pooled(outcomes: Sequence[EventOutcomes]) -> EventMetrics:
    """Metrics over several recordings."""
    delays = np.concatenate([o.delays_ms for o in outcomes])
    slipped = [o.delays_mm for o in outcomes if o.delays_mm is not None]
    releases = np.concatenate([o.releases_ms for o in outcomes])
    missed, good, false = (
        sum(getattr(o, name) for o in outcomes) for name in ("missed", "good", "false")
    )
    static_s = sum(o.static_s for o in outcomes)
    return EventMetrics(
        true_events=len(delays),
        missed_events=missed,
        registered_events=good + false,
        false_events=false,
        event_recall=(len(delays) - missed) / len(delays) if len(delays) else None,
        event_precision=good / (good + false) if good + false else None,
        false_events_per_min=false / static_s * 60.0 if static_s > 0.0 else None,
        delay_ms=quantiles(delays),
        delay_mm=quantiles(np.concatenate(slipped)) if len(slipped) == len(outcomes) else None,
        release_delay_ms=quantiles(releases),
    )


def _earliest_s(
    truth: Events, t_s: Floats, early_s: float, speed_mps: Floats | None, excluded: Labels | None
) -> Floats:
    """Earliest start (m,) of an event that detects each slip: ``early_s`` before the label, or the
    start of the contact's motion if that is earlier. Excluded samples, and the time just after
    another slip, do not count as such motion."""
    onset = truth[:, 0]
    earliest_s: Floats = t_s[onset] - early_s
    if speed_mps is None:
        return earliest_s
    rests = ~(np.abs(speed_mps) >= MOVING_MPS)
    if excluded is not None:
        rests |= excluded
    still = np.concatenate([[-1], np.flatnonzero(rests)])
    began_s = t_s[still[np.searchsorted(still, onset) - 1] + 1]
    late_s = np.concatenate([[-np.inf], _at(t_s, truth[:-1, 1]) + MERGE_GAP_S])
    run_up_s = np.maximum(np.maximum(began_s, late_s[: len(onset)]), t_s[onset] - RUN_UP_S)
    earliest: Floats = np.minimum(earliest_s, run_up_s)
    return earliest


def _owners(registered: Events, truth: Events, t_s: Floats, earliest_s: Floats) -> NDArray[np.intp]:
    """Index into ``truth`` of the slip in which each registered event starts; -1 for none."""
    start = registered[:, 0]
    candidate = np.searchsorted(truth[:, 1], start, side="right")
    return np.where(t_s[start] >= np.append(earliest_s, np.inf)[candidate], candidate, -1)


def _at(series: Floats, samples: Events) -> Floats:
    """Values of a series (n,) at samples; beyond the end, the last value."""
    values: Floats = series[np.minimum(samples, len(series) - 1)]
    return values
