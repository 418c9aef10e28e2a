"""What a data set holds, beside Table I of the paper."""

from collections import Counter
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import Recording
from detector.scores.evaluation import cause_of
from detector.scores.quantiles import quantile

LEAST_REST_CODE = 400
PLATEAU = 3
SURFACES = ("planar", "sphere", "cylinder-y", "cylinder-x")
# Grover et al. 2022, Table I: percent of the samples, surfaces as above; speeds in m/s or rad/s.
PAPER_TABLE: dict[tuple[str, float], tuple[float, float, float, float]] = {
    ("primary", 0.05): (5.3, 3.7, 3.5, 3.6),
    ("primary", 0.075): (4.5, 4.7, 3.7, 3.7),
    ("primary", 0.1): (4.8, 4.7, 3.3, 3.2),
    ("oblique", 0.05): (4.9, 3.3, 3.3, 3.3),
    ("oblique", 0.075): (3.5, 4.2, 3.5, 3.4),
    ("oblique", 0.1): (3.9, 4.2, 3.0, 3.1),
    ("rotation", 1.0): (3.8, 1.2, 1.5, 1.2),
}
PAPER_STATIC, PAPER_SLIP = 143_584, 122_918


class TableCell(msgspec.Struct, frozen=True):
    """One group of Table I: percent of the data set's samples, and of the paper's."""

    motion: str
    speed: float  # m/s, of a rotation rad/s
    surface: str
    samples: int
    slip: int
    percent: float
    paper_percent: float | None


class Kind(msgspec.Struct, frozen=True):
    """Recordings of one cause, or of strokes (`slide`)."""

    recordings: int
    samples: int
    slip: float  # share of the samples, and of those that have moved 1 mm since they last rested
    moved: float | None
    at_rail: float  # share of the counts of a taxel pressed as far down as it ever reads


class DatasetFigures(msgspec.Struct, frozen=True):
    """A data set in figures."""

    recordings: int
    samples: int
    static: int
    slip: int
    slip_true: int | None
    moved: int | None  # samples 1 mm or more from where they last rested
    labels_agree: float | None  # share of samples with equal labels
    splits: dict[str, int]  # samples
    kinds: dict[str, Kind]
    speed_p50_mps: float | None  # of the fingertip, where it is labelled slip
    speed_p99_mps: float | None
    table: list[TableCell]


def describe(recordings: Sequence[Recording]) -> DatasetFigures:
    """Figures of recordings that are not empty."""
    samples = sum(len(r.slip) for r in recordings)
    slip = sum(int(r.slip.sum()) for r in recordings)
    true = [r.slip_true for r in recordings if r.slip_true is not None]
    known = len(true) == len(recordings)
    agreed = sum(int((r.slip == r.slip_true).sum()) for r in recordings) if known else 0
    placed = all(r.moved_m is not None for r in recordings)
    speeds = np.sort(_speeds(recordings))
    return DatasetFigures(
        recordings=len(recordings),
        samples=samples,
        static=samples - slip,
        slip=slip,
        slip_true=sum(int(label.sum()) for label in true) if known else None,
        moved=sum(int(r.label("moved").sum()) for r in recordings) if placed else None,
        labels_agree=agreed / samples if known else None,
        splits=_splits(recordings),
        kinds=_kinds(recordings),
        speed_p50_mps=quantile(speeds, 0.5) if len(speeds) else None,
        speed_p99_mps=quantile(speeds, 0.99) if len(speeds) else None,
        table=_table(recordings, samples),
    )


def _splits(recordings: Sequence[Recording]) -> dict[str, int]:
    counts: Counter[str] = Counter()
    for r in recordings:
        if r.metadata is not None:
            counts[r.metadata.split] += len(r.slip)
    return dict(sorted(counts.items()))


def _kinds(recordings: Sequence[Recording]) -> dict[str, Kind]:
    groups: dict[str, list[Recording]] = {}
    for r in recordings:
        groups.setdefault(cause_of(r), []).append(r)
    return {name: _kind(group) for name, group in sorted(groups.items())}


def _kind(group: Sequence[Recording]) -> Kind:
    samples = sum(len(r.slip) for r in group)
    known = all(r.moved_m is not None for r in group)
    railed = [at_rail(r.counts) for r in group]
    return Kind(
        len(group), samples, sum(int(r.slip.sum()) for r in group) / samples,
        sum(int(r.label("moved").sum()) for r in group) / samples if known else None,
        sum(int(x.sum()) for x in railed) / sum(x.size for x in railed),
    )  # fmt: skip


def at_rail(counts: NDArray[np.int16]) -> NDArray[np.bool_]:
    """Of counts (n, fingers, taxels): at code 0, told by its plateau: rest codes are 420 to 480, so
    a taxel that is down there again and again reads its least value, one that merely was pressed
    hardest reads it once."""
    least = counts.min(axis=0)
    found = (counts == least) & (least <= -LEAST_REST_CODE)
    out: NDArray[np.bool_] = found & (found.sum(axis=0) >= PLATEAU)
    return out


def _speeds(recordings: Sequence[Recording]) -> np.ndarray:
    speeds = [
        np.hypot(r.velocity_mps[:, 0], r.velocity_mps[:, 1])[r.slip]
        for r in recordings
        if r.velocity_mps is not None and r.metadata and r.metadata.motion in ("primary", "oblique")
    ]
    return np.concatenate(speeds) if speeds else np.zeros(0)


def _table(recordings: Sequence[Recording], samples: int) -> list[TableCell]:
    groups: dict[tuple[str, float, str], list[Recording]] = {}
    for r in recordings:
        if (m := r.metadata) is not None and m.set == "slide":
            key = (m.motion, m.speed_mps or m.spin_radps, m.surface)
            groups.setdefault(key, []).append(r)
    rows = [(row, surface) for row in PAPER_TABLE for surface in SURFACES]
    order = {(*row, surface): i for i, (row, surface) in enumerate(rows)}
    cells = []
    for kind, speed, surface in sorted(groups, key=lambda key: (order.get(key, len(order)), key)):
        group = groups[kind, speed, surface]
        n = sum(len(r.slip) for r in group)
        slip = sum(int(r.slip.sum()) for r in group)
        percent = dict(zip(SURFACES, PAPER_TABLE.get((kind, speed), ()), strict=False))
        cells.append(
            TableCell(kind, speed, surface, n, slip, 100.0 * n / samples, percent.get(surface))
        )
    return cells
