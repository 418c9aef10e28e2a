"""Where the real clip lies among the pieces of a data set, statistic by statistic.

A set that is wide enough passes anything: beside the clip's percentile stands the width of the
set's 5-95 % band over that of the clip's own strokes.
"""

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.scores.quantiles import quantile
from scenarios.studies.signal.judge.figures import STATISTICS, Statistic, pause_changes, table
from scenarios.studies.signal.judge.pieces import Piece, around_each_stroke

LOW, HIGH = 5.0, 95.0  # percent: the band
MOST_WIDTH = 3.0  # of the band, over the clip's own
NORMAL_BAND = 3.29  # standard deviations between the two percentiles of a normal distribution
LEAST_STROKES = 3  # of the clip, to tell its own spread
LEAST_LOADED = 50.0  # counts, deviation of a taxel that carries load
LEVEL_FACTOR = 1.5
# The authors' configuration: counts a taxel over their whole set, and over the sphere alone.
AUTHORS_LEVELS = {
    "all surfaces": (
        (-120.24, -59.29, -14.26, -19.77, -55.34, -60.12),
        (182.70, 146.50, 80.06, 86.97, 140.52, 143.61),
    ),
    "sphere": ((-7.0, -66.0, -17.0, -16.0, -73.0, -7.0), (62.0, 168.0, 103.0, 94.0, 155.0, 75.0)),
}
# Grover et al. 2022, Table III: weighted F1 of their network, mean over a surface's motions, %.
AUTHORS_F1 = {"planar": 94.0, "sphere": 88.9, "cylinder-y": 88.0, "cylinder-x": 91.9}
Floats = NDArray[np.float64]


class StatisticRow(msgspec.Struct, frozen=True):
    """One statistic of the clip among those of a set's pieces."""

    name: str
    real: float
    low: float  # 5 % of the pieces lie below
    median: float
    high: float
    percentile: float  # of the clip among the pieces; ties count half
    width: float | None  # of the band over the clip's own; None: the clip cannot tell its own

    @property
    def inside(self) -> bool:
        return LOW <= self.percentile <= HIGH

    @property
    def narrow(self) -> bool:
        return self.width is None or self.width <= MOST_WIDTH


def compare_pieces(real: Piece, made: Sequence[Piece]) -> list[StatisticRow]:
    """Every statistic that clip and pieces have."""
    clip, own = table([real]), table(list(around_each_stroke(real)))
    of = table(made)
    rows = []
    for s in STATISTICS:
        values = np.sort(of[s.name][np.isfinite(of[s.name])])
        value = float(clip[s.name][0])
        if not np.isfinite(value) or not len(values):
            continue
        low, median, high = (quantile(values, share / 100.0) for share in (LOW, 50.0, HIGH))
        below = float((values < value).mean() + 0.5 * (values == value).mean())
        width = _width(s, own[s.name], low, high)
        rows.append(StatisticRow(s.name, value, low, median, high, 100.0 * below, width))
    return rows


def _width(s: Statistic, own: Floats, low: float, high: float) -> float | None:
    own = own[np.isfinite(own)]
    if len(own) < LEAST_STROKES:
        return None
    own_width = NORMAL_BAND * float(s.scale(own).std(ddof=1))
    ends = s.scale(np.array([low, high]))
    return float(ends[1] - ends[0]) / own_width if own_width > 0.0 else None


def shares_inside(rows: Sequence[StatisticRow]) -> dict[str, tuple[int, int, int]]:
    """Of each group: statistics inside the band, of these those of a narrow band, and all."""
    found: dict[str, tuple[int, int, int]] = {}
    for row in rows:
        group = row.name.split(":")[0]
        inside, narrow, all_of = found.get(group, (0, 0, 0))
        found[group] = (
            inside + row.inside, narrow + (row.inside and row.narrow), all_of + 1,
        )  # fmt: skip
    return found


def load_changes(made: Sequence[Piece]) -> dict[str, float | None]:
    """Median change of the load from pause to pause, counts, over the recordings' pieces: of all,
    and of strokes along and not along the finger (nothing of those that turn)."""

    def median(chosen: Sequence[Piece]) -> float | None:
        changes = [pause_changes(p) for p in chosen]
        return float(np.median(np.concatenate(changes))) if changes else None

    return {
        "all": median(made),
        "along the finger": median([p for p in made if p.along]),
        "other strokes": median([p for p in made if p.along is False]),
        "turning": median([p for p in made if p.along is None]),
    }


class SurfaceTrend(msgspec.Struct, frozen=True):
    """One surface: counts, mean over the taxels; how well slip and rest are told apart by the size
    of increments (AUC, median of the pieces), beside how well the authors' network did there."""

    surface: str
    mean: float
    std: float
    auc: float
    authors_f1: float | None


def surface_trends(made: Sequence[Piece]) -> list[SurfaceTrend]:
    """In the order of the paper's table, others after it."""
    order = [*AUTHORS_F1, *sorted({p.surface for p in made} - set(AUTHORS_F1))]
    found = []
    for surface in order:
        chosen = [p for p in made if p.surface == surface]
        if not chosen:
            continue
        counts = np.concatenate([p.counts for p in chosen])
        aucs = np.sort([x for x in table(chosen)["slip: AUC"] if np.isfinite(x)])
        found.append(
            SurfaceTrend(
                surface, float(counts.mean()), float(counts.std(axis=0).mean()),
                quantile(aucs, 0.5) if len(aucs) else np.nan, AUTHORS_F1.get(surface),
            )
        )  # fmt: skip
    return found


class Level(msgspec.Struct, frozen=True):
    """Counts of one taxel beside the authors'."""

    mean: float
    std: float
    authors_mean: float
    authors_std: float

    @property
    def loaded(self) -> bool:
        return self.authors_std >= LEAST_LOADED

    @property
    def near(self) -> bool:
        """Deviation within the factor; the mean within that factor, or by the authors' deviation
        no further than the factor allows (a mean near zero has no factor)."""
        slack = (LEVEL_FACTOR - 1.0) * self.authors_std
        away = abs(self.mean - self.authors_mean)
        ratio = self.std / self.authors_std
        return 1 / LEVEL_FACTOR <= ratio <= LEVEL_FACTOR and away <= slack


def levels(made: Sequence[Piece]) -> Mapping[str, list[Level]]:
    """By surface that the authors tell of; nothing for pads of another layout."""
    found: dict[str, list[Level]] = {}
    for surface, (means, stds) in AUTHORS_LEVELS.items():
        chosen = [p.counts for p in made if surface in ("all surfaces", p.surface)]
        if not chosen or chosen[0].shape[1] != len(means):
            continue
        counts = np.concatenate(chosen)
        rows = zip(counts.mean(axis=0), counts.std(axis=0), means, stds, strict=True)
        found[surface] = [Level(float(m), float(s), am, astd) for m, s, am, astd in rows]
    return found
