"""Import of tables that other programs recorded: `grasp dataset import`."""

import hashlib
import json
import re
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from itertools import compress
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
    missed_samples,
)
from detector.text_table import DECIMAL_COMMA, read_table
from drivers.errors import BadFile
from drivers.interfaces import FINGERS, KIT_TAXELS, PERIOD_S
from grasp.settings import suggestion

# Name of a time column, and its unit: `time`, `t_s`, `Time (ms)`, `us`
TIME_NAME = re.compile(r"(?i)(?:t|time|timestamp|stamp)(?:[_ (\[]+([mun]?s)[)\]]?)?|([mun]s)")
LABEL_NAMES = (LABEL, "label")
NUMBER, RANGE = re.compile(r"[0-9]{1,6}"), re.compile(r"([0-9]{1,6})-([0-9]{1,6})")
LOST = ("", "nan", "na", "n/a", "null", "none", "[]")  # cells of a lost sample, in lower case
STAMPS = "date and time"
LEAST_FITTING = 0.1  # share of samples that have labels, and of slow labels within them; assumed
GERMAN_DATE = re.compile(r"([0-9]{2})\.([0-9]{2})\.([0-9]{4})")
TIME = "it must be a number or a stamp as 2026-01-31T10:15:00.010; without times give --rate HZ"
LEAST_SPAN = 20.0  # of pressures that are no whole numbers, in counts: less is lost by rounding
THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")  # or a number with three decimals
LABEL_VALUES = {"0": 0.0, "1": 1.0, "false": 0.0, "true": 1.0}
Floats = NDArray[np.float64]


class ImportOptions(msgspec.Struct, frozen=True, kw_only=True):
    """What the user knows of a file; empty or None: found by its column names."""

    time_column: str = ""
    rate_hz: float | None = None  # of a file without times
    unit: str = ""  # by the name of the time column, else seconds
    columns: str = ""  # of pressures: names, numbers from 1, or ranges of numbers
    taxels: int = KIT_TAXELS  # of a fingertip
    sign: Literal["negative", "positive"] = "negative"  # of a press, in the file
    scale: float | None = None  # counts per unit of the file; None: not given
    rest_s: float = 0.0
    labels: Path | None = None
    resample: bool = False


class Table(msgspec.Struct, frozen=True, eq=False):
    """Columns of a file by name: that of its header, or its number."""

    source: str
    columns: dict[str, tuple[str, ...]]
    lines: list[int]
    decimal_commas: bool = False  # which were read as points

    def lost(self, names: Sequence[str]) -> NDArray[np.bool_]:
        """Rows (n,) that lack a value in one of these columns."""
        empty = [[cell.lower() in LOST for cell in self.columns[name]] for name in names]
        found: NDArray[np.bool_] = np.logical_or.reduce(np.array(empty))
        return found

    def without(self, lost: NDArray[np.bool_]) -> "Table":
        """The table without these rows. Raises BadFile if fewer than two remain."""
        if (kept := ~lost).sum() < 2:
            raise BadFile(self.source, f"{kept.sum()} samples have a value in each channel",
                          "at least 2 are needed; choose the pressures with --columns")  # fmt: skip
        columns = {name: tuple(compress(cells, kept)) for name, cells in self.columns.items()}
        return msgspec.structs.replace(self, columns=columns,
                                       lines=list(compress(self.lines, kept)))  # fmt: skip

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

    def numbers(self, name: str, allowed: str = "it must be a number") -> Floats:
        """Values (n,) of a column. Raises BadFile for the first that is no number, with what is
        ``allowed``."""
        for line, cell in zip(self.lines, self.columns[name], strict=True):
            if not _is_number(cell):
                remedy = f"{allowed}; choose the columns with --time-column and --columns"
                raise BadFile(self.source, f"{name} is {cell!r}", remedy, line)
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

    def time_column(self, given: str) -> str:
        """Name of the time column. Raises BadFile if none is found."""
        known = list(filter(TIME_NAME.fullmatch, self.columns))
        if not given and not known:
            problem = f"no column is named as time; its columns are {', '.join(self.columns)}"
            remedy = "name it with --time-column, or give --rate HZ for a file without times"
            raise BadFile(self.source, problem, remedy)
        return self.find(given or known[0])

    def times(self, name: str, given: str, default: str = "s") -> tuple[str, Floats]:
        """Unit and times (n,), s, of a column of numbers or of time stamps. Raises BadFile where
        they do not increase, and for time stamps with a given unit."""
        if _stamp_s(self.columns[name][0]) is None:
            named = TIME_NAME.fullmatch(name.lower())
            unit = given or (named and (named[1] or named[2])) or default
            t_s = self.numbers(name, TIME) / UNITS.get(unit, 1.0)
        elif given:
            problem = f"{name} is {self.columns[name][0]!r}, which has no unit {given!r}"
            raise BadFile(self.source, problem, "leave --unit out", self.lines[0])
        else:
            unit, stamps = STAMPS, [_stamp_s(cell) for cell in self.columns[name]]
            if None in stamps:
                at = stamps.index(None)
                raise BadFile(self.source, f"{name} is {self.columns[name][at]!r}",
                              "write it as the time stamps before it", self.lines[at])  # fmt: skip
            t_s = np.array(stamps, np.float64)
        if (wrong := np.diff(t_s) <= 0.0).any():
            at = int(wrong.argmax()) + 1
            problem = f"time does not increase: {name} is {self.columns[name][at]} after "
            problem += self.columns[name][at - 1]
            remedy = "write each sample once, in the order of time, or give --rate HZ"
            raise BadFile(self.source, problem, remedy, self.lines[at])
        return unit, t_s


