"""Rows of the fault campaign in an SQLite file: one a run, on the disk as soon as it has ended."""

import sqlite3
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Self

import msgspec

from drivers.errors import BadFile
from grasp.files import make_private_file, make_private_folder
from scenarios.campaign.lock import writing
from scenarios.studies.faults.cases import Case, plan
from scenarios.studies.faults.run import Ended

CREATE = "CREATE TABLE IF NOT EXISTS runs (number INTEGER PRIMARY KEY, code TEXT, ended BLOB)"


class FaultStore:
    """One writer at a time, and readers beside it. What a row says of another plan's case is not
    taken for a run."""

    def __init__(self, path: Path, writes: bool = False) -> None:
        self._path = path
        self._writes = writes
        self._held = ExitStack()

    def __enter__(self) -> Self:
        if self._writes:
            make_private_folder(self._path.parent)
            self._held.enter_context(writing(self._path))
            make_private_file(self._path)
        elif not self._path.is_file():
            raise BadFile(self._path, "no such file", "run the campaign first")
        self._db = sqlite3.connect(self._path, isolation_level=None, timeout=30.0)
        self._held.callback(self._db.close)
        try:
            if self._writes:
                self._db.execute(CREATE)
        except sqlite3.Error as error:
            self._held.close()
            raise BadFile(self._path, str(error), "name another file with --out") from None
        return self

    def __exit__(self, *_: object) -> None:
        self._held.close()

    def add(self, ended: Ended, code: str) -> None:
        """``code``: what the run was made with."""
        row = (ended.case.number, code, msgspec.json.encode(ended))
        self._db.execute("INSERT OR REPLACE INTO runs VALUES (?, ?, ?)", row)

    def ended(self) -> list[Ended]:
        """All runs of cases that are in the plan, by number."""
        cases = {case.number: case for case in plan()}
        rows = self._db.execute("SELECT ended FROM runs ORDER BY number").fetchall()
        found = [e for (row,) in rows if (e := _read(row)) is not None]
        return [e for e in found if cases.get(e.case.number) == e.case]

    def codes(self) -> list[str]:
        """What the runs were made with."""
        return [code for (code,) in self._db.execute("SELECT DISTINCT code FROM runs ORDER BY 1")]

    def lacking(self, cases: Iterable[Case], code: str | None = None) -> list[Case]:
        """Those that have not been run; with ``code``: or with another than this."""
        had = {e.case.number for e in self.ended()}
        if code is not None:
            rows = self._db.execute("SELECT number FROM runs WHERE code = ?", (code,))
            had &= {number for (number,) in rows}
        return [case for case in cases if case.number not in had]


def _read(row: bytes) -> Ended | None:
    """None: a row of an earlier form, which is none of this plan."""
    try:
        return msgspec.json.decode(row, type=Ended)
    except msgspec.ValidationError:
        return None
