"""The SQLite file of a campaign: one row a trial, on the disk before the next one is asked for.

It has one writer at a time, and a checksum a row: what was changed is not counted.
"""

import csv
import hashlib
import math
import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Any, Self, TextIO

import msgspec

from drivers.errors import BadFile, ConfigError, CouldNotRecord
from grasp.files import (
    LEADS_NOWHERE,
    make_private_file,
    make_private_folder,
    partial_of,
    write_whole,
)
from grasp.settings import Layer, load, renamed
from scenarios.campaign.lock import writing
from scenarios.campaign.spec import CampaignSpec, Combination
from scenarios.campaign.worker import Finished, Row

FORMAT = "grasp-campaign 6"
_TYPES = {int: "INTEGER", float: "REAL", bool: "INTEGER", str: "TEXT"}
COLUMNS = Row.__struct_fields__
FOREIGN = "name the file of a campaign"
DAMAGED = "restore it from a copy, or run the campaign again into another --out"
FREE = "free the disk or the file, then go on with --resume"
MOST_NAMED = 10
FULL_BYTES = 64 * 1024  # so little is free: not enough for a row and its journal
_OF_THE_DISK = ("SQLITE_IOERR_SHM", "SQLITE_IOERR_WRITE", "SQLITE_FULL", "SQLITE_BUSY")
_BEGINS = b"SQLite format 3\0"


@contextmanager
def _written(path: Path) -> Iterator[None]:
    try:
        yield
    except (sqlite3.Error, OSError) as error:
        raise CouldNotRecord(f"{path}: {why(error, path)}", FREE) from None


def why(error: Exception, path: Path) -> str:
    """A file could not be written; SQLite calls a full disk an error of the disk as any other."""
    said = getattr(error, "strerror", None) or str(error)
    with suppress(OSError):
        if of_the_disk(error) and "full" not in said and is_full(path):
            return f"the disk is full ({said})"
    return said


def is_full(path: Path) -> bool:
    """Whether the disk that a file is to be on has no room left. Raises OSError."""
    disk = os.statvfs(path.parent)
    return disk.f_bavail * disk.f_frsize < FULL_BYTES


def of_the_disk(error: Exception) -> bool:
    """Rather than of what is in the file."""
    return getattr(error, "sqlite_errorname", "").startswith(_OF_THE_DISK)


@contextmanager
def _read(path: Path) -> Iterator[None]:
    """Whatever damage makes SQLite, the text or the values raise becomes BadFile."""
    try:
        yield
    except (sqlite3.Error, msgspec.MsgspecError, ValueError, OverflowError, RecursionError) as e:
        if of_the_disk(e):
            raise CouldNotRecord(f"{path}: {why(e, path)}", FREE) from None
        raise BadFile(path, f"cannot be read: {e}", DAMAGED) from None