def read_foreign(path: Path) -> Table:
    """Read a table with or without a header; a cell that holds a list becomes one column for each
    of its values. Raises BadFile."""
    text = read_table(path, empty_rows=True)
    if commas := text.decimal_comma():
        every = (cell for row in text.rows for cell in row if DECIMAL_COMMA.fullmatch(cell))
        if all(map(THOUSANDS.fullmatch, every)):
            one, line = commas
            meant = f"{one.replace(',', '')} or {one.replace(',', '.')}"
            raise BadFile(path, f"{one} may mean {meant}", "write one of these", line)
        points = [[x.replace(",", ".") if DECIMAL_COMMA.fullmatch(x) else x for x in row]
                  for row in text.rows]  # fmt: skip
        text = msgspec.structs.replace(text, rows=points)
    first = text.rows[0] if text.rows else ["1"]
    numbered = list(map(str, range(len(first))))  # header by pandas; of two, time and a label
    headed = first in (numbered, ["", *numbered[:-1]]) and len(first) > 2
    headed = headed or not any(map(_values, first))
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
        width = len(_values(column[0]))
        lists = [("",) * width if cell.lower() in LOST else _values(cell) for cell in column]
        for line, values in zip(lines, lists, strict=True):
            if not values or len(values) != len(lists[0]):
                problem = f"{name} holds {len(values)} values, not {len(lists[0])}"
                raise BadFile(path, problem, "each list must have the same length", line)
        spread = zip(*lists, strict=True)
        columns |= {f"{name}[{i}]": values for i, values in enumerate(spread)}
    return Table(str(path), columns, lines, bool(commas))


