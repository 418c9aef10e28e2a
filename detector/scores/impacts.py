"""Scores of a decision rule on the impacts that a recording's metadata lists."""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import MOVED_M, Recording
from detector.scores.events import Events
from detector.scores.figures import Figure
from detector.scores.metrics import Floats
from detector.scores.quantiles import Quantiles, quantiles

KINDS = frozenset({"near", "mallet", "weak", "elastic"})
WEAK = "weak"  # 5 to 70 % of the impulse that moves the object; most have no effect
UNMOVED_M = 0.0005  # lasting displacement below which a detector must not register an impact
FAR_M = 0.002  # and from which it should; from MOVED_M on it is counted as moved
SOON_MS = 100.0  # within this time
WATCHED_S = 0.5  # an event this long after an impact, before the next disturbance, belongs to it
MOTION_S = 0.1  # the motion that an impact causes starts within this time


class Impact(msgspec.Struct, frozen=True):
    """First sample of an impact, of the motion that it causes, and after its time."""

    start: int
    onset: int
    end: int
    moved_m: float
    weak: bool


def impacts_of(recording: Recording) -> list[Impact]:
    """All impacts in a recording's metadata, in the order of time."""
    listed = recording.metadata.disturbances if recording.metadata else ()
    t_s = recording.t_s - recording.t_s[0]
    starts_s = [one.t_s for one in listed] + [np.inf]
    impacts = []
    for one, next_s in zip(listed, starts_s[1:], strict=True):
        if one.kind not in KINDS:
            continue
        start, motion, end = np.searchsorted(
            t_s, [one.t_s, one.t_s + MOTION_S, min(next_s, one.t_s + WATCHED_S)], side="right"
        ).tolist()
        onset = start
        if recording.slip_true is not None and recording.slip_true[start:motion].any():
            onset += int(recording.slip_true[start:motion].argmax())
        if start < end:
            impacts.append(Impact(start, onset, end, one.moved_m, one.kind == WEAK))
    return impacts


class ImpactScore(msgspec.Struct, frozen=True):
    """Impacts by the lasting displacement of the object, and how many were registered."""

    moved: int  # 1 mm or more
    registered: int  # of these, before the next disturbance
    far: int  # 2 mm or more
    far_registered: int  # of these, within 100 ms of the first motion
    unmoved: int  # less than half a millimetre
    unmoved_registered: int
    unmoved_strong: int  # of `unmoved`, without the weak ones
    unmoved_strong_registered: int
    delay_ms: Quantiles | None  # of `moved`; infinite where missed

    def figures(self) -> dict[str, Figure]:
        """The numbers by name."""
        numbers = msgspec.structs.asdict(self)
        del numbers["delay_ms"]
        p50_ms = None if self.delay_ms is None else self.delay_ms.p50
        found = {f"impacts_{name}": Figure(number) for name, number in numbers.items()}
        return found | {"impact_delay_p50_ms": Figure(p50_ms)}


def impact_delays(registered: Events, impacts: Sequence[Impact], t_s: Floats) -> Floats:
    """Delay (k,), ms, from the onset of each impact to the first event; infinite if missed."""
    starts = registered[:, 0]
    at = np.searchsorted(starts, [impact.start for impact in impacts])
    first = np.append(starts, len(t_s))[at]
    detected = first < [impact.end for impact in impacts]
    delays: Floats = np.full(len(impacts), np.inf)
    onsets = np.array([impact.onset for impact in impacts], np.intp)
    delays[detected] = (t_s[first[detected]] - t_s[onsets[detected]]) * 1e3
    return delays


def impact_score(moved_m: Floats, delays_ms: Floats, weak: NDArray[np.bool_]) -> ImpactScore | None:
    """Score of impacts (k,) from displacements and delays; None without impacts."""
    if not len(moved_m):
        return None
    moved, far, unmoved = moved_m >= MOVED_M, moved_m >= FAR_M, moved_m < UNMOVED_M
    strong, detected = unmoved & ~weak, np.isfinite(delays_ms)
    return ImpactScore(
        moved=int(moved.sum()),
        registered=int((moved & detected).sum()),
        far=int(far.sum()),
        far_registered=int((far & (delays_ms <= SOON_MS)).sum()),
        unmoved=int(unmoved.sum()),
        unmoved_registered=int((unmoved & detected).sum()),
        unmoved_strong=int(strong.sum()),
        unmoved_strong_registered=int((strong & detected).sum()),
        delay_ms=quantiles(delays_ms[moved]),
    )
