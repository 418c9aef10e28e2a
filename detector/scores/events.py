"""Metrics of events: what a decision rule registered against the slips that really happened.

The controller acts upon the beginning of a registered event. So a slip is caught if an event begins
within it; an alarm that is still on from before catches nothing.
"""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.scores.metrics import Floats, Labels
from detector.scores.quantiles import Quantiles, quantiles

MOVING_MPS = 1e-4  # a thirtieth of the labelling speed: the contact moves
MERGE_GAP_S = 0.1  # static gaps shorter than this do not end a slip; assumed
# an event may begin this long before the label: sliding starts below its speed; assumed
EARLY_S = 0.02
RUN_UP_S = 0.3  # longest time before the label that a contact which moves already counts for slip
Events = NDArray[np.intp]  # (m, 2): first sample, and the first one after


class EventMetrics(msgspec.Struct, frozen=True):
    """Events in a stretch of data; None where there is nothing to judge.

    Delays count from the label's rise (``delay``) and fall (``release_delay``): negative is early.
    A miss is a delay without end, and quantiles say so: infinite where too many are missed.
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
    """Runs of slip (m, 2), those closer than the gap joined."""
    edges = np.flatnonzero(np.diff(slip.astype(np.int8), prepend=0, append=0))
    first, after = edges[::2], edges[1::2]
    apart = t_s[first[1:]] - t_s[after[:-1]] >= merge_gap_s
    return np.column_stack([
        first[np.concatenate([[True], apart])[: len(first)]],
        after[np.concatenate([apart, [True]])[: len(after)]],
    ])  # fmt: skip


class Judgement(msgspec.Struct, frozen=True, eq=False):
    """What became of the slips of one stretch of data; several can be pooled."""

    delays_ms: Floats  # of every slip, infinite where it was missed
    delays_mm: Floats | None  # likewise
    releases_ms: Floats  # of the slips that were caught
    missed: int
    good: int  # registered events that begin in a slip
    false: int
    static_s: float


class Slips(msgspec.Struct, frozen=True, eq=False):
    """What is to be found in one stretch of data, the same for every rule."""

    truth: Events
    t_s: Floats
    earliest_s: Floats  # (m,) an event that begins from then on detects this slip
    counted: Labels  # (n,) samples in which slips and false events count if they begin there
    static_s: float
    path_mm: Floats | None  # (n,) slid until each sample


def slips_of(
    slip: Labels,
    t_s: Floats,
    *,
    early_s: float = EARLY_S,
    first_sample: int = 0,
    speed_mps: Floats | None = None,
    left_out: Labels | None = None,
) -> Slips:
    """Of labels (n,) at times (n,). Slips and false events count if they begin at ``first_sample``
    or later, and not in what is ``left_out`` (n,), which is no rest either. With ``speed_mps`` (n,)
    of sliding an event may begin as soon as the contact moves, and delays are also in mm slipped.
    """
    counted = np.arange(len(t_s)) >= first_sample
    if left_out is not None:
        counted &= ~left_out
    truth = true_events(slip, t_s, MERGE_GAP_S)
    static = counted.copy()
    for first, after in truth:
        static[first:after] = False
    static_s = float(static.sum() * ((t_s[-1] - t_s[0]) / (len(t_s) - 1)))  # a period each
    path_mm = None
    if speed_mps is not None:  # a speed holds until the next sample
        steps_mm = np.abs(speed_mps[:-1]) * np.diff(t_s) * 1e3
        path_mm = np.concatenate([[0.0], np.cumsum(steps_mm)])
    earliest_s = _earliest_s(truth, t_s, early_s, speed_mps, left_out)
    return Slips(truth, t_s, earliest_s, counted, static_s, path_mm)


def judge(registered: Events, slips: Slips) -> Judgement:
    """Judge registered events (m, 2)."""
    truth, t_s, counted, path_mm = slips.truth, slips.t_s, slips.counted, slips.path_mm
    owner = _owners(registered, truth, t_s, slips.earliest_s)
    scored = np.flatnonzero(counted[truth[:, 0]])
    first = [registered[owner == i][:1, 0] for i in scored]
    answered = np.array([len(f) > 0 for f in first], np.bool_)
    onset, end = truth[scored, 0], truth[scored, 1]
    at = np.where(answered, [f[0] if len(f) else 0 for f in first], end).astype(np.intp)
    released = np.array([registered[owner == i][-1, 1] for i in scored[answered]], np.intp)
    delays_mm = None
    if path_mm is not None:  # early is 0
        slipped_mm = np.maximum(_at(path_mm, at) - _at(path_mm, onset), 0.0)
        delays_mm = np.where(answered, slipped_mm, np.inf)
    return Judgement(
        delays_ms=np.where(answered, _at(t_s, at) * 1e3 - _at(t_s, onset) * 1e3, np.inf),
        delays_mm=delays_mm,
        releases_ms=(_at(t_s, released) - _at(t_s, end[answered])) * 1e3,
        missed=int((~answered).sum()),
        good=int(np.isin(owner, scored).sum()),
        false=int(((owner < 0) & counted[registered[:, 0]]).sum()),
        static_s=slips.static_s,
    )


def pooled(judgements: Sequence[Judgement]) -> EventMetrics:
    """Metrics of several stretches of data as of one."""
    delays = np.concatenate([j.delays_ms for j in judgements])
    slipped = [j.delays_mm for j in judgements if j.delays_mm is not None]
    releases = np.concatenate([j.releases_ms for j in judgements])
    missed, good, false = (
        sum(getattr(j, name) for j in judgements) for name in ("missed", "good", "false")
    )
    static_s = sum(j.static_s for j in judgements)
    return EventMetrics(
        true_events=len(delays),
        missed_events=missed,
        registered_events=good + false,
        false_events=false,
        event_recall=(len(delays) - missed) / len(delays) if len(delays) else None,
        event_precision=good / (good + false) if good + false else None,
        false_events_per_min=false / static_s * 60.0 if static_s > 0.0 else None,
        delay_ms=quantiles(delays),
        delay_mm=quantiles(np.concatenate(slipped)) if len(slipped) == len(judgements) else None,
        release_delay_ms=quantiles(releases),
    )


def _earliest_s(
    truth: Events, t_s: Floats, early_s: float, speed_mps: Floats | None, left_out: Labels | None
) -> Floats:
    """From when on (m,) an event detects each slip: a little before the label, or since the contact
    has been moving without rest. What is left out is no run-up, nor is what follows another slip so
    closely that it would be one with it."""
    onset = truth[:, 0]
    earliest_s: Floats = t_s[onset] - early_s
    if speed_mps is None:
        return earliest_s
    rests = ~(np.abs(speed_mps) >= MOVING_MPS)
    if left_out is not None:
        rests |= left_out
    still = np.concatenate([[-1], np.flatnonzero(rests)])
    began_s = t_s[still[np.searchsorted(still, onset) - 1] + 1]
    late_s = np.concatenate([[-np.inf], _at(t_s, truth[:-1, 1]) + MERGE_GAP_S])
    run_up_s = np.maximum(np.maximum(began_s, late_s[: len(onset)]), t_s[onset] - RUN_UP_S)
    found: Floats = np.minimum(earliest_s, run_up_s)
    return found


def _owners(registered: Events, truth: Events, t_s: Floats, earliest_s: Floats) -> NDArray[np.intp]:
    """The slip (index into truth) in which each registered event begins, -1 if in none."""
    start = registered[:, 0]
    candidate = np.searchsorted(truth[:, 1], start, side="right")
    return np.where(t_s[start] >= np.append(earliest_s, np.inf)[candidate], candidate, -1)


def _at(series: Floats, samples: Events) -> Floats:
    """Values of a series (n,) at samples; at the end of the data that of its last sample."""
    values: Floats = series[np.minimum(samples, len(series) - 1)]
    return values
