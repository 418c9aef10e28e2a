"""Import of tables that other programs recorded: `grasp dataset import`."""

import hashlib
import json
import re
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import (
    COUNTS_LIMIT,
    GAP_PERIODS,
    LABEL,
    MAX_MISSED,
    UNITS,
    Metadata,
    Recording,
    check_rate,
    check_unit,
)
from detector.text_table import read_table
from drivers.errors import BadFile
from drivers.interfaces import FINGERS, KIT_TAXELS, PERIOD_S
from grasp.settings import suggestion

TIME_NAMES = ("t_s", "t", "time", "timestamp", "stamp")  # of a time column that is not named
LABEL_NAMES = (LABEL, "label")
NUMBER, RANGE = re.compile(r"[0-9]{1,6}"), re.compile(r"([0-9]{1,6})-([0-9]{1,6})")
LABEL_VALUES = {"0": 0.0, "1": 1.0, "false": 0.0, "true": 1.0}
Floats = NDArray[np.float64]


class ImportOptions(msgspec.Struct, frozen=True, kw_only=True):
    """What the user knows of a file; empty or None: found by its column names."""

    time_column: str = ""
    rate_hz: float | None = None  # of a file without times
    unit: str = "s"
    columns: str = ""  # of pressures: names, numbers from 1, or ranges of numbers
    taxels: int = KIT_TAXELS  # of a fingertip
    sign: Literal["negative", "positive"] = "negative"  # of a press, in the file
    rest_s: float = 0.0
    labels: Path | None = None
    resample: bool = False


class Table(msgspec.Struct, frozen=True, eq=False):
    """Columns of a file by name: that of its header, or its number."""

    source: str
    columns: dict[str, tuple[str, ...]]
    lines: list[int]

    def find(self, name: str) -> str:
        """The name of a column given by name or number. Raises BadFile with near names."""
        names = list(self.columns)
        if name not in names and NUMBER.fullmatch(name) and 1 <= int(name) <= len(names):
            return names[int(name) - 1]
        if name not in names:
            shown = ", ".join(names)
            raise BadFile(self.source, f"has no column {name!r}{suggestion(name, names)}",
                          f"its columns are {shown}")  # fmt: skip
        return name

    def numbers(self, name: str) -> Floats:
        """Values (n,) of a column. Raises BadFile for the first that is no number."""
        for line, cell in zip(self.lines, self.columns[name], strict=True):
            if not _is_number(cell):
                raise BadFile(
                    self.source,
                    f"{name} is {cell!r}",
                    "it must be a number; choose the columns with --time-column and --columns",
                    line,
                )
        return np.array(self.columns[name], np.float64)

    def labels(self, name: str) -> NDArray[np.bool_]:
        """Labels (n,) of a column. Raises BadFile for the first that is none."""
        words = [LABEL_VALUES.get(cell.lower().removesuffix(".0")) for cell in self.columns[name]]
        if None in words:
            at = words.index(None)
            problem = f"{name} is {self.columns[name][at]!r}"
            raise BadFile(self.source, problem, "a label must be 0 or 1", self.lines[at])
        found: NDArray[np.bool_] = np.array(words) == 1.0
        return found

    def times(self, given: str, unit: str) -> tuple[str, Floats]:
        """Name of the time column and times (n,), s. Raises BadFile where they do not increase."""
        known = [name for name in self.columns if name.lower() in TIME_NAMES]
        if not given and not known:
            shown = ", ".join(self.columns)
            raise BadFile(
                self.source,
                f"no column is named as time; its columns are {shown}",
                "name it with --time-column, or give --rate HZ for a file without times",
            )
        name = self.find(given or known[0])
        t_s = self.numbers(name) / UNITS.get(unit, 1.0)
        if (wrong := np.diff(t_s) <= 0.0).any():
            at = int(wrong.argmax()) + 1
            problem = f"time does not increase: {name} is {self.columns[name][at]} after "
            problem += self.columns[name][at - 1]
            remedy = "write each sample once, in the order of time"
            raise BadFile(self.source, problem, remedy, self.lines[at])
        return name, t_s


def read_foreign(path: Path) -> Table:
    """Read a table with or without a header; a cell that holds a list becomes one column for each
    of its values. Raises BadFile."""
    text = read_table(path)
    headed = bool(text.rows) and not any(_values(cell) for cell in text.rows[0])
    cells = text.columns(1 if headed else 0)
    lines = text.lines[1 if headed else 0 :]
    if len(lines) < 2:
        raise BadFile(path, f"{len(lines)} samples", "at least 2 are needed")
    names = text.rows[0] if headed else [str(i) for i in range(1, len(cells) + 1)]
    columns: dict[str, tuple[str, ...]] = {}
    for name, column in zip(names, cells, strict=True):
        if name in columns:
            raise BadFile(path, f"two columns are named {name!r}", "rename one")
        if not column[0].startswith("["):
            columns[name] = column
            continue
        lists = [_values(cell) for cell in column]
        for line, values in zip(lines, lists, strict=True):
            if not values or len(values) != len(lists[0]):
                problem = f"{name} holds {len(values)} values, not {len(lists[0])}"
                raise BadFile(path, problem, "each list must have the same length", line)
        spread = zip(*lists, strict=True)
        columns |= {f"{name}[{i}]": values for i, values in enumerate(spread)}
    return Table(str(path), columns, lines)


