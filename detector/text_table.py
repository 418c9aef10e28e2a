"""Tables of text: CSV with a comma, semicolon or tab between the columns."""

import csv
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from drivers.errors import BadFile

DELIMITERS = "\t;,"  # in this order: a comma may be within the cells of the others
MOST_BYTES = 200_000_000  # of a file: hours; as text it needs up to 13 times its size in memory
MOST_SHARED = 6  # characters of a cell that shares its memory with equal ones: a count
DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]+)?")


class TextTable(msgspec.Struct, frozen=True):
    """The rows of a file, without blank ones, and the line of each."""

    source: str
    rows: list[list[str]]
    lines: list[int]

    def columns(self, first: int) -> list[tuple[str, ...]]:
        """The columns, from row ``first``. Raises BadFile for a row with another number of cells
        than the first of all."""
        for row, line in zip(self.rows, self.lines, strict=True):
            if len(row) != len(self.rows[0]):
                remedy = f"there must be {len(self.rows[0])}, as in the first row"
                raise BadFile(self.source, f"{len(row)} columns", remedy, line)
        return list(zip(*self.rows[first:], strict=True))

    def decimal_comma(self) -> tuple[str, int] | None:
        """The first number with a comma as the decimal sign, and its line."""
        cells = ((cell, n) for row, n in zip(self.rows, self.lines, strict=True) for cell in row)
        return next((at for at in cells if "," in at[0] and DECIMAL_COMMA.fullmatch(at[0])), None)


@contextmanager
def as_bad_file(path: Path, remedy: str) -> Iterator[None]:
    """Convert exceptions of reading the file to BadFile."""
    try:
        yield
    except FileNotFoundError:
        raise BadFile(path, "no such file", "check the path") from None
    except Exception as error:  # numpy and zipfile raise many kinds for damage
        problem = f"cannot be read: {str(error) or type(error).__name__}"
        raise BadFile(path, problem, remedy) from None


def require_file(path: Path) -> None:
    """Raise BadFile for a folder, a pipe or a device, whose reading may never end."""
    if path.exists() and not path.is_file():
        what = "is a folder" if path.is_dir() else "is not a regular file"
        raise BadFile(path, what, "give one recording: a .npz or .csv file")


def read_table(path: Path, empty_rows: bool = False) -> TextTable:
    """Read a table; ``empty_rows``: keep rows of empty cells between others. Raises BadFile."""
    require_file(path)
    if path.exists() and (size := path.stat().st_size) > MOST_BYTES:
        problem = f"is too large: {size / 1e6:.0f} MB; at most {MOST_BYTES / 1e6:.0f} are allowed"
        raise BadFile(path, problem, "cut it into several files")
    with as_bad_file(path, "give a CSV file in UTF-8"), path.open(encoding="utf-8-sig") as file:
        first = re.sub('"[^"]*"', "", next(filter(str.strip, file), ""))
        file.seek(0)
        delimiter = next((d for d in DELIMITERS if d in first), ",")
        reader = csv.reader(file, delimiter=delimiter, strict=True)
        cells = (
            [sys.intern(c) if len(c) <= MOST_SHARED else c for c in map(str.strip, row)]
            for row in reader
        )
        numbered = [(row, reader.line_num) for row in cells]
    filled = [at for at, (row, _) in enumerate(numbered) if any(row)]
    if empty_rows and filled:
        rows = numbered[filled[0] : filled[-1] + 1]
        numbered = [(row, line) for row, line in rows if len(row) > 1 or any(row)]
    else:
        numbered = [numbered[at] for at in filled]
    return TextTable(str(path), [row for row, _ in numbered], [line for _, line in numbered])