def import_recording(path: Path, options: ImportOptions) -> tuple[Recording, list[str]]:
    """A recording from a foreign file, and one line for each thing that was changed.

    Raises BadFile.
    """
    table = read_foreign(path)
    changes = ["numbers: decimal commas read as points"] if table.decimal_commas else []
    time = "" if options.rate_hz else table.time_column(options.time_column)
    label = next((n for n in table.columns if n.lower() in LABEL_NAMES), "")
    others = [time, label] if time else [label, *filter(TIME_NAME.fullmatch, table.columns)]
    names = _chosen(table, options.columns) or [n for n in table.columns if n not in others]
    fingers = _fingers(table.source, names, options.taxels)
    if (lost := table.lost(names)).any():
        table = table.without(lost)
        changes.append(f"lost samples: {lost.sum()}, which lack a value; left out")
    unit, times_s = _times(table, time, options, np.flatnonzero(~lost), changes)
    t_s = times_s - times_s[0]
    for i in range(fingers):
        part = names[i * options.taxels : (i + 1) * options.taxels]
        changes.append(f"finger {'ABC'[i]}: {', '.join(part)} -> p0 to p{options.taxels - 1}")
    if left_out := [name for name in table.columns if name not in (time, label, *names)]:
        changes.append(f"columns left out: {', '.join(left_out)}")
    values = np.column_stack([table.numbers(name) for name in names])
    values = _scaled(table.source, values, options.scale, changes)
    if options.rest_s:
        values = values - _rest(table.source, t_s, values, options.rest_s, changes)
    slip = None
    if options.labels is not None:
        slip, inside, how = _aligned_labels(options.labels, unit, times_s)
        t_s, values, slip = t_s[inside], values[inside], slip[inside]
        changes.append(how)
    elif label:
        slip = table.labels(label)
        changes.append(f"labels: {label}")
    else:
        changes.append(f"labels: none; a column of labels is named {' or '.join(LABEL_NAMES)}")
    if options.sign == "positive":
        values = -values
        changes.append("sign: inverted, so that pressing lowers the counts")
    t_s, values, slip = _at_100_hz(table, options, t_s, values, slip, changes)
    whole = np.rint(values)
    if (worst := np.abs(whole - values).max()) > 0.0:
        changes.append(f"values: rounded to whole counts, by at most {worst:.2g}")
    if np.abs(whole).max() > COUNTS_LIMIT:
        raise BadFile(path, f"a count is {whole.flat[np.abs(whole).argmax()]:g}, beyond "
                      f"+-{COUNTS_LIMIT}", "subtract rest with --rest-seconds, choose the "
                      "pressures with --columns, or give a smaller --scale")  # fmt: skip
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


def _times(
    table: Table, name: str, options: ImportOptions, rows: NDArray[np.intp], changes: list[str]
) -> tuple[str, Floats]:
    """Unit and times (n,), s, of these rows of the file. Raises BadFile for a gap."""
    if options.rate_hz is None:
        unit, times_s = table.times(name, options.unit)
        _check_unit(times_s, unit, table.source)
        changes.append(f"time: {name}, in {unit}, {table.columns[name][0]} subtracted")
    else:
        unit, times_s = options.unit, rows / options.rate_hz
        changes.append(f"time: made from {options.rate_hz:g} Hz")
    missed = _missed(table.source, times_s - times_s[0], f"at most {MAX_MISSED} samples in a row "
                     "may be missing: cut the file in two here")  # fmt: skip
    if (missing := (missed + 1 - np.diff(rows)).clip(0)).any():
        changes.append(f"lost samples: {missing.sum()}, whose rows are missing")
    return unit, times_s


def _rest(source: str, t_s: Floats, values: Floats, rest_s: float, changes: list[str]) -> Floats:
    """Median (channels,) of the first seconds. Raises BadFile if there are not so many."""
    if rest_s > (length_s := float(t_s[-1] - t_s[0])):
        problem = f"--rest-seconds {rest_s:g} is longer than the recording, {length_s:.4g} s"
        raise BadFile(source, problem, "give the seconds before the first press")
    resting = t_s < t_s[0] + rest_s
    rest: Floats = np.median(values[resting], axis=0)
    shown = ", ".join(f"{value:g}" for value in rest)
    changes.append(f"rest: median of {resting.sum()} samples subtracted: {shown}")
    return rest


def _scaled(source: str, values: Floats, scale: float | None, changes: list[str]) -> Floats:
    """Pressures (n, channels) in counts. Raises BadFile, without a scale, if whole counts cannot
    hold them."""
    if scale is not None:
        changes.append(f"scale: multiplied by {scale:g}")
        return values * scale
    span = float(np.ptp(values, axis=0).max())
    if 0.0 < span < LEAST_SPAN and (values != np.rint(values)).any():
        problem = f"the pressures change by {span:.2g} at most, and whole counts would lose that"
        remedy = "give --scale N, counts per unit: 8 for kPa of the kit's barometers, 1 for counts"
        raise BadFile(source, problem, remedy)
    return values


