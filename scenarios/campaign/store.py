"""The SQLite file of a campaign: one row a trial, on the disk before the next trial begins.

One process writes it at a time; others may read it.
"""

import csv
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Self, TextIO

import msgspec

from drivers.errors import BadFile, ConfigError, CouldNotRecord, on_failure, one_line
from grasp.files import (
    PATH_ERRORS,
    PRIVATE_FILE,
    Holder,
    locked,
    make_private_folder,
    partial_name,
    write_whole,
)
from scenarios.campaign.spec import CampaignSpec, Combination
from scenarios.campaign.worker import Finished, Row

FORMAT = "grasp-campaign 7"
COLUMNS = Row.__struct_fields__
FOREIGN = "name the file of a campaign"
DAMAGED = "restore it from a copy, or run the campaign again into another --out"
FREE = "free the disk or the file, then go on with --resume"
DISK_ERRORS = ("SQLITE_IOERR", "SQLITE_FULL", "SQLITE_BUSY")
BEGINS = b"SQLite format 3\0"


@contextmanager
def _written(path: Path) -> Iterator[None]:
    try:
        yield
    except (sqlite3.Error, OSError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise CouldNotRecord(f"{path}: {why}", FREE) from None


@contextmanager
def _read(path: Path) -> Iterator[None]:
    """Whatever damage makes SQLite, the text or the values raise becomes BadFile."""
    try:
        yield
    except (sqlite3.Error, msgspec.MsgspecError, ValueError, OverflowError, RecursionError) as e:
        if getattr(e, "sqlite_errorname", "").startswith(DISK_ERRORS):
            raise CouldNotRecord(f"{path}: {e}", FREE) from None
        raise BadFile(path, f"cannot be read: {e}", DAMAGED) from None


def is_database(path: Path) -> bool:
    """Whether a file is there that begins as SQLite's do."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(BEGINS)) == BEGINS


class CampaignStore:
    """One campaign on disk. Rows are committed one by one: a kill loses none that was written."""

    spec: CampaignSpec  # what it was begun with

    def __init__(self, path: Path) -> None:
        self.path = path
        self._held = ExitStack()
        # A reader opens it to write too: half of a killed writer's last row is taken back first.
        # Reader and writer wait for each other for up to 30 s.
        uri = f"{path.absolute().as_uri()}?mode=rw"
        self._db = sqlite3.connect(uri, uri=True, isolation_level=None, timeout=30.0)
        self._held.callback(self._db.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._held.close()

    @classmethod
    def create(
        cls, path: Path, spec: CampaignSpec, places: Sequence[Combination], resume: bool = False
    ) -> Self:
        """A new file; with ``resume`` the one that is there, if it is of this campaign. Raises
        ConfigError for another and while another process writes it, BadFile for a damaged one, and
        CouldNotRecord when it cannot be made."""
        with _claimed(path) as lock:
            if not path.exists():
                with _written(path):
                    write_whole(path, _new_file(spec, places), private=True)
                return cls.open(path)._keeping(lock)
            if not resume:
                raise ConfigError(
                    str(path), "--out", "exists already", "a new file, or --resume to go on with it"
                )
            store = cls.open(path)
            store.rows()  # damage is found before anything is written
            if store.spec != spec or store.settings().keys() != {p.config.digest() for p in places}:
                store._held.close()
                raise ConfigError(
                    str(path), "--resume", "was begun with another campaign or other settings",
                    "the same campaign file and settings, or another --out",
                )  # fmt: skip
            return store._keeping(lock)

    @classmethod
    def open(cls, path: Path) -> Self:
        """A file that exists, to read it. Raises BadFile when it is damaged or no campaign."""
        if not path.is_file():
            raise BadFile(path, "no such file", FOREIGN)
        with _read(path):
            store = cls(path)
            with on_failure(store._held.close):
                store._check()
        return store

    def _keeping(self, lock: ExitStack) -> Self:
        """Keep the lock until the file is closed; remove what a killed writer left of a
        recording."""
        self._held.push(lock.pop_all())
        with suppress(OSError):
            for part in self._recordings.glob(partial_name("*.mcap", "*")):
                part.unlink()
        return self

    def _check(self) -> None:
        """Raises BadFile unless this is a campaign of this format, whole as a database."""
        tables = {row[0] for row in self._db.execute("SELECT name FROM sqlite_master")}
        if not {"campaign", "configs", "trials"} <= tables:
            raise BadFile(self.path, "not a campaign", FOREIGN)
        known = dict(self._db.execute("SELECT key, value FROM campaign").fetchall())
        if known.get("format") != FORMAT:
            raise BadFile(
                self.path, f"format {known.get('format')!r}, this version reads {FORMAT!r}",
                "open it with the version that made it, or run the campaign again",
            )  # fmt: skip
        (sound,) = self._db.execute("PRAGMA quick_check(1)").fetchone()
        if sound != "ok":
            raise BadFile(self.path, f"damaged: {sound}", DAMAGED)
        self.spec = msgspec.json.decode(str(known.get("spec")), type=CampaignSpec)

    def settings(self) -> dict[str, dict[str, Any]]:
        """The resolved settings of every combination by their hash, as they were given."""
        with _read(self.path):
            found = self._db.execute("SELECT config_hash, settings FROM configs").fetchall()
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
                marks = ", ".join("?" * len(COLUMNS))
                values = [*map(_plain, msgspec.structs.astuple(row))]
                self._db.execute(f"INSERT OR REPLACE INTO trials VALUES ({marks})", values)
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
        path = self._recordings / f"{row.trial:06d}-{row.scenario}-{row.object}.mcap"
        with _written(self._recordings):
            make_private_folder(self._recordings)
            write_whole(path, recording, private=True)
        return path

    def rows(self) -> list[Row]:
        """All rows by trial number; raises BadFile where one cannot be read."""
        with _read(self.path):
            columns = ", ".join(COLUMNS)
            found = self._db.execute(f"SELECT {columns} FROM trials ORDER BY 1").fetchall()
            tables = (dict(zip(COLUMNS, values, strict=True)) for values in found)
            return [msgspec.convert(table, Row, strict=False) for table in tables]

    def write_csv(self, out: TextIO) -> None:
        """All rows as CSV, without the nested columns `result` and `timing`."""
        shown = [name for name in COLUMNS if name not in ("result", "timing")]
        writer = csv.DictWriter(out, shown, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(msgspec.structs.asdict(row) for row in self.rows())


def _new_file(spec: CampaignSpec, places: Sequence[Combination]) -> bytes:
    """A campaign's file without a row."""
    trial, *others = COLUMNS
    configs = {p.config.digest(): msgspec.json.encode(p.config).decode() for p in places}
    known = [("format", FORMAT), ("spec", msgspec.json.encode(spec).decode())]
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as db:
        db.execute("CREATE TABLE campaign (key TEXT PRIMARY KEY, value TEXT)")
        db.execute("CREATE TABLE configs (config_hash TEXT PRIMARY KEY, settings TEXT)")
        db.execute(f"CREATE TABLE trials ({trial} INTEGER PRIMARY KEY, {', '.join(others)})")
        db.executemany("INSERT INTO campaign VALUES (?, ?)", known)
        db.executemany("INSERT INTO configs VALUES (?, ?)", configs.items())
        return db.serialize()


@contextmanager
def _claimed(path: Path) -> Iterator[ExitStack]:
    """The folder made and the file locked, until the stack is closed or here, on an error."""
    if path.is_dir():  # it may have no name to lock
        raise ConfigError(str(path), "--out", "is a folder", "a new file")
    try:
        make_private_folder(path.parent)
    except OSError as error:
        if error.errno in PATH_ERRORS:
            raise ConfigError(str(path), "--out", str(error.strerror), "another file") from None
        raise CouldNotRecord(f"{path}: {error.strerror}", "choose another --out") from None
    with ExitStack() as lock:
        beside = path.resolve().with_name(f"{path.resolve().name}.lock")
        try:
            lock.enter_context(locked(beside, PRIVATE_FILE, partial(_held, path)))
        except OSError as error:
            raise CouldNotRecord(f"{beside}: {error.strerror}", "choose another --out") from None
        yield lock


def _held(path: Path, holder: Holder | None) -> ConfigError:
    by = f"process {holder.pid}: {one_line(holder.command)}" if holder else "another process"
    return ConfigError(
        str(path), "--out", f"is being written by {by}",
        "another --out, or wait until that has ended",
    )  # fmt: skip


def _plain(value: Any) -> Any:
    """What SQLite can hold: text without half characters."""
    return value.encode(errors="replace").decode() if isinstance(value, str) else value
