"""What a decision rule makes of blows: those that moved what is held, and those that did not."""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.blows import MOVED_M, UNMOVED_M, Blow
from detector.scores.events import Events
from detector.scores.metrics import Floats
from detector.scores.quantiles import Quantiles, quantiles

FAR_M = 0.002  # who was moved so far is expected to be registered,
SOON_MS = 100.0  # and within this


class BlowScore(msgspec.Struct, frozen=True):
    """Blows by how far they moved what is held, for good, and which of them were registered."""

    moved: int  # 1 mm or more
    registered: int  # of these, before the next act
    far: int  # 2 mm or more
    far_registered: int  # of these, within 100 ms of the first motion
    unmoved: int  # within half a millimetre
    unmoved_registered: int
    nearly: int  # of `unmoved`, those that were not struck weakly
    nearly_registered: int
    delay_ms: Quantiles | None  # of `moved`; infinite where missed


def answers(registered: Events, blows: Sequence[Blow], t_s: Floats) -> Floats:
    """Time (k,) from the first motion of each blow to the event that begins before the next act,
    ms; infinite where none does."""
    starts = registered[:, 0]
    at = np.searchsorted(starts, [b.struck for b in blows])
    first = np.append(starts, len(t_s))[at]
    heard = first < [b.until for b in blows]
    delays: Floats = np.full(len(blows), np.inf)
    onsets = np.array([b.onset for b in blows], np.intp)
    delays[heard] = (t_s[first[heard]] - t_s[onsets[heard]]) * 1e3
    return delays


def blow_score(moved_m: Floats, delays_ms: Floats, weak: NDArray[np.bool_]) -> BlowScore | None:
    """The score of blows (k,) with these answers; None of none."""
    if not len(moved_m):
        return None
    moved, far, unmoved = moved_m >= MOVED_M, moved_m >= FAR_M, moved_m < UNMOVED_M
    nearly, heard = unmoved & ~weak, np.isfinite(delays_ms)
    return BlowScore(
        moved=int(moved.sum()),
        registered=int((moved & heard).sum()),
        far=int(far.sum()),
        far_registered=int((far & (delays_ms <= SOON_MS)).sum()),
        unmoved=int(unmoved.sum()),
        unmoved_registered=int((unmoved & heard).sum()),
        nearly=int(nearly.sum()),
        nearly_registered=int((nearly & heard).sum()),
        delay_ms=quantiles(delays_ms[moved]),
    )


def within(blows: Sequence[Blow], samples: int) -> NDArray[np.bool_]:
    """(n,) samples that belong to a blow."""
    found = np.zeros(samples, np.bool_)
    for blow in blows:
        found[blow.struck : blow.until] = True
    return found
