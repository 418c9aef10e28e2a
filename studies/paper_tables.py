"""The paper's Tables II and III with its detectors and ours.

The paper measured a real fingertip, this study a simulated one: compare within a column only. As in
the paper, the split `train` of `--data` sets the threshold of a formula. Intervals are 95 %, by
bootstrap over recordings. Means of Table III weigh every cell equally.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.energy import STEEPNESS
from detector.loading import FORMULAS
from detector.recordings import Recording
from detector.scores.evaluation import score_stream, scored_samples
from detector.scores.figures import HIGH, LOW, samples_of
from detector.scores.metrics import Confusion, confusion
from detector.scores.quantiles import quantile, quantiles
from drivers.errors import UsageError
from grasp.cli.detector import check_named
from grasp.cli.parser import Parser
from scenarios.benchmark.scoring import Contender, contender, read_split
from scenarios.campaign.config import load_config
from studies.runner import Study, add_data, markdown

Floats = NDArray[np.float64]
Key = tuple[str, float, str]  # motion, commanded speed in m/s (0 of a rotation), surface

DETECTORS = ("psd", "freq-cnn-paper", "tcn-paper", "energy", "psd-fair", "gru", "tcn")
SURFACES = ("planar", "sphere", "cylinder-y", "cylinder-x")
LEAST_RECORDINGS, RESAMPLES = 5, 2000
# the paper's accuracy, precision, recall and F1, weighted over both classes, per cent
PAPER_METHODS = {
    "psd": (57.4, 57.9, 57.4, 57.5),
    "freq-cnn-paper": (86.0, 86.0, 86.0, 86.0),
    "tcn-paper": (91.3, 91.4, 91.4, 91.4),
}
# the paper's weighted F1 of its TCN by surface, and its mean, per cent
PAPER_CELLS = {
    ("primary", 0.05): (92.5, 88.8, 78.7, 94.0, 89.7),
    ("primary", 0.075): (94.9, 88.0, 90.0, 90.3, 91.6),
    ("primary", 0.1): (95.7, 84.5, 87.8, 92.1, 93.1),
    ("oblique", 0.05): (94.0, 88.9, 87.1, 93.2, 91.5),
    ("oblique", 0.075): (96.6, 89.3, 93.7, 92.2, 93.1),
    ("oblique", 0.1): (96.4, 88.6, 93.5, 93.4, 93.8),
    ("rotation", 0.0): (84.6, 74.5, 84.0, 86.1, 81.5),
}
PAPER_MEANS = (94.0, 88.9, 88.0, 91.9)
KEYS: tuple[Key, ...] = tuple((*row, surface) for row in PAPER_CELLS for surface in SURFACES)
# section V-B: F1 of the first group of cells is above that of the second, in every pair
STATEMENTS: dict[str, tuple[tuple[str | float, str | float], ...]] = {
    "planar is better than sphere and cylinder along y":
        (("planar", "sphere"), ("planar", "cylinder-y")),
    "a cylinder is better along x than along y": (("cylinder-x", "cylinder-y"),),
    "faster is better": ((0.1, 0.05),),
    "oblique is better than primary": (("oblique", "primary"),),
    "rotation is worst": (("translation", "rotation"),),
}  # fmt: skip


class Task(msgspec.Struct, frozen=True):
    """A detector to be evaluated."""

    detector: str
    digest: str  # of its weights, settings and rule
    data: tuple[str, ...]
    cells: tuple[str, ...]


class Counts(msgspec.Struct, frozen=True):
    """Confusion matrix and delays of one recording."""

    key: Key | None  # None: no cell of Table III
    confusion: tuple[int, int, int, int]
    delays_ms: list[float]  # infinite where missed


class Row(msgspec.Struct, frozen=True):
    """Results of a detector: the recordings of Table II, and those of Table III."""

    detector: str
    swept: str
    methods: list[Counts]
    cells: list[Counts]


class Estimate(msgspec.Struct, frozen=True, eq=False):
    """A statistic, and its value on every resample (RESAMPLES,)."""

    value: float
    resamples: Floats

    def __sub__(self, other: "Estimate") -> "Estimate":
        return Estimate(self.value - other.value, self.resamples - other.resamples)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval."""
        ordered = np.sort(self.resamples)
        return quantile(ordered, LOW), quantile(ordered, HIGH)

    def text(self) -> str:
        """Value and interval in per cent."""
        return "{:.1f} [{:.1f}, {:.1f}]".format(*(100 * x for x in (self.value, *self.interval)))


