"""Summary of a campaign as in the paper's table IV: rates with intervals, latencies, slip."""

import math
from collections import Counter
from collections.abc import Sequence

import msgspec

from detector.scores.quantiles import Quantiles, quantiles
from scenarios.campaign.worker import Row
from scenarios.lift.scoring import LiftOutcome

NEAR, FAR = LiftOutcome.HELD_WITHIN_6CM.value, LiftOutcome.HELD_WITHIN_12CM.value
TRIALS = 20
Z_95 = 1.959964


class PaperCell(msgspec.Struct, frozen=True):
    """Successes out of twenty (paper, table IV); lifts of long objects are split at 6 and 12 cm."""

    tap: int
    near: int  # lift, within 6 cm; for other objects: held
    far: int = 0  # lift, 6 to 12 cm

    @property
    def lift(self) -> int:
        return self.near + self.far


TABLE_IV = {
    "ball": PaperCell(18, 7),
    "box": PaperCell(17, 20),
    "cardboard": PaperCell(18, 9, 8),
    "football": PaperCell(18, 17),
    "foam": PaperCell(16, 7),
    "can": PaperCell(18, 15, 4),
}
LONG = ("box", "cardboard", "can")


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """One object in one variant.

    Quantiles are over all trials in which the object slipped; an event that did not happen, or the
    slip of a lost object, counts as infinite. None where no object slipped."""

    object: str
    trials: int  # of taps: those that moved the object
    errors: int
    successes: int
    interval: tuple[float, float]  # Wilson, 95 %
    within_6cm: int | None  # lifts of long objects only
    within_12cm: int | None
    outcomes: dict[str, int]
    excluded: dict[str, int]  # outcomes outside the rate: taps without displacement, or never made
    alarms_stayed: int  # successful lifts with slip registered at the end of the hold
    detection_latency_ms: Quantiles | None
    reaction_latency_ms: Quantiles | None
    nominal_again_ms: Quantiles | None  # after the end of motion; taps
    slip_distance_mm: Quantiles | None
    turned_deg: Quantiles | None  # absolute rotation in the hand
    paused_s: Quantiles | None  # stops of the arm to respond to slip

    @property
    def rate(self) -> float:
        return self.successes / self.trials if self.trials else math.nan

    @property
    def rate_of_all(self) -> float:
        """Success rate of all trials with a verdict, with the excluded ones as failures."""
        judged = self.trials + sum(self.excluded.values())
        return self.successes / judged if judged else math.nan


class Variant(msgspec.Struct, frozen=True, kw_only=True):
    """One column of the table: scenario, profile, detector and swept values."""

    scenario: str
    profile: str
    detector: str
    swept: str
    cells: list[Cell]
    average: float
    average_of_all: float  # with excluded trials as failures


class Summary(msgspec.Struct, frozen=True):
    """Summary of a campaign."""

    name: str
    trials: int
    errors: int
    first_error: str  # its last line
    cpu_s: float
    variants: list[Variant]
    versions: list[str]


def summarize(name: str, rows: Sequence[Row]) -> Summary:
    """Group the rows by variant, in the order in which they first appear."""
    groups: dict[tuple[str, str, str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.scenario, row.profile, row.detector, row.swept), []).append(row)
    return Summary(
        name=name,
        trials=len(rows),
        errors=sum(row.status == "error" for row in rows),
        first_error=next((row.error.strip().rpartition("\n")[2] for row in rows
                          if row.status == "error" and row.error), ""),
        cpu_s=round(sum(row.cpu_s or 0.0 for row in rows), 1),
        variants=[_variant(key, group) for key, group in groups.items()],
        versions=sorted({row.versions for row in rows if row.versions}),
    )  # fmt: skip


def _variant(key: tuple[str, str, str, str], rows: Sequence[Row]) -> Variant:
    scenario = key[0]
    by_object: dict[str, list[Row]] = {}
    for row in rows:
        by_object.setdefault(row.object, []).append(row)
    cells = [_cell(scenario, name, group) for name, group in by_object.items()]
    return Variant(
        scenario=scenario, profile=key[1], detector=key[2], swept=key[3], cells=cells,
        average=sum(cell.rate for cell in cells if cell.trials) / max(1, len(cells)),
        average_of_all=sum(c.rate_of_all for c in cells if c.outcomes) / max(1, len(cells)),
    )  # fmt: skip


def _cell(scenario: str, name: str, rows: Sequence[Row]) -> Cell:
    ran = [row for row in rows if row.status == "done"]
    done = ran if scenario == "lift" else [row for row in ran if row.moved]
    successes = sum(bool(row.success) for row in done)
    outcomes, counted = _outcomes(ran), {row.trial for row in done}
    split = scenario == "lift" and name in LONG
    turned_deg = [_unless_lost(r, r.turned_rad, 180 / math.pi) for r in done]
    return Cell(
        object=name,
        trials=len(done),
        errors=len(rows) - len(ran),
        successes=successes,
        interval=wilson(successes, len(done)),
        within_6cm=outcomes.get(NEAR, 0) if split else None,
        within_12cm=outcomes.get(FAR, 0) if split else None,
        outcomes=outcomes,
        excluded=_outcomes([row for row in ran if row.trial not in counted]),
        alarms_stayed=sum(bool(row.success and row.alarm_stayed) for row in done),
        detection_latency_ms=_simulated(
            [_after_onset(r, r.detection_latency_ms) for r in done], done
        ),
        reaction_latency_ms=_simulated(
            [_after_onset(r, r.reaction_latency_ms) for r in done], done
        ),
        nominal_again_ms=quantiles([row.nominal_again_ms for row in done]),
        slip_distance_mm=quantiles([_unless_lost(r, r.slip_distance_m, 1e3) for r in done]),
        turned_deg=_simulated([None if t is None else abs(t) for t in turned_deg], done),
        paused_s=quantiles([row.paused_s for row in done]),
    )


def _outcomes(rows: Sequence[Row]) -> dict[str, int]:
    """Number of trials by outcome, most frequent first."""
    return dict(Counter(str(row.outcome) for row in rows).most_common())


def _simulated(figures: Sequence[float | None], rows: Sequence[Row]) -> Quantiles | None:
    """Quantiles of a value that only a simulation knows, one per row; None on real devices. A value
    of None is an event that did not happen."""
    both = zip(figures, rows, strict=True)
    # a row with true forces is from a simulation
    known = [v for v, row in both if v is not None or row.peak_force_n is not None]
    return quantiles(known) if known else None


def _after_onset(row: Row, latency_ms: float | None) -> float | None:
    """The latency; None for an alarm before any slip, which did not detect it."""
    return None if row.outcome == LiftOutcome.FALSE_START else latency_ms


def _unless_lost(row: Row, value: float | None, factor: float) -> float | None:
    """The value times ``factor``; None for a lifted object that was lost."""
    lost = row.scenario == "lift" and not row.success
    return None if value is None or lost else factor * value


def paper_rate(scenario: str, name: str) -> float | None:
    """The paper's success rate of an object; None for other objects."""
    cell = TABLE_IV.get(name)
    if cell is None:
        return None
    return (cell.tap if scenario == "tap" else cell.lift) / TRIALS


def wilson(successes: int, n: int) -> tuple[float, float]:
    """95 % score interval of a proportion (Wilson 1927); 0 to 1 without trials."""
    if n == 0:
        return 0.0, 1.0
    p, z2 = successes / n, Z_95**2
    middle = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = Z_95 / (1 + z2 / n) * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    return max(0.0, middle - half), min(1.0, middle + half)
