"""Metrics of events: the events that a decision rule registered, compared with the true slips.

The controller responds to the start of a registered event. So a slip is detected if an event starts
within it; an event that started before does not count. What slips there are is stated by a label
(`slips_of`), or by the true motion of a simulation (`slides_of`). `score_events` scores both.
"""

from collections.abc import Sequence
from functools import partial

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.scores.figures import Figure, figure, quantile_figures
from detector.scores.metrics import Floats, Labels
from detector.scores.quantiles import quantile
from drivers.interfaces import FINGERS, PERIOD_S

MOVING_MPS = 1e-4  # a thirtieth of the labelling speed: the contact moves
MERGE_GAP_S = 0.1  # static gaps shorter than this do not end a slip; assumed
# an event may start this long before the label: sliding starts below its speed; assumed
EARLY_S = 0.02
RUN_UP_S = 0.3  # longest time before the label in which a moving contact counts as slip
# samples around true sliding in which an event is not false: the pad shears before it slides
EARLY, LATE = 30, 10
Events = NDArray[np.intp]  # (m, 2): first sample, and the first one after


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
    """Delays and counts of one recording by one rule."""

    delays_ms: Floats  # of every slip, infinite if missed
    delays_mm: Floats | None  # distance slipped until the event, likewise
    releases_ms: Floats  # of the detected slips
    missed: int
    good: int  # registered events that start in a slip
    false: int
    static_s: float
    hand_s: float  # static time of a hand; one finger counts as a third of a hand
    lingering_s: float  # of hand_s, with slip registered


