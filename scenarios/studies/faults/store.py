"""Rows of the fault campaign in an SQLite file: one a run, on the disk as soon as it has ended,
put there by whichever worker made it. They share a file that one campaign at a time holds."""

import sqlite3
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Self

import msgspec

from drivers.errors import BadFile, CouldNotRecord
from grasp.files import make_private_file, make_private_folder
from scenarios.campaign.lock import writing
from scenarios.campaign.store import of_the_disk
from scenarios.studies.faults.cases import Case, plan
from scenarios.studies.faults.run import Ended, run_scene

CREATE = "CREATE TABLE IF NOT EXISTS runs (number INTEGER PRIMARY KEY, code TEXT, ended BLOB)"
FREE = "free the disk or the file, then give the same command again"


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
        self._db = _opened(self._path)
        self._held.callback(self._db.close)
        try:
            if self._writes:
                self._db.execute(CREATE)
            self._db.execute("SELECT number, code, ended FROM runs LIMIT 1")
        except sqlite3.Error as error:
            self._held.close()
            if of_the_disk(error):
                raise CouldNotRecord(f"{self._path}: {error}", FREE) from None
            raise BadFile(self._path, str(error), "name another file with --out") from None
        return self

    def __exit__(self, *_: object) -> None:
        self._held.close()

    def ended(self) -> list[Ended]:
        """All runs of cases that are in the plan, by number."""
        cases = {case.number: case for case in plan()}
        rows = self._db.execute("SELECT ended FROM runs ORDER BY number").fetchall()
        found = [e for (row,) in rows if (e := _read(row)) is not None]
        return [e for e in found if cases.get(e.case.number) == e.case]

    def codes(self) -> list[str]:
        """What the runs were made with."""
        return [code for (code,) in self._db.execute("SELECT DISTINCT code FROM runs ORDER BY 1")]

    def lacking(self, cases: Iterable[Case], stale: Collection[str] = ()) -> list[Case]:
        """Those that have not been run, or with a code that is ``stale``."""
        had = {e.case.number for e in self.ended()}
        rows = self._db.execute("SELECT number, code FROM runs")
        had -= {number for number, code in rows if code in stale}
        return [case for case in cases if case.number not in had]


class Lot(msgspec.Struct, frozen=True):
    """Runs of one scene, the file of their rows, and what they are made with."""

    cases: list[Case]
    out: Path
    code: str


def make(lot: Lot) -> list[Ended]:
    """Make these runs, each on the disk as soon as it is over. Raises CouldNotRecord: then those
    that were not over are not kept."""
    problems = list[CouldNotRecord]()

    def tell(ended: Ended) -> None:
        try:
            if not problems:
                add(lot.out, ended, lot.code)
        except CouldNotRecord as error:  # told below: within a lift it would be the lift's fault
            problems.append(error)
            raise
        if problems:
            raise problems[0]

    made = run_scene(lot.cases, tell)
    if problems:
        raise problems[0]
    return made


def add(path: Path, ended: Ended, code: str) -> None:
    """One row more, or anew; raises CouldNotRecord. ``code``: what the run was made with."""
    row = (ended.case.number, code, msgspec.json.encode(ended))
    with _written(path), closing(_opened(path)) as db:
        db.execute("INSERT OR REPLACE INTO runs VALUES (?, ?, ?)", row)


def _opened(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(path, isolation_level=None, timeout=30.0)


@contextmanager
def _written(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        raise CouldNotRecord(f"{path}: {error}", FREE) from None


def _read(row: bytes) -> Ended | None:
    """None: a row of an earlier form, which is none of this plan."""
    try:
        return msgspec.json.decode(row, type=Ended)
    except msgspec.ValidationError:
        return None