def import_recording(path: Path, options: ImportOptions) -> tuple[Recording, list[str]]:
    """A recording from a foreign file, and one line for each thing that was changed.

    Raises BadFile.
    """
    table = read_foreign(path)
    changes: list[str] = []
    if options.rate_hz is None:
        time, t_s = table.times(options.time_column, options.unit)
        _check_unit(t_s, options.unit, table.source)
        start_s = float(t_s[0])
        changes.append(f"time: {time}, in {options.unit}, {start_s:.12g} s subtracted")
        times_s, t_s = t_s, t_s - start_s
    else:
        time, times_s = "", np.arange(len(table.lines)) / options.rate_hz
        t_s = times_s
        changes.append(f"time: made from {options.rate_hz:g} Hz")
    label = next((n for n in table.columns if n.lower() in LABEL_NAMES), "")
    names = _chosen(table, options.columns)
    names = names or [n for n in table.columns if n not in (time, label)]
    fingers = _fingers(table.source, names, options.taxels)
    for i in range(fingers):
        part = names[i * options.taxels : (i + 1) * options.taxels]
        changes.append(f"finger {'ABC'[i]}: {', '.join(part)} -> p0 to p{options.taxels - 1}")
    values = np.column_stack([table.numbers(name) for name in names])
    slip = None
    if options.labels is not None:
        slip, inside, how = _aligned_labels(options.labels, options.unit, times_s)
        t_s, values, slip = t_s[inside], values[inside], slip[inside]
        changes.append(how)
    elif label:
        slip = table.labels(label)
        changes.append(f"labels: {label}")
    else:
        changes.append("labels: none")
    if options.sign == "positive":
        values = -values
        changes.append("sign: inverted, so that pressing lowers the counts")
    if options.rest_s:
        resting = t_s < t_s[0] + options.rest_s
        rest = np.median(values[resting], axis=0)
        values = values - rest
        shown = ", ".join(f"{value:g}" for value in rest)
        changes.append(f"rest: median of {resting.sum()} samples subtracted: {shown}")
    t_s, values, slip = _at_100_hz(table, options, t_s, values, slip, changes)
    whole = np.rint(values)
    if (worst := np.abs(whole - values).max()) > 0.0:
        changes.append(f"values: rounded to whole counts, by at most {worst:.2g}")
    if np.abs(whole).max() > COUNTS_LIMIT:
        raise BadFile(path, f"a count is {whole.flat[np.abs(whole).argmax()]:g}, beyond "
                      f"+-{COUNTS_LIMIT}", "subtract rest with --rest-seconds, or choose the "
                      "pressures with --columns")  # fmt: skip
    counts = whole.astype(np.int16).reshape(len(t_s), fingers, options.taxels)
    files = [path, *([options.labels] if options.labels else [])]
    metadata = Metadata(
        set="slide", split="test", surface="own", motion="none", speed_mps=0.0, spin_radps=0.0,
        direction="", seed=0, cause="imported", changes=tuple(changes),
        files={f.name: hashlib.sha256(f.read_bytes()).hexdigest() for f in files},
    )  # fmt: skip
    known = np.zeros(len(t_s), np.bool_) if slip is None else slip
    made = Recording(t_s, counts, known, None, str(path), metadata, labelled=slip is not None)
    return made, changes


def _check_unit(t_s: Floats, unit: str, source: str) -> None:
    """Raise BadFile, with the file's unit, where the given one is wrong."""
    try:
        check_unit(t_s, source, "give")
    except BadFile:
        check_unit(t_s * UNITS.get(unit, 1.0), source, "give")
        raise


