"""Rows of a benchmark by score, each with its difference to the first."""

import msgspec

from detector.scores.figures import Figure
from scenarios.benchmark.quality import BUDGET_PER_MIN, halves_agree, interval, scores
from scenarios.benchmark.score_file import DetectorScores, Point, ScoreFile

OWN, BEST = "own rule", "best threshold"


class Row(msgspec.Struct, frozen=True):
    """A detector with its own rule or its best threshold. ``behind``: score of the first less its
    own, paired."""

    of: DetectorScores
    point: Point
    note: str
    behind: Figure

    @property
    def name(self) -> str:
        return f"{self.of.detector}, {self.note}"


def ranked(file: ScoreFile) -> list[Row]:
    """All rows of a benchmark, the best first."""
    rows = [(d, p, scores(p.trials, *file.ends)) for d in file.detectors for p in d.rows]
    rows.sort(key=lambda row: -row[2][0])
    return [Row(d, p, _note(d, p), interval(rows[0][2] - drawn)) for d, p, drawn in rows]


def _note(each: DetectorScores, p: Point) -> str:
    if p is not each.best:
        return OWN
    note = f"{BEST} {p.threshold:.4g}"
    if p == each.point:
        note = f"{OWN} and {note}"
    rate = p.false_per_min.value or 0.0
    return note if rate <= BUDGET_PER_MIN else f"{note} (above {BUDGET_PER_MIN:g} false alarm/min)"


def halves(file: ScoreFile) -> str:
    """Whether two halves of the trials give the same order."""
    rows = ranked(file)
    pairs = halves_agree([row.point.trials for row in rows], *file.ends)
    alike = sum(same for *_, same in pairs)
    return f"Two halves of the trials order {alike} of {len(pairs)} resolved pairs of rows alike."
