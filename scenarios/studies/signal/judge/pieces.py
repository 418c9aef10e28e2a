"""Pieces of recordings, as long as the real clip, and the strokes and pauses within them."""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import Recording

PIECE_SAMPLES = 416  # of the authors' clip, 4.2 s
LEAST_STROKE, LEAST_PAUSE = 15, 12  # samples; shorter runs of a label are no stroke, no pause
LEAST_PAUSES = 3  # of a piece: two changes of load, and one between strokes of equal direction
Floats = NDArray[np.float64]
Kind = Literal["stroke", "pause"]


class Run(msgspec.Struct, frozen=True):
    """Neighbouring samples of equal label: first to end (exclusive)."""

    kind: Kind
    first: int
    end: int

    @property
    def samples(self) -> int:
        return self.end - self.first


class Piece(msgspec.Struct, frozen=True, eq=False):
    """A stretch of one fingertip's recording with its strokes and pauses, in their order."""

    counts: Floats  # (n, taxels), over rest
    slip: NDArray[np.bool_]  # (n,)
    runs: tuple[Run, ...]
    source: int = 0  # which recording it is of
    along: bool | None = None  # strokes along the finger; None: turning, or unknown
    surface: str = ""

    def of(self, kind: Kind) -> list[Floats]:
        """Counts (m, taxels) of each stroke or pause."""
        return [self.counts[r.first : r.end] for r in self.runs if r.kind == kind]


def piece_of(
    counts: NDArray[np.int16] | Floats, slip: NDArray[np.bool_], source: int = 0,
    along: bool | None = None, surface: str = "",
) -> Piece:  # fmt: skip
    """A piece of counts (n, taxels) and labels (n,)."""
    return Piece(counts.astype(np.float64), slip, runs_of(slip), source, along, surface)


def runs_of(slip: NDArray[np.bool_]) -> tuple[Run, ...]:
    """Strokes and pauses long enough to be called so; shorter ones are left out."""
    edges = np.flatnonzero(slip[1:] != slip[:-1]) + 1
    bounds = [0, *edges.tolist(), len(slip)]
    found = []
    for first, end in pairwise(bounds):
        kind: Kind = "stroke" if slip[first] else "pause"
        if end - first >= (LEAST_STROKE if kind == "stroke" else LEAST_PAUSE):
            found.append(Run(kind, first, end))
    return tuple(found)


def pieces(recordings: Iterable[Recording]) -> list[Piece]:
    """Consecutive pieces of all stroked recordings of one fingertip; those with too few pauses
    (a stroke that outlasts the piece, say) are left out."""
    found: list[Piece] = []
    for source, r in enumerate(recordings):
        if r.fingers != 1 or r.metadata is None or r.metadata.set != "slide":
            continue
        m = r.metadata
        along = int(m.direction) % 180 == 0 if m.direction.isdigit() else None
        if len(r.slip) >= PIECE_SAMPLES:
            for first in range(0, len(r.slip) - PIECE_SAMPLES + 1, PIECE_SAMPLES):
                cut = slice(first, first + PIECE_SAMPLES)
                made = piece_of(r.counts[cut, 0], r.slip[cut], source, along, m.surface)
                if len(made.of("pause")) >= LEAST_PAUSES and len(made.of("stroke")) >= 2:
                    found.append(made)
    return found


def around_each_stroke(piece: Piece) -> Iterator[Piece]:
    """The piece once for each stroke that has a pause on either side, cut to these three: what
    its statistics are from stroke to stroke."""
    for before, stroke, after in zip(piece.runs, piece.runs[1:], piece.runs[2:], strict=False):
        if (before.kind, stroke.kind, after.kind) == ("pause", "stroke", "pause"):
            cut = slice(before.first, after.end)
            yield piece_of(piece.counts[cut], piece.slip[cut], piece.source, piece.along)
