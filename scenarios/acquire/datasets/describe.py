"""What a data set holds, beside Table I of the paper and the authors' statistics a taxel."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import Act, Recording
from detector.scores.evaluation import cause_of
from detector.scores.quantiles import quantile
from grasp.files import save_figure

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
# What the authors' configuration gives for the data of the paper, counts a taxel.
PAPER_COUNTS = {
    "mean": (-120.24, -59.29, -14.26, -19.77, -55.34, -60.12),
    "std": (182.70, 146.50, 80.06, 86.97, 140.52, 143.61),
    "least": (-491.0, -497.0, -450.0, -502.0, -484.0, -475.0),
    "most": (190.0, 205.0, 200.0, 86.0, 163.0, 172.0),
}


class TableCell(msgspec.Struct, frozen=True):
    """One group of Table I: percent of the data set's samples, and of the paper's."""

    motion: str
    speed: float  # m/s, of a rotation rad/s
    surface: str
    samples: int
    slip: int
    percent: float
    paper_percent: float | None


class Taxel(msgspec.Struct, frozen=True):
    """Counts of one taxel over all recordings and fingers."""

    mean: float
    std: float
    least: int
    most: int


class Kind(msgspec.Struct, frozen=True):
    """Recordings of one cause, or of strokes (`slide`)."""

    recordings: int
    samples: int
    slip: float  # share of the samples, and of those that have moved 1 mm since they last rested
    moved: float | None
    at_rail: float  # share of the counts of a taxel pressed as far down as it ever reads


class Deeds(msgspec.Struct, frozen=True):
    """Acts of one kind on held objects: shares of them that moved it so far for good."""

    number: int
    below_half_mm: float
    half_to_one_mm: float
    above_two_mm: float
    furthest_p50_m: float  # from where it was, as the samples saw it


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
    acts: dict[str, Deeds]
    speed_p50_mps: float | None  # of the fingertip, where it is labelled slip
    speed_p99_mps: float | None
    table: list[TableCell]
    taxels: list[Taxel]


def describe(recordings: Sequence[Recording]) -> DatasetFigures:
    """Figures of recordings that are not empty."""
    samples = sum(len(r.slip) for r in recordings)
    slip = sum(int(r.slip.sum()) for r in recordings)
    true = [r for r in recordings if r.slip_true is not None]
    known = [(r, r.slip_true) for r in true if r.slip_true is not None]
    complete = len(known) == len(recordings)
    speeds = np.sort(_speeds(recordings))
    return DatasetFigures(
        recordings=len(recordings),
        samples=samples,
        static=samples - slip,
        slip=slip,
        slip_true=sum(int(label.sum()) for _, label in known) if complete else None,
        moved=(
            sum(int(r.label("moved").sum()) for r in recordings)
            if all(r.moved_m is not None for r in recordings)
            else None
        ),
        labels_agree=(
            sum(int((r.slip == label).sum()) for r, label in known) / samples if complete else None
        ),
        splits=_splits(recordings),
        kinds=_kinds(recordings),
        acts=_acts(recordings),
        speed_p50_mps=quantile(speeds, 0.5) if len(speeds) else None,
        speed_p99_mps=quantile(speeds, 0.99) if len(speeds) else None,
        table=_table(recordings, samples),
        taxels=_taxels(recordings),
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


def _acts(recordings: Sequence[Recording]) -> dict[str, Deeds]:
    groups: dict[str, list[Act]] = {}
    for r in recordings:
        for act in r.metadata.acts if r.metadata else ():
            groups.setdefault(act.kind, []).append(act)
    return {name: _deeds(group) for name, group in sorted(groups.items())}


def _deeds(group: Sequence[Act]) -> Deeds:
    moved = np.array([act.moved_m for act in group])
    furthest = np.sort([act.furthest_m for act in group])
    return Deeds(
        len(group), float((moved < 0.0005).mean()),
        float(((moved >= 0.0005) & (moved < 0.001)).mean()), float((moved >= 0.002).mean()),
        quantile(furthest, 0.5),
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


def _taxels(recordings: Sequence[Recording]) -> list[Taxel]:
    taxels = recordings[0].taxels
    counts = np.concatenate([r.counts.reshape(-1, taxels) for r in recordings])
    return [
        Taxel(
            float(counts[:, i].mean()), float(counts[:, i].std()),
            int(counts[:, i].min()), int(counts[:, i].max()),
        )
        for i in range(taxels)
    ]  # fmt: skip


def draw(recordings: Sequence[Recording], out: Path) -> None:
    """Pictures of up to four recordings, spread over the set: counts, and both labels as shades."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    chosen = [recordings[i * len(recordings) // 4] for i in range(min(4, len(recordings)))]
    plt.rcParams["svg.hashsalt"] = "grasp"  # the same recordings give the same file
    figure, axes = plt.subplots(len(chosen), 1, figsize=(10, 2.4 * len(chosen)), squeeze=False)
    for axis, r in zip(axes[:, 0], chosen, strict=True):
        shown = r.t_s < 8.0
        for taxel in range(r.taxels):
            axis.plot(r.t_s[shown], r.counts[shown, 0, taxel], lw=0.8, label=str(taxel))
        low, high = axis.get_ylim()
        axis.fill_between(r.t_s[shown], low, high, where=r.slip[shown], color="#f2c48d", alpha=0.4)
        if r.slip_true is not None:
            edge = low + 0.06 * (high - low)
            axis.fill_between(r.t_s[shown], low, edge, where=r.slip_true[shown], color="#b33b2e")
        if r.moved_m is not None:
            beside = axis.twinx()
            beside.plot(r.t_s[shown], 1e3 * r.moved_m[shown], color="k", lw=0.8, ls=":")
            beside.set_ylabel("moved, mm")
        m = r.metadata
        what = f"{m.surface}, {m.cause or m.motion} {m.direction}" if m else r.source
        axis.set_title(what, loc="left", fontsize=9)
        axis.set_ylabel("counts")
    axes[0, 0].legend(title="taxel", ncols=6, fontsize=7, loc="upper right")
    axes[-1, 0].set_xlabel("s; shaded: label slip; bar: the contact truly slides; dotted: moved")
    figure.tight_layout()
    save_figure(figure, out, dpi=100)
    plt.close(figure)