def add_options(parser: Parser) -> None:
    parser.add_argument("detector", nargs="*", default=DETECTORS, metavar="NAME|FILE.onnx",
                        help="(default: the packaged ones)")  # fmt: skip
    add_data(parser)
    parser.add_argument(
        "--cells", type=Path, nargs="+", default=[], metavar="DIR",
        help="data sets for Table III, from another seed, e.g. `grasp dataset build paper "
        "--seed 20 --share 0.6`; all their recordings are scored",
    )  # fmt: skip


def grid(args: argparse.Namespace) -> list[Task]:
    check_named(args.detector)
    if both := {f.resolve() for f in args.data} & {f.resolve() for f in args.cells}:
        raise UsageError(f"{min(both)} is given with --data and --cells",
                         "give --cells a set that was built from another seed")  # fmt: skip
    return [
        Task(name, load_config("can", "simulated", name).detector_hash(),
             tuple(map(str, args.data)), tuple(map(str, args.cells)))
        for name in args.detector
    ]  # fmt: skip


def trial(task: Task) -> Row:
    data, cells = [Path(f) for f in task.data], [Path(f) for f in task.cells]
    of_cells = read_split(cells, "all") if cells else []
    if of_cells:
        require_cells(of_cells)
    swept = ""
    if task.detector in FORMULAS:
        swept = swept_threshold(contender(task.detector, read_split(data, "train"), "train"))
    chosen = [swept] if swept else []
    made = contender(task.detector, read_split(data, "test"), "test", assignments=chosen)
    by_cell = contender(task.detector, of_cells, "all", assignments=chosen) if of_cells else None
    return Row(made.label, swept, counted(made), counted(by_cell) if by_cell else [])


def require_cells(recordings: Sequence[Recording]) -> None:
    """Raise UsageError if a cell of Table III has too few recordings."""
    keys = [key_of(r) for r in recordings]
    few = [key for key in KEYS if keys.count(key) < LEAST_RECORDINGS]
    if few:
        raise UsageError(
            f"{len(few)} of {len(KEYS)} cells have fewer than {LEAST_RECORDINGS} recordings",
            "build a larger set: `grasp dataset build paper --seed N --share 0.6`",
        )


def key_of(recording: Recording) -> Key | None:
    about = recording.metadata
    if about is None or about.set != "slide":
        return None
    return str(about.motion), round(about.speed_mps, 3), about.surface


def swept_threshold(made: Contender) -> str:
    """The threshold with the best mean recall of both classes, as a `--set` assignment.

    The probability of a formula is logistic in the logarithm of its statistic, so one stream gives
    the predictions of all thresholds.
    """
    section = made.config.detector_section
    settings = getattr(made.config, section)
    (name,) = (f for f in settings.__struct_fields__ if f.startswith("threshold"))
    samples = samples_of([scored_samples(s, made.config.rule) for s in made.streams])
    thresholds, group = np.unique(samples.p, return_inverse=True)
    slip, static = (np.cumsum(np.bincount(group, of)) for of in (samples.labels, ~samples.labels))
    recall = static / static[-1] - slip / slip[-1]
    border = float(thresholds[len(thresholds) - 1 - recall[::-1].argmax()])
    odds = border / (1.0 - border)
    return f"{section}.{name}={getattr(settings, name) * odds ** (1.0 / STEEPNESS):g}"


def counted(made: Contender) -> list[Counts]:
    found, rule = [], made.config.rule
    for s in made.streams:
        p, labels = scored_samples(s, rule)
        c = confusion(p > made.detector.threshold, labels)
        outcomes = score_stream(s, rule).events
        cells = (c.static_static, c.static_slip, c.slip_static, c.slip_slip)
        found.append(Counts(key_of(s.recording), cells, outcomes.delays_ms.tolist()))
    return found


def table(rows: Sequence[Row]) -> str:
    parts = [methods_table(rows)]
    for row in rows:
        if row.cells:
            f1 = f1_by_cell(row.cells)
            parts += [cells_table(row, f1), statements_table(row, f1)]
    swept = [f"`{row.detector}` {row.swept}" for row in rows if row.swept]
    return "\n\n".join([*parts, f"Thresholds swept on `train`: {', '.join(swept) or 'none'}."])


def methods_table(rows: Sequence[Row]) -> str:
    """Table II, and the confusion matrices. The weighted recall is the accuracy."""
    sums = [Confusion(*np.sum([c.confusion for c in row.methods], axis=0).tolist()) for row in rows]
    names = ("accuracy", "weighted_precision", "accuracy", "weighted_f1")
    paper = [PAPER_METHODS.get(row.detector, ("–",) * 4) for row in rows]
    detectors = {"detector": [f"`{row.detector}`" for row in rows]}
    methods = markdown(detectors | {
        title: [f"{p[i]} / {100 * getattr(c, names[i]):.1f}"
                for p, c in zip(paper, sums, strict=True)]
        for i, title in enumerate(("accuracy", "precision", "recall", "F1"))
    })  # fmt: skip
    confusions = markdown(detectors | {
        "static, predicted static": [c.static_static for c in sums],
        "static, predicted slip": [c.static_slip for c in sums],
        "slip, predicted static": [c.slip_static for c in sums],
        "slip, predicted slip": [c.slip_slip for c in sums],
    })  # fmt: skip
    return f"{methods}\n\nTable II, paper / ours, per cent of samples of `test`.\n\n{confusions}"


