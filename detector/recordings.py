"""Tactile recordings with labels: the one owner of their file format.

The format is CSV with a header, ``t_s,p0,...,p5,slip`` and optionally ``slip_true``: seconds, the
counts of one fingertip (raw minus rest, pressing negative), and 1 while it slips, 0 otherwise.
"""

import math
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

TAXELS = 6
PERIOD_S = 0.01  # the board's sample period in the paper
GAP_PERIODS = 1.5  # samples further apart than this have lost one between them
MAX_MISSED = 5  # in a row; beyond that the sensor counts as stale and detectors are reset
COUNTS_LIMIT = 1023  # difference of two 10-bit codes
COLUMNS = ("t_s", *(f"p{i}" for i in range(TAXELS)), "slip")
OPTIONAL = "slip_true"


class BadRecording(ValueError):
    """A file is not a usable recording: says where, what is wrong, and what to do about it.

    ``line`` counts from 1, the header; None where the file as a whole is meant.
    """

    kind = "bad_recording"

    def __init__(self, file: str, line: int | None, problem: str, remedy: str) -> None:
        super().__init__(file, line, problem, remedy)
        self.file = file
        self.line = line
        self.problem = problem
        self.remedy = remedy

    @property
    def message(self) -> str:
        where = self.file if self.line is None else f"{self.file}, line {self.line}"
        return f"{where}: {self.problem}"

    def __str__(self) -> str:
        return f"{self.message}; {self.remedy}"


class Recording(msgspec.Struct, frozen=True, eq=False):
    """Labelled frames at the times at which they came; nothing is resampled, arrays are read-only.

    ``slip`` is what the labelling rule says (in the paper: faster than 3 mm/s); ``slip_true`` is
    known in simulation only.
    """

    t_s: NDArray[np.float64]  # (n,)
    counts: NDArray[np.int16]  # (n, fingers, 6)
    slip: NDArray[np.bool_]  # (n,)
    slip_true: NDArray[np.bool_] | None  # (n,)
    source: str

    @property
    def fingers(self) -> int:
        return int(self.counts.shape[1])

    @property
    def missed(self) -> int:
        """Samples lost in gaps, judged by the time stamps."""
        return int(missed_samples(self.t_s).sum())


def missed_samples(t_s: NDArray[np.float64]) -> NDArray[np.intp]:
    """Samples lost between each two neighbours: (n,) times in seconds to (n - 1,)."""
    periods = np.diff(t_s) / PERIOD_S
    lost = np.maximum(np.rint(periods).astype(np.intp) - 1, 1)
    return np.where(periods > GAP_PERIODS, lost, 0)


def read_csv(path: Path | str) -> Recording:
    """Read a recording of one fingertip; raises BadRecording at the first thing that is wrong."""
    source = str(path)
    lines = _lines(Path(path))
    columns = _columns(lines, source)
    numbered = [(i, line) for i, line in enumerate(lines[1:], start=2) if line.strip()]
    rows = [_row(line, columns, source, i) for i, line in numbered]
    if len(rows) < 2:
        raise BadRecording(source, None, f"{len(rows)} samples", "at least 2 are needed")
    table = np.array(rows)
    _check_times(table[:, 0], [i for i, _ in numbered], source)
    slip_true = table[:, -1] == 1.0 if columns[-1] == OPTIONAL else None
    counts = table[:, 1 : 1 + TAXELS].astype(np.int16)[:, None, :]
    recording = Recording(
        table[:, 0].copy(), counts, table[:, 1 + TAXELS] == 1.0, slip_true, source
    )
    for array in (recording.t_s, recording.counts, recording.slip, recording.slip_true):
        if array is not None:
            array.flags.writeable = False
    return recording


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise BadRecording(str(path), None, "no such file", "check the path") from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadRecording(
            str(path), None, f"cannot be read: {error}", "give a CSV file in UTF-8"
        ) from None


def _columns(lines: list[str], source: str) -> tuple[str, ...]:
    wanted = f"the first line must be {','.join(COLUMNS)}, with or without ,{OPTIONAL}"
    if not lines:
        raise BadRecording(source, None, "empty", wanted)
    columns = tuple(word.strip() for word in lines[0].split(","))
    if columns not in (COLUMNS, (*COLUMNS, OPTIONAL)):
        raise BadRecording(source, 1, f"columns are {','.join(columns)}", wanted)
    return columns


def _row(line: str, columns: tuple[str, ...], source: str, number: int) -> list[float]:
    words = line.split(",")
    if len(words) != len(columns):
        raise BadRecording(source, number, f"{len(words)} columns", f"there must be {len(columns)}")
    values = []
    for name, word in zip(columns, words, strict=True):
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        remedy = _objection(name, value)
        if remedy:
            raise BadRecording(source, number, f"{name} is {word.strip()!r}", remedy)
        values.append(value)
    return values


def _objection(column: str, value: float) -> str:
    """What a value of this column must be, empty if it is."""
    if not math.isfinite(value):
        return "it must be a finite number"
    if column.startswith("slip"):
        return "" if value in (0.0, 1.0) else "a label must be 0 or 1"
    if column == "t_s":
        return ""
    if not value.is_integer():
        return "counts must be whole: write raw minus rest, unscaled"
    return "" if abs(value) <= COUNTS_LIMIT else f"counts must lie within +-{COUNTS_LIMIT}"


def _check_times(t_s: NDArray[np.float64], numbers: list[int], source: str) -> None:
    backwards = np.flatnonzero(np.diff(t_s) <= 0.0)
    if len(backwards):
        raise BadRecording(
            source, numbers[backwards[0] + 1], "time does not increase",
            "write samples in the order in which they came, each once",
        )  # fmt: skip
    missed = missed_samples(t_s)
    stale = np.flatnonzero(missed > MAX_MISSED)
    if len(stale):
        raise BadRecording(
            source, numbers[stale[0] + 1], f"{missed[stale[0]]} samples are missing before this",
            f"at most {MAX_MISSED} in a row may be: cut the recording in two here",
        )  # fmt: skip