class Slips(msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """True slips of one recording, the same for every rule."""

    truth: Events
    t_s: Floats
    earliest_s: Floats  # (m,) an event that starts at this time or later detects the slip
    scored: Labels  # (m,)
    # (m,) a missed slip is not scored if an event is on at this sample, that of the slip shortly
    # before; -1: there was none
    follows: Events
    static: Labels  # (n,) an event that starts in these samples and detects no slip is false
    period_s: float
    path_mm: Floats | None  # (n,) distance slid until each sample
    hands: float  # recorded fingers over those of a hand

    @property
    def static_s(self) -> float:
        return float(self.static.sum() * self.period_s)


def slips_of(
    slip: Labels,
    t_s: Floats,
    *,
    early_s: float = EARLY_S,
    first_sample: int = 0,
    speed_mps: Floats | None = None,
    excluded: Labels | None = None,
    fingers: int = FINGERS,
) -> Slips:
    """True slips from labels (n,) at times (n,). Slips and false alarms count if they start at
    ``first_sample`` or later and outside the ``excluded`` samples (n,), which are not static time
    either. With the sliding speed ``speed_mps`` (n,), an event may start as soon as the contact
    moves, and delays are also in mm."""
    static = np.arange(len(t_s)) >= first_sample
    if excluded is not None:
        static &= ~excluded
    truth = true_events(slip, t_s, MERGE_GAP_S)
    scored = static[truth[:, 0]]
    for first, after in truth:
        static[first:after] = False
    path_mm = None
    if speed_mps is not None:  # the speed is constant until the next sample
        steps_mm = np.abs(speed_mps[:-1]) * np.diff(t_s) * 1e3
        path_mm = np.concatenate([[0.0], np.cumsum(steps_mm)])
    return Slips(
        truth=truth, t_s=t_s, earliest_s=_earliest_s(truth, t_s, early_s, speed_mps, excluded),
        scored=scored, follows=np.full(len(truth), -1), static=static,
        period_s=float((t_s[-1] - t_s[0]) / (len(t_s) - 1)), path_mm=path_mm,
        hands=fingers / FINGERS,
    )  # fmt: skip


def slides_of(
    slides: Labels, t_s: Floats, speed_mps: NDArray[np.floating], *, least_m: float,
    first_sample: int, excluded: Labels, fingers: int,
) -> Slips:  # fmt: skip
    """True slips where the surface slides (n,), at the speed (n,), each of ``least_m`` or more.

    An event may start EARLY samples before a slide. It is false if nothing slides from EARLY
    samples after it to LATE samples before it. A slide less than EARLY samples after another is
    not scored if the event of that one is still on. ``first_sample``, ``excluded``: as in
    `slips_of`."""
    truth = true_events(slides, t_s, MERGE_GAP_S)
    onset, end = truth.T
    rested = np.concatenate([[0], end])[: len(onset)]
    earliest = np.maximum(rested, onset - EARLY)
    path_m = np.concatenate([[0.0], np.cumsum(speed_mps * PERIOD_S)])
    static = (np.arange(len(t_s)) >= first_sample) & ~excluded & ~_near(slides)
    return Slips(
        truth=truth, t_s=t_s, earliest_s=t_s[earliest],
        scored=(onset >= first_sample) & (path_m[end] - path_m[onset] >= least_m),
        follows=np.where(earliest > onset - EARLY, earliest, -1), static=static,
        period_s=PERIOD_S, path_mm=1e3 * path_m[:-1], hands=fingers / FINGERS,
    )  # fmt: skip


def _near(slides: Labels) -> Labels:
    """Samples (n,) that slide, have slid within LATE samples, or will within EARLY."""
    padded = np.pad(slides, (LATE, EARLY))
    windows = np.lib.stride_tricks.sliding_window_view(padded, LATE + 1 + EARLY)
    return np.logical_or.reduce(windows, axis=1)  # type: ignore[no-any-return]


def score_events(registered: Events, slips: Slips) -> EventOutcomes:
    """Compare registered events (m, 2) with the true slips."""
    truth, t_s, path_mm = slips.truth, slips.t_s, slips.path_mm
    starts, ends = registered.T
    owner = _owners(registered, truth, t_s, slips.earliest_s)
    caught = np.isin(np.arange(len(truth)), owner)
    still_on = ((starts[:, None] < slips.follows) & (slips.follows < ends[:, None])).any(axis=0)
    scored = np.flatnonzero(slips.scored & (caught | ~still_on))
    detected, onset, at = caught[scored], truth[scored, 0], truth[scored, 1]
    hits = scored[detected]
    at[detected] = [starts[owner == i][0] for i in hits]
    released = np.array([ends[owner == i][-1] for i in hits], np.intp)
    delays_mm = None
    if path_mm is not None:  # 0 for an early event
        slipped_mm = np.maximum(_at(path_mm, at) - _at(path_mm, onset), 0.0)
        delays_mm = np.where(detected, slipped_mm, np.inf)
    static_before = np.concatenate([[0], np.cumsum(slips.static)])
    lingering = int((static_before[ends] - static_before[starts]).sum())
    return EventOutcomes(
        delays_ms=np.where(detected, 1e3 * (_at(t_s, at) - _at(t_s, onset)), np.inf),
        delays_mm=delays_mm,
        releases_ms=1e3 * (_at(t_s, released) - _at(t_s, truth[hits, 1])),
        missed=int((~detected).sum()),
        good=int(np.isin(owner, scored).sum()),
        false=int(((owner < 0) & slips.static[starts]).sum()),
        static_s=slips.static_s,
        hand_s=slips.static_s * slips.hands,
        lingering_s=lingering * slips.period_s * slips.hands,
    )


# Statistics of outcomes of several recordings; None where undefined


def false_rate(outcomes: Sequence[EventOutcomes]) -> float | None:
    """False alarms a minute of a hand."""
    hand_s = sum(o.hand_s for o in outcomes)
    return 60.0 * sum(o.false for o in outcomes) / hand_s if hand_s else None


def recall(outcomes: Sequence[EventOutcomes]) -> float | None:
    """Detected share of the slips."""
    delays = all_delays_ms(outcomes)
    return float(np.isfinite(delays).mean()) if len(delays) else None


def delay_quantile_ms(outcomes: Sequence[EventOutcomes], share: float = 0.5) -> float | None:
    """Quantile of the delays."""
    delays = all_delays_ms(outcomes)
    return quantile(np.sort(delays), share) if len(delays) else None


def all_delays_ms(outcomes: Sequence[EventOutcomes]) -> Floats:
    """Delays of all slips, infinite where missed."""
    delays: Floats = np.concatenate([o.delays_ms for o in outcomes])
    return delays


def event_figures(outcomes: Sequence[EventOutcomes]) -> dict[str, Figure]:
    """Figures by name. Delays count from the rise of the label, negative is early, and a missed
    slip has an infinite one; ``release`` counts from its fall."""
    good, false = sum(o.good for o in outcomes), sum(o.false for o in outcomes)
    slipped = [o.delays_mm for o in outcomes if o.delays_mm is not None]
    every_mm = np.concatenate(slipped) if len(slipped) == len(outcomes) else np.empty(0)
    return {
        "slips": Figure(len(all_delays_ms(outcomes))),
        "missed": Figure(sum(o.missed for o in outcomes)),
        "events": Figure(good + false),
        "false_alarms": Figure(false),
        "recall": figure(recall, outcomes),
        "precision": Figure(good / (good + false) if good + false else None),
        "false_per_min": figure(false_rate, outcomes),
        "delay_p50_ms": figure(delay_quantile_ms, outcomes),
        "delay_p90_ms": figure(partial(delay_quantile_ms, share=0.9), outcomes),
        "delay_p99_ms": figure(partial(delay_quantile_ms, share=0.99), outcomes),
        **quantile_figures("slid", "mm", every_mm),
        **quantile_figures("release", "ms", np.concatenate([o.releases_ms for o in outcomes])),
    }


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