def weighted_f1(cells: NDArray[np.intp]) -> Floats:
    """F1 (...) of both classes, weighted by their samples, of confusions (..., 4)."""
    quiet, false, missed, caught = (cells[..., i].astype(np.float64) for i in range(4))
    errors, static, slip = false + missed, quiet + false, missed + caught
    of_static = 2 * quiet / np.maximum(2 * quiet + errors, 1.0)
    of_slip = 2 * caught / np.maximum(2 * caught + errors, 1.0)
    found: Floats = (static * of_static + slip * of_slip) / np.maximum(static + slip, 1.0)
    return found


def f1_by_cell(recordings: Sequence[Counts]) -> dict[Key, Estimate]:
    """Weighted F1 of the cell, and of bootstrap resamples of its recordings."""
    rng, found = np.random.default_rng(0), {}
    for key in KEYS:
        each = np.array([c.confusion for c in recordings if c.key == key])
        resamples = rng.integers(0, len(each), (RESAMPLES, len(each)))
        value = float(weighted_f1(each.sum(axis=0)))
        found[key] = Estimate(value, weighted_f1(each[resamples].sum(axis=1)))
    return found


def mean_of(f1: dict[Key, Estimate], *groups: str | float) -> Estimate:
    """Mean over the cells of a motion, a speed and a surface; `translation`: all but rotation."""
    of = [e for key, e in f1.items()
          if {*groups} <= {*key, "" if key[0] == "rotation" else "translation"}]  # fmt: skip
    resamples: Floats = np.mean([e.resamples for e in of], axis=0)
    return Estimate(float(np.mean([e.value for e in of])), resamples)


def cells_table(row: Row, f1: dict[Key, Estimate]) -> str:
    """Table III: one line per cell, then one per mean."""
    delays = [[d for c in row.cells if c.key == key for d in c.delays_ms] for key in KEYS]
    found = [quantiles(each) for each in delays]
    cells = markdown({
        f"`{row.detector}`": [f"{named(key[:2])}, {key[2]}" for key in KEYS],
        "paper's TCN": [str(PAPER_CELLS[key[:2]][SURFACES.index(key[2])]) for key in KEYS],
        "ours": [f1[key].text() for key in KEYS],
        "delay, ms: p50 / p90 / p99":
            ["–" if q is None else f"{q.p50:.0f} / {q.p90:.0f} / {q.p99:.0f}" for q in found],
        "slips": [len(each) for each in delays],
        "missed": [int(np.isinf(each).sum()) for each in delays],
    })  # fmt: skip
    paper = dict(zip(SURFACES, PAPER_MEANS, strict=True))
    means = markdown({
        f"`{row.detector}`, mean": [*map(named, PAPER_CELLS), *SURFACES],
        "paper's TCN": [*(str(theirs[-1]) for theirs in PAPER_CELLS.values()), *paper.values()],
        "ours": [*(mean_of(f1, *cell).text() for cell in PAPER_CELLS),
                 *(mean_of(f1, surface).text() for surface in SURFACES)],
    })  # fmt: skip
    return f"{cells}\n\n{means}\n\nTable III, weighted F1, per cent; delays from the label's rise."


def statements_table(row: Row, f1: dict[Key, Estimate]) -> str:
    """A statement holds if all its intervals are above zero, and fails if one is below."""
    verdicts, texts = [], []
    for pairs in STATEMENTS.values():
        found = {f"{a} - {b}": mean_of(f1, a) - mean_of(f1, b) for a, b in pairs}
        intervals = [e.interval for e in found.values()]
        below, above = any(hi < 0 for _, hi in intervals), all(lo > 0 for lo, _ in intervals)
        verdicts.append("does not" if below else "holds" if above else "not resolved")
        texts.append("; ".join(f"{name} {e.text()}" for name, e in found.items()))
    return markdown({"the paper says": list(STATEMENTS), f"`{row.detector}`": verdicts,
                     "points of F1": texts})  # fmt: skip


def named(cell: tuple[str, float]) -> str:
    motion, speed = cell
    return f"{motion} {100 * speed:g} cm/s" if speed else f"{motion} 1 rad/s"


STUDY = Study("the paper's Tables II and III, its detectors and ours", grid, trial, Row, table,
              options=add_options, counted="detectors")  # fmt: skip
