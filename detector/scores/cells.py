"""Table III: weighted F1 by motion, speed and surface with its averages, and what the paper says
of them, each with a 95 % interval by bootstrap over the recordings of a cell.

Averages are means of cells, each as heavy as any other. A statement of the paper is a list of
differences of such means that it says are above zero. It holds if all their intervals lie above
zero, does not if one lies below, and is not resolved otherwise.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings
from detector.recordings import Recording
from detector.scores.evaluation import (
    WARM_UP_SAMPLES,
    Streamed,
    events_by_label,
    judge_stream,
    spoken,
)
from detector.scores.intervals import HIGH, LOW, Interval
from detector.scores.metrics import Floats, confusion
from detector.scores.quantiles import Quantiles, quantile, quantiles
from drivers.errors import UsageError

Row = tuple[str, float]  # motion and commanded speed, m/s; 0 of a rotation
Key = tuple[str, float, str]  # and surface
Verdict = Literal["holds", "does not", "not resolved"]

SURFACES = ("planar", "sphere", "cylinder-y", "cylinder-x")
SPEEDS_MPS = (0.05, 0.075, 0.1)
ROTATION: Row = ("rotation", 0.0)
ROWS: tuple[Row, ...] = (
    *(("primary", speed) for speed in SPEEDS_MPS),
    *(("oblique", speed) for speed in SPEEDS_MPS),
    ROTATION,
)
LEAST_RECORDINGS = 5
RESAMPLES = 2000


class Estimate(msgspec.Struct, frozen=True):
    """A figure and its 95 % interval."""

    value: float
    interval: Interval


class Cell(msgspec.Struct, frozen=True):
    """Recordings of one motion, speed and surface."""

    motion: str
    speed_mps: float
    surface: str
    recordings: int
    f1: Estimate  # weighted
    delay_ms: Quantiles | None  # from the label's rise, by the rule; infinite where missed
    slips: int
    missed: int


class Statement(msgspec.Struct, frozen=True):
    """One of the paper's, and what becomes of it."""

    text: str
    verdict: Verdict
    differences: dict[str, Estimate]


class CellTable(msgspec.Struct, frozen=True):
    """Table III of one detector."""

    detector: str
    cells: list[Cell]
    of_rows: list[Estimate]  # means over surfaces, in the order of ROWS
    of_surfaces: list[Estimate]  # means over motions and speeds, in the order of SURFACES
    statements: list[Statement]


class Resampled(msgspec.Struct, frozen=True, eq=False):
    """F1 of every cell as it is, and as often drawn anew."""

    whole: dict[Key, float]
    drawn: dict[Key, Floats]  # (RESAMPLES,) each

    def mean(self, wanted: Callable[[Key], bool]) -> "Drawn":
        """Of the cells that are wanted."""
        keys = [key for key in self.whole if wanted(key)]
        return Drawn(
            float(np.mean([self.whole[key] for key in keys])),
            np.mean([self.drawn[key] for key in keys], axis=0),
        )


class Drawn(msgspec.Struct, frozen=True, eq=False):
    """A figure, and the same of every draw (RESAMPLES,)."""

    value: float
    draws: Floats

    def __sub__(self, other: "Drawn") -> "Drawn":
        return Drawn(self.value - other.value, self.draws - other.draws)

    @property
    def estimate(self) -> Estimate:
        ordered = np.sort(self.draws)
        return Estimate(self.value, (quantile(ordered, LOW), quantile(ordered, HIGH)))


def cell_table(
    detector: str, threshold: float, rule: RuleSettings, streams: Sequence[Streamed], seed: int = 0
) -> CellTable:
    """Score every cell. Raises UsageError as `require_cells` does."""
    require_cells([s.recording for s in streams])
    groups = _groups(streams)
    f1 = _resampled(groups, threshold, rule, np.random.default_rng(seed))
    return CellTable(
        detector=detector,
        cells=[_cell(key, groups[key], f1, rule) for key in _keys()],
        of_rows=[f1.mean(lambda k, row=row: k[:2] == row).estimate for row in ROWS],  # type: ignore[misc]
        of_surfaces=[f1.mean(lambda k, s=s: k[2] == s).estimate for s in SURFACES],  # type: ignore[misc]
        statements=statements(f1),
    )


def require_cells(recordings: Sequence[Recording]) -> None:
    """Raises UsageError where a cell has fewer than LEAST_RECORDINGS."""
    held = Counter(_key(recording) for recording in recordings)
    few = [key for key in _keys() if held[key] < LEAST_RECORDINGS]
    if few:
        raise UsageError(
            f"{len(few)} of {len(_keys())} cells have fewer than {LEAST_RECORDINGS} recordings",
            "a whole set built for it: `grasp dataset build paper --seed N`",
        )