def _at_100_hz(
    table: Table, options: ImportOptions, t_s: Floats, values: Floats,
    slip: NDArray[np.bool_] | None, changes: list[str],
) -> tuple[Floats, Floats, NDArray[np.bool_] | None]:  # fmt: skip
    """Samples at 100 Hz. Raises BadFile for a gap, and for another rate without --resample."""
    period_s = float(np.median(np.diff(t_s)))
    gap_s = (MAX_MISSED + GAP_PERIODS) * max(period_s, PERIOD_S)
    if (steps := np.diff(t_s)).max() >= gap_s:
        at = int(steps.argmax()) + 1
        raise BadFile(table.source, f"a gap of {steps.max():.3g} s before {t_s[at]:.3f} s",
                      f"at most {MAX_MISSED} samples in a row may be missing: cut the file in two "
                      "here")  # fmt: skip
    if not options.resample:
        check_rate(t_s, table.source)
        return t_s, values, slip
    bins = np.floor((t_s - t_s[0]) / PERIOD_S + 1e-6).astype(np.intp)
    grid = np.arange(bins[-1] + 1)
    present, first = np.unique(bins, return_index=True)
    mean = np.add.reduceat(values, first) / np.diff([*first, len(bins)])[:, None]
    at_s = np.add.reduceat(t_s - t_s[0], first) / np.diff([*first, len(bins)])
    if period_s <= PERIOD_S:
        at_s = (present + 0.5) * PERIOD_S
        grid_s = (grid + 0.5) * PERIOD_S
    else:
        grid_s = grid * PERIOD_S
    values = np.column_stack([np.interp(grid_s, at_s, column) for column in mean.T])
    if slip is not None:
        held = np.searchsorted(t_s - t_s[0], grid_s + 1e-9, side="right") - 1
        slip = slip[held.clip(0)]
    how = "mean of each 10 ms" if period_s <= PERIOD_S else "linear between samples"
    held_too = "" if slip is None else "; labels held from the sample before"
    changes.append(f"rate: {1.0 / period_s:.4g} Hz -> 100 Hz, {how}{held_too}")
    return grid_s, values, slip


def _aligned_labels(
    path: Path, unit: str, t_s: Floats
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], str]:
    """Labels (n,) at the times (n,), which of the times they cover, and how they were aligned."""
    table = read_foreign(path)
    names = list(table.columns)
    time = next((name for name in names if name.lower() in TIME_NAMES), names[0])
    label = next((name for name in names if name.lower() in LABEL_NAMES), names[-1])
    known_s = table.times(time, unit)[1]
    period_s = float(np.median(np.diff(known_s)))
    at = np.searchsorted(known_s, t_s, side="right").clip(1) - 1
    inside = (t_s >= known_s[0]) & (t_s < known_s[-1] + period_s)
    inside &= t_s < known_s[at] + 2.0 * period_s  # a label is not held over a hole
    if inside.sum() < 2:
        raise BadFile(
            path, f"labels from {known_s[0]:.12g} to {known_s[-1]:.12g} s do not overlap the "
            f"samples from {t_s[0]:.12g} to {t_s[-1]:.12g} s",
            "both need the same clock and the same unit",
        )  # fmt: skip
    held = table.labels(label)[at]
    left_out = len(t_s) - int(inside.sum())
    return held, inside, (
        f"labels: {label} of {path.name}, {len(known_s)} at {1.0 / period_s:.4g} Hz, each held "
        f"until the next; {left_out} samples without a label left out"
    )  # fmt: skip


def _chosen(table: Table, text: str) -> list[str]:
    """Names of the chosen columns, in the order given; the name of a list stands for its values."""
    names: list[str] = []
    for word in filter(None, map(str.strip, text.split(","))):
        spread = [name for name in table.columns if name.startswith(f"{word}[")]
        if spread:
            names += spread
        elif (numbers := RANGE.fullmatch(word)) and word not in table.columns:
            names += [table.find(str(i)) for i in range(int(numbers[1]), int(numbers[2]) + 1)]
        else:
            names.append(table.find(word))
    twice = [name for name in names if names.count(name) > 1]
    if twice or (text and not names):
        problem = f"--columns {text}: " + (f"{twice[0]} twice" if twice else "no column")
        raise BadFile(table.source, problem, "name each column once, ranges as 2-7")
    return names


def _fingers(source: str, names: list[str], taxels: int) -> int:
    fingers, rest = divmod(len(names), taxels)
    if rest or not 1 <= fingers <= FINGERS:
        layouts = f"{taxels} (one finger), {2 * taxels} (A, B) or {3 * taxels} (A, B, C)"
        raise BadFile(source, f"{len(names)} channels ({', '.join(names)}), not {layouts}",
                      "name the pressures, finger by finger, with --columns; for another fingertip "
                      "give --taxels N")  # fmt: skip
    return fingers


def _is_number(cell: str) -> bool:
    with suppress(ValueError):
        return "_" not in cell and bool(np.isfinite(float(cell)))
    return False


def _values(cell: str) -> tuple[str, ...]:
    """The numbers of a cell, which is a number or a list; empty for any other."""
    if not cell.startswith("["):
        return (cell,) if _is_number(cell) else ()
    with suppress(ValueError, RecursionError):
        found: Any = json.loads(cell)
        words = tuple(map(str, found))
        return words if all(map(_is_number, words)) else ()
    return ()