def is_database(path: Path) -> bool:
    """Whether a file stands there that begins as SQLite's do."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_BEGINS)) == _BEGINS


class CampaignStore:
    """One campaign on disk. Rows are committed one by one: a kill loses none that was written."""

    spec: CampaignSpec  # what it was begun with

    def __init__(self, path: Path, database: str) -> None:
        self.path = path
        self._held = ExitStack()
        # a writer waits for a reader, such as `grasp campaign summary`, this long
        self._db = sqlite3.connect(database, uri=True, isolation_level=None, timeout=30.0)
        self._held.callback(self._db.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._held.close()

    @classmethod
    def create(cls, path: Path, spec: CampaignSpec, places: Sequence[Combination]) -> Self:
        """A new file; raises ConfigError when there is one or somebody makes one, CouldNotRecord
        when it cannot be."""
        with _claimed(path) as lock:
            if path.exists():
                raise ConfigError(
                    str(path), "--out", "exists already", "a new file, or --resume to go on with it"
                )
            return cls._begun(path, spec, places)._keeping(lock)

    @classmethod
    def resume(cls, path: Path, spec: CampaignSpec, places: Sequence[Combination]) -> Self:
        """The file, if it is of this campaign, else ConfigError; a new one if there is none, or
        one that was killed before it held anything. Raises BadFile for a damaged one."""
        with _claimed(path) as lock:
            if not path.exists() or _blank(path):
                return cls._begun(path, spec, places)._keeping(lock)
            store = cls._opened(path, "rw")
            store.rows()  # damage is found before anything is written
            if store.spec != spec or store._hashes() != {p.config.digest() for p in places}:
                store._held.close()
                raise ConfigError(
                    str(path), "--resume", "was begun with another campaign or other settings",
                    "the same campaign file and settings, or another --out",
                )  # fmt: skip
            return store._keeping(lock)

    @classmethod
    def open(cls, path: Path) -> Self:
        """A file that exists, to read it; raises BadFile when it is none of ours or damaged."""
        return cls._opened(path, "ro")

    @classmethod
    def _begun(cls, path: Path, spec: CampaignSpec, places: Sequence[Combination]) -> Self:
        store = None
        try:
            with _written(path):
                make_private_file(path)  # SQLite would ask the umask
                store = cls(path, _database(path, "rw"))
                store._create(spec, places)
                store.spec = spec
        except CouldNotRecord:
            if store is not None:
                store._held.close()
            for part in ("", "-wal", "-shm"):
                path.with_name(path.name + part).unlink(missing_ok=True)
            raise
        return store

    @classmethod
    def _opened(cls, path: Path, mode: str) -> Self:
        if not path.is_file():
            raise BadFile(path, "no such file", FOREIGN)
        with _read(path):
            store = cls(path, _database(path, mode))
            try:
                store._check()
                store.spec = store._begun_with()
            except BaseException:
                store._held.close()
                raise
        return store

    def _keeping(self, lock: ExitStack) -> Self:
        """Write ahead, so that others may read; when the file is closed, let the lock go. What a
        writer that was killed left of a recording is nobody's any more."""
        self._held.push(lock.pop_all())
        self._held.callback(self._db.close)  # before that; twice is once
        self._held.callback(self._settle)
        with _written(self.path):
            self._db.execute("PRAGMA journal_mode=WAL")
        with suppress(OSError):
            for part in self._recordings.glob(partial_of("*.mcap", "*")):
                part.unlink()
        return self

    def _settle(self) -> None:
        """One file again, to be read where nothing can be written; not while others read it."""
        with suppress(sqlite3.Error):
            self._db.execute("PRAGMA busy_timeout=0")
            self._db.execute("PRAGMA wal_checkpoint")
            self._db.execute("PRAGMA journal_mode=DELETE")

    def _create(self, spec: CampaignSpec, places: Sequence[Combination]) -> None:
        self._db.execute("BEGIN")
        self._db.execute("CREATE TABLE campaign (key TEXT PRIMARY KEY, value TEXT, checksum TEXT)")
        self._db.execute(
            "CREATE TABLE configs (config_hash TEXT PRIMARY KEY, settings TEXT, checksum TEXT)"
        )
        self._db.execute(f"CREATE TABLE trials ({_declarations()}, checksum TEXT)")
        self._insert("campaign", "format", FORMAT)
        self._insert("campaign", "spec", msgspec.json.encode(spec).decode())
        for place in {p.config.digest(): p for p in places}.values():
            settings = msgspec.json.encode(place.config).decode()
            self._insert("configs", place.config.digest(), settings)
        self._db.execute("COMMIT")

    def _insert(self, table: str, *values: Any) -> None:
        whole = (*values, checksum(table, values))
        marks = ", ".join("?" * len(whole))
        self._db.execute(f"INSERT OR REPLACE INTO {table} VALUES ({marks})", whole)

    def _check(self) -> None:
        """Raises BadFile unless this is a campaign of this format, whole as a database."""
        tables = {row[0] for row in self._db.execute("SELECT name FROM sqlite_master")}
        if not {"campaign", "configs", "trials"} <= tables:
            raise BadFile(self.path, "not a campaign", FOREIGN)
        found = self._db.execute("SELECT value FROM campaign WHERE key = 'format'").fetchone()
        if found is None or found[0] != FORMAT:
            said = "none" if found is None else found[0]
            raise BadFile(
                self.path, f"format {said!r}, this version reads {FORMAT!r}",
                "open it with the version that made it, or run the campaign again",
            )  # fmt: skip
        (sound,) = self._db.execute("PRAGMA quick_check(1)").fetchone()
        if sound != "ok":
            raise BadFile(self.path, f"damaged: {sound}", DAMAGED)

    def _table(self, table: str, columns: Sequence[str]) -> list[tuple[Any, ...]]:
        """All rows in the order of the first column; raises BadFile if any was changed."""
        names = ", ".join((*columns, "checksum"))
        with _read(self.path):
            found = self._db.execute(f"SELECT {names} FROM {table} ORDER BY 1").fetchall()
            changed = [ascii(row[0]) for row in found if row[-1] != checksum(table, row[:-1])]
        if changed:
            more = f" and {len(changed) - MOST_NAMED} more" if len(changed) > MOST_NAMED else ""
            problem = f"{table}: changed since written: {', '.join(changed[:MOST_NAMED])}{more}"
            raise BadFile(self.path, problem, DAMAGED)
        return [row[:-1] for row in found]

    def _begun_with(self) -> CampaignSpec:
        """Raises BadFile for one of another version."""
        said = dict(self._table("campaign", ("key", "value")))
        try:
            with _read(self.path):
                table = msgspec.json.decode(str(said.get("spec", "")), type=dict[str, Any])
                # an axis that has another name now does no harm where it was empty
                table = {k: values for k, values in table.items() if values or not renamed(k)}
            return load(CampaignSpec, [Layer("spec", table)])
        except ConfigError as error:
            raise BadFile(self.path, str(error), "open it with the version that made it") from None

    def _hashes(self) -> set[str]:
        return {digest for digest, _ in self._table("configs", ("config_hash", "settings"))}

    def settings(self) -> dict[str, dict[str, Any]]:
        """The resolved settings of every combination by their hash, as they were given."""
        found = self._table("configs", ("config_hash", "settings"))
        with _read(self.path):
            return {digest: msgspec.json.decode(text) for digest, text in found}

    def finished(self) -> set[int]:
        """Numbers of the trials that ran; those that errored are not among them."""
        return {row.trial for row in self.rows() if row.status == "done"}

    def add(self, finished: Finished) -> Row:
        """Write the recording, then the row; both are on disk when this returns.

        Raises CouldNotRecord, and leaves neither then.
        """
        row, kept = finished.row, None
        if finished.recording is not None:
            kept = self._keep(row, finished.recording)
            row = msgspec.structs.replace(row, recording=f"{kept.parent.name}/{kept.name}")
        try:
            with _written(self.path):
                self._insert("trials", *_values(row))
        except CouldNotRecord:
            if kept is not None:
                kept.unlink(missing_ok=True)
            raise
        return row

    @property
    def _recordings(self) -> Path:
        return self.path.with_suffix(".recordings")

    def _keep(self, row: Row, recording: bytes) -> Path:
        """The recording's file, beside the campaign's; whole or not at all."""
        folder = self._recordings
        path = folder / f"{row.trial:06d}-{row.scenario}-{row.object}.mcap"
        try:
            make_private_folder(folder)
            write_whole(path, recording, private=True)
        except OSError as error:
            raise CouldNotRecord(
                f"{folder}: {error.strerror}", "free the disk, then go on with --resume"
            ) from None
        return path

    def rows(self) -> list[Row]:
        """All rows by trial number; raises BadFile for a row that was changed, naming it."""
        found = self._table("trials", COLUMNS)
        with _read(self.path):
            return [
                msgspec.convert(dict(zip(COLUMNS, values, strict=True)), Row, strict=False)
                for values in found
            ]

    def write_csv(self, out: TextIO) -> None:
        """All rows as CSV, without the nested columns `result` and `timing`."""
        shown = [name for name in COLUMNS if name not in ("result", "timing")]
        rows = self.rows()
        writer = csv.DictWriter(out, shown, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(msgspec.structs.asdict(row) for row in rows)


def checksum(table: str, values: Sequence[Any]) -> str:
    """Of a row as SQLite gives it back."""
    return hashlib.blake2b(ascii((table, *values)).encode(), digest_size=8).hexdigest()


@contextmanager
def _claimed(path: Path) -> Iterator[ExitStack]:
    """The folder made and the file locked, until the stack is closed or here, on an error."""
    if path.is_dir():  # it may have no name to lock
        raise ConfigError(str(path), "--out", "is a folder", "a new file")
    try:
        make_private_folder(path.parent)
        with suppress(FileNotFoundError):
            path.with_name(f"{path.name}-journal").lstat()  # the longest name that is needed
    except OSError as error:
        if error.errno in LEADS_NOWHERE:
            raise ConfigError(str(path), "--out", str(error.strerror), "another file") from None
        raise CouldNotRecord(f"{path}: {error.strerror}", "choose another --out") from None
    with ExitStack() as lock:
        lock.enter_context(writing(path))
        yield lock


def _database(path: Path, mode: str) -> str:
    return f"{path.absolute().as_uri()}?mode={mode}"


def _blank(path: Path) -> bool:
    """True for a database without any table, and for an empty file."""
    with _read(path), closing(sqlite3.connect(_database(path, "rw"), uri=True)) as db:
        return bool(db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0)


def _declarations() -> str:
    first, *others = Row.__struct_fields__
    columns = [f"{name} {_TYPES[_KINDS[name]]}" for name in others]
    return ", ".join([f"{first} INTEGER PRIMARY KEY", *columns])


def _kind(kind: Any) -> type:
    return next((t for t in getattr(kind, "__args__", (kind,)) if t is not type(None)), str)


_KINDS = {field.name: _kind(field.type) for field in msgspec.structs.fields(Row)}


def _values(row: Row) -> tuple[Any, ...]:
    """The row as SQLite will give it back."""
    return tuple(_plain(getattr(row, name), _KINDS[name]) for name in COLUMNS)


def _plain(value: Any, kind: type) -> Any:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return None
    if kind is str:
        return value.encode(errors="replace").decode()
    return float(value) + 0.0 if kind is float else int(value)  # there is no -0.0