def _keys() -> list[Key]:
    return [(*row, surface) for row in ROWS for surface in SURFACES]


def _key(recording: Recording) -> Key | None:
    """The cell that it is of; None: of none."""
    known = recording.metadata
    if known is None or known.set != "slide":
        return None
    return str(known.motion), round(known.speed_mps, 3), known.surface


def _groups(streams: Sequence[Streamed]) -> dict[Key, list[Streamed]]:
    found: dict[Key, list[Streamed]] = {}
    for s in streams:
        if (key := _key(s.recording)) is not None:
            found.setdefault(key, []).append(s)
    return found


def _resampled(
    groups: dict[Key, list[Streamed]], threshold: float, rule: RuleSettings,
    rng: np.random.Generator,
) -> Resampled:  # fmt: skip
    whole, drawn = {}, {}
    for key in _keys():
        counts = np.array([_counts(s, threshold, rule) for s in groups[key]])
        whole[key] = float(weighted_f1(counts.sum(axis=0)))
        chosen = rng.integers(0, len(counts), (RESAMPLES, len(counts)))
        drawn[key] = weighted_f1(counts[chosen].sum(axis=1))
    return Resampled(whole, drawn)


def _counts(s: Streamed, threshold: float, rule: RuleSettings) -> tuple[int, int, int, int]:
    c = confusion(spoken(s, rule)[WARM_UP_SAMPLES:] > threshold, s.labels[WARM_UP_SAMPLES:])
    return c.static_static, c.static_slip, c.slip_static, c.slip_slip


def weighted_f1(counts: NDArray[np.intp]) -> Floats:
    """(...) of counts (..., 4): static called static and slip, slip called static and slip."""
    quiet, false, missed, heard = (counts[..., i].astype(np.float64) for i in range(4))
    errors = false + missed
    of_static = 2 * quiet / np.maximum(2 * quiet + errors, 1.0)
    of_slip = 2 * heard / np.maximum(2 * heard + errors, 1.0)
    static, slip = quiet + false, missed + heard
    mean: Floats = (static * of_static + slip * of_slip) / np.maximum(static + slip, 1.0)
    return mean


def _cell(key: Key, group: Sequence[Streamed], f1: Resampled, rule: RuleSettings) -> Cell:
    judged = [
        judge_stream(s, rule, events_by_label(s.label), WARM_UP_SAMPLES, ()).events for s in group
    ]
    delays = np.concatenate([j.delays_ms for j in judged])
    return Cell(
        *key, recordings=len(group), f1=f1.mean(lambda k: k == key).estimate,
        delay_ms=quantiles(delays), slips=len(delays), missed=sum(j.missed for j in judged),
    )  # fmt: skip


def statements(f1: Resampled) -> list[Statement]:
    """The paper's five (section V-B), in its order."""

    def on(surface: str) -> Drawn:
        return f1.mean(lambda k: k[2] == surface)

    def of(motion: str) -> Drawn:
        return f1.mean(lambda k: k[0] == motion)

    def at(speed: float) -> Drawn:
        return f1.mean(lambda k: k[1] == speed)

    slowest, *_, fastest = SPEEDS_MPS
    translation = f1.mean(lambda k: k[:2] != ROTATION)
    return [
        _statement("planar is better than sphere and cylinder along y", {
            "planar - sphere": on("planar") - on("sphere"),
            "planar - cylinder-y": on("planar") - on("cylinder-y"),
        }),
        _statement("a cylinder is better along x than along y", {
            "cylinder-x - cylinder-y": on("cylinder-x") - on("cylinder-y"),
        }),
        _statement("faster is better", {"10 - 5 cm/s": at(fastest) - at(slowest)}),
        _statement("oblique is better than primary", {
            "oblique - primary": of("oblique") - of("primary"),
        }),
        _statement("rotation is worst", {"translation - rotation": translation - of("rotation")}),
    ]  # fmt: skip


def _statement(text: str, differences: dict[str, Drawn]) -> Statement:
    found = {name: d.estimate for name, d in differences.items()}
    return Statement(text, _verdict(list(found.values())), found)


def _verdict(differences: Sequence[Estimate]) -> Verdict:
    if any(d.interval[1] < 0.0 for d in differences):
        return "does not"
    return "holds" if all(d.interval[0] > 0.0 for d in differences) else "not resolved"
