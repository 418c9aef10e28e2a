"""A data set judged beside the real clip: one verdict for each of its parts."""

from collections.abc import Sequence
from typing import get_args

import msgspec

from detector.recordings import Recording
from scenarios.studies.signal.judge.pieces import Piece, piece_of, pieces
from scenarios.studies.signal.judge.telling_apart import Apart, State, tell_apart
from scenarios.studies.signal.judge.verdict import (
    Level,
    StatisticRow,
    SurfaceTrend,
    compare_pieces,
    levels,
    load_changes,
    surface_trends,
)

PLANE = "planar"  # the clip's surface, as far as its authors' list of surfaces tells


class Judgement(msgspec.Struct, frozen=True):
    """What one part of a data set is, beside the clip."""

    part: str
    recordings: int
    pieces: int
    statistics: list[StatisticRow]
    load_changes: dict[str, float | None]
    apart: dict[str, list[Apart]]  # by surfaces: all, and the plane alone
    levels: dict[str, list[Level]]
    surfaces: list[SurfaceTrend]


def clip_of(recording: Recording) -> Piece:
    """The real clip as one piece."""
    return piece_of(recording.counts[:, 0], recording.slip)


def by_part(recordings: Sequence[Recording]) -> dict[str, list[Recording]]:
    """Recordings by the part of their set; a set without parts has one without a name."""
    found: dict[str, list[Recording]] = {}
    for r in recordings:
        found.setdefault(r.metadata.part if r.metadata else "", []).append(r)
    return dict(sorted(found.items()))


def judge(
    clip: Piece, recordings: Sequence[Recording], part: str, seed: int = 0
) -> Judgement | None:
    """None where the set holds no strokes of one fingertip as long as the clip."""
    made = pieces(recordings)
    if not made:
        return None
    apart: dict[str, list[Apart]] = {}
    for name, chosen in (
        ("all surfaces", made), ("the plane", [p for p in made if p.surface == PLANE]),
    ):  # fmt: skip
        found = [tell_apart(clip, chosen, state, seed=seed) for state in get_args(State)]
        apart[name] = [a for a in found if a is not None]
    return Judgement(
        part, len({p.source for p in made}), len(made), compare_pieces(clip, made),
        load_changes(made), apart, dict(levels(made)), surface_trends(made),
    )  # fmt: skip


class Without(msgspec.Struct, frozen=True):
    """What a set's pieces are without one term: the clip's rank by statistic, and load changes."""

    term: str  # empty: with all of them
    ranks: dict[str, float]
    load_changes: dict[str, float | None]


def without(clip: Piece, recordings: Sequence[Recording], term: str) -> Without:
    """Ranks and load changes alone; the classifier would take as long as all the rest."""
    made = pieces(recordings)
    ranks = {row.name: row.percentile for row in compare_pieces(clip, made)}
    return Without(term, ranks, load_changes(made))
