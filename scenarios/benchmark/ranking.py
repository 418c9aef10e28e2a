"""Rows of a benchmark by score, each with its difference to the first."""

import msgspec

from detector.scores.figures import Figure
from scenarios.benchmark.quality import BUDGET_PER_MIN, halves_agree, interval, scores
from scenarios.benchmark.score_file import DetectorScores, Point, ScoreFile

OWN, BEST = "own rule", "best threshold"


class Row(msgspec.Struct, frozen=True):
    """A detector with its own rule or its best threshold. ``behind``: score of the first less its
    own; undefined in the first."""

    of: DetectorScores
    point: Point
    note: str
    behind: Figure

    @property
    def name(self) -> str:
        return f"{self.of.detector}, {self.note}"


def ranked(file: ScoreFile) -> list[Row]:
    """All rows of a benchmark, the best first."""
    rows = [(d, p) for d in file.detectors for p in d.rows]
    rows.sort(key=lambda row: -(row[1].score.value or 0.0))
    made: list[Row] = []
    for each, point in rows:
        behind = Figure(None) if not made else difference(file, made[0].point, point)
        made.append(Row(each, point, _note(each, point), behind))
    return made


def _note(each: DetectorScores, p: Point) -> str:
    if p is not each.best:
        return OWN
    note = f"{BEST} {p.threshold:.3g}"
    if p == each.point:
        note = f"{OWN} and {note}"
    rate = p.false_per_min.value or 0.0
    return note if rate <= BUDGET_PER_MIN else f"{note} (above {BUDGET_PER_MIN:g} false alarm/min)"


def difference(file: ScoreFile, one: Point, other: Point) -> Figure:
    """Score of one row less that of another, paired."""
    a, b = (scores(p.trials, *file.ends) for p in (one, other))
    return interval(a - b)


def runner_up(rows: list[Row]) -> Row | None:
    """The best row of another detector than the first's."""
    return next((row for row in rows if row.of is not rows[0].of), None)


def halves(file: ScoreFile) -> str:
    """Whether two halves of the trials give the same order."""
    rows = ranked(file)
    pairs = halves_agree([row.point.trials for row in rows], *file.ends)
    alike = sum(same for *_, same in pairs)
    return f"Two halves of the trials order {alike} of {len(pairs)} resolved pairs of rows alike."