def _check_unit(t_s: Floats, unit: str, source: str) -> None:
    """Raise BadFile, with the file's unit, where the given one is wrong."""
    if unit == STAMPS:
        return
    try:
        check_unit(t_s, source, "give")
    except BadFile:
        check_unit(t_s * UNITS.get(unit, 1.0), source, "give")
        raise


def _at_100_hz(
    table: Table, options: ImportOptions, t_s: Floats, values: Floats,
    slip: NDArray[np.bool_] | None, changes: list[str],
) -> tuple[Floats, Floats, NDArray[np.bool_] | None]:  # fmt: skip
    """Samples at 100 Hz. Raises BadFile for another rate without --resample."""
    period_s = float(np.median(np.diff(t_s)))
    if not options.resample:
        check_rate(t_s, table.source)
        return t_s, values, slip
    # differences of Unix times are wrong by a quarter of a microsecond
    bins = np.floor((t_s - t_s[0]) / PERIOD_S + 1e-4).astype(np.intp)
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
        held = np.searchsorted(t_s - t_s[0], grid_s + 1e-6, side="right") - 1
        slip = slip[held.clip(0)]
    how = "mean of each 10 ms" if period_s <= PERIOD_S else "linear between samples"
    held_too = "" if slip is None else "; labels held from the sample before"
    changes.append(f"rate: {1.0 / period_s:.4g} Hz -> 100 Hz, {how}{held_too}")
    return grid_s, values, slip


def _missed(source: str, t_s: Floats, remedy: str) -> NDArray[np.intp]:
    """Missed samples between neighbours (n - 1,). Raises BadFile for too many in a row."""
    steps = np.diff(t_s)
    period_s = max(float(np.median(steps)), PERIOD_S)
    if steps.max() >= (MAX_MISSED + GAP_PERIODS) * period_s:
        problem = f"a gap of {steps.max():.3g} s before {t_s[1:][steps.argmax()]:.3f} s"
        raise BadFile(source, problem, remedy)
    return missed_samples(t_s, period_s)


def _aligned_labels(
    path: Path, unit: str, t_s: Floats
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], str]:
    """Labels (n,) at the times (n,), which of the times they cover, and how they were aligned."""
    table = read_foreign(path)
    names = list(table.columns)
    time = table.time_column(names[0] if len(names) == 2 else "")
    label = next((name for name in names if name.lower() in LABEL_NAMES), names[-1])
    known_s = table.times(time, "", unit)[1]
    period_s = float(np.median(np.diff(known_s)))
    at = np.searchsorted(known_s, t_s, side="right").clip(1) - 1
    inside = (t_s >= known_s[0]) & (t_s < known_s[-1] + period_s)
    inside &= t_s < known_s[at] + 2.0 * period_s  # a label is not held over a hole
    beyond = ((known_s < t_s[0]) | (known_s > t_s[-1])).mean() > 1.0 - LEAST_FITTING
    if inside.sum() < max(2.0, LEAST_FITTING * len(t_s)) or (beyond and period_s > 1.0):
        problem = f"labels from {known_s[0]:.12g} to {known_s[-1]:.12g} s do not fit the "
        problem += f"samples from {t_s[0]:.12g} to {t_s[-1]:.12g} s"
        raise BadFile(path, problem, "both need the same clock and the same unit")
    held = table.labels(label)[at]
    remedy = f"each label is held for {2.0 * period_s:.3g} s, twice the median interval: write "
    _missed(str(path), t_s[inside], f"{remedy}more labels there, or cut both files in two")
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
                      "name the pressures, finger by finger, with --columns (labels: `slip` or "
                      "`label`); for another fingertip give --taxels N")  # fmt: skip
    return fingers


def _stamp_s(cell: str) -> float | None:
    """Unix time of an ISO 8601 or German time stamp, by default in UTC; None for other text."""
    with suppress(ValueError, OverflowError):
        if ":" in cell:
            stamp = datetime.fromisoformat(GERMAN_DATE.sub(r"\3-\2-\1", cell))
            return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()
    return None


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
        return words if all(_is_number(w) or w.lower() in LOST for w in words) else ()
    return ()
