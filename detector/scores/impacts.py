"""Impacts on a held object, as a recording's metadata lists them, and what a decision rule makes of
those that moved it, and of those that did not."""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import Recording
from detector.scores.events import Events
from detector.scores.metrics import Floats
from detector.scores.quantiles import Quantiles, quantiles

KINDS = frozenset({"near", "mallet", "weak", "elastic"})
WEAK = "weak"  # with 5 to 70 % of what moves it: next to nothing comes of most of these
MOVED_M = 0.001  # for good: an impact that a detector has to register
UNMOVED_M = 0.0005  # within this it stays: one that it must not
FAR_M = 0.002  # one moved so far is expected to be registered,
SOON_MS = 100.0  # and within this
WATCHED_S = 0.5  # after an impact, or until the next act
MOTION_S = 0.1  # after an impact its motion begins, or never


class Impact(msgspec.Struct, frozen=True):
    """Samples of a recording: the first after it struck, the first of motion (or the same), and the
    first that is not its own any more."""

    struck: int
    onset: int
    until: int
    moved_m: float
    weak: bool


def impacts_of(recording: Recording) -> list[Impact]:
    """Every impact of a recording, in the order of time; none where none is noted."""
    acts = recording.metadata.acts if recording.metadata else ()
    t_s = recording.t_s - recording.t_s[0]
    starts_s = [act.t_s for act in acts] + [np.inf]
    found = []
    for act, next_s in zip(acts, starts_s[1:], strict=True):
        if act.kind not in KINDS:
            continue
        struck, motion, until = np.searchsorted(
            t_s, [act.t_s, act.t_s + MOTION_S, min(next_s, act.t_s + WATCHED_S)], side="right"
        ).tolist()
        onset = struck
        if recording.slip_true is not None and recording.slip_true[struck:motion].any():
            onset += int(recording.slip_true[struck:motion].argmax())
        if struck < until:
            found.append(Impact(struck, onset, until, act.moved_m, act.kind == WEAK))
    return found


class ImpactScore(msgspec.Struct, frozen=True):
    """Impacts by how far they moved what is held, for good, and which of them were registered."""

    moved: int  # 1 mm or more
    registered: int  # of these, before the next act
    far: int  # 2 mm or more
    far_registered: int  # of these, within 100 ms of the first motion
    unmoved: int  # within half a millimetre
    unmoved_registered: int
    nearly: int  # of `unmoved`, those that were not struck weakly
    nearly_registered: int
    delay_ms: Quantiles | None  # of `moved`; infinite where missed


def answers(registered: Events, impacts: Sequence[Impact], t_s: Floats) -> Floats:
    """Time (k,) from the first motion of each impact to the event that begins before the next act,
    ms; infinite where none does."""
    starts = registered[:, 0]
    at = np.searchsorted(starts, [b.struck for b in impacts])
    first = np.append(starts, len(t_s))[at]
    detected = first < [b.until for b in impacts]
    delays: Floats = np.full(len(impacts), np.inf)
    onsets = np.array([b.onset for b in impacts], np.intp)
    delays[detected] = (t_s[first[detected]] - t_s[onsets[detected]]) * 1e3
    return delays


def impact_score(moved_m: Floats, delays_ms: Floats, weak: NDArray[np.bool_]) -> ImpactScore | None:
    """The score of impacts (k,) with these answers; None of none."""
    if not len(moved_m):
        return None
    moved, far, unmoved = moved_m >= MOVED_M, moved_m >= FAR_M, moved_m < UNMOVED_M
    nearly, detected = unmoved & ~weak, np.isfinite(delays_ms)
    return ImpactScore(
        moved=int(moved.sum()),
        registered=int((moved & detected).sum()),
        far=int(far.sum()),
        far_registered=int((far & (delays_ms <= SOON_MS)).sum()),
        unmoved=int(unmoved.sum()),
        unmoved_registered=int((unmoved & detected).sum()),
        nearly=int(nearly.sum()),
        nearly_registered=int((nearly & detected).sum()),
        delay_ms=quantiles(delays_ms[moved]),
    )
