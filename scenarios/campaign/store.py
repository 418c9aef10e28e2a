"""The SQLite file of a campaign: one row per trial, committed before the next trial begins.

One process at a time may write it; others may read it.
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
from scenarios.campaign.worker import Row

FORMAT = "grasp-campaign 8"
COLUMNS = Row.__struct_fields__
FOREIGN = "give the file of a campaign"
DAMAGED = "restore it from a copy, or run the campaign again into another --out"
FREE = "free disk space or close other users of the file, then continue with --resume"
DISK_ERRORS = ("SQLITE_IOERR", "SQLITE_FULL", "SQLITE_BUSY")
HEADER = b"SQLite format 3\0"
TABLES = {
    "campaign": "CREATE TABLE campaign (key TEXT PRIMARY KEY, value TEXT)",
    "configs": "CREATE TABLE configs (config_hash TEXT PRIMARY KEY, settings TEXT)",
    "trials": f"CREATE TABLE trials ({COLUMNS[0]} INTEGER PRIMARY KEY, {', '.join(COLUMNS[1:])})",
}
MOST_STEPS, STEPS = 3_000, 1_000_000  # of SQLite, which then gives up: about half a minute


@contextmanager
def _write_errors(path: Path) -> Iterator[None]:
    """Turn errors while writing into CouldNotRecord."""
    try:
        yield
    except (sqlite3.Error, OSError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise CouldNotRecord(f"{path}: {why}", FREE) from None


@contextmanager
def _read_errors(path: Path) -> Iterator[None]:
    """Turn every error that a damaged file causes into BadFile, a disk error into
    CouldNotRecord."""
    try:
        yield
    except (sqlite3.Error, msgspec.MsgspecError, ValueError, OverflowError, RecursionError) as e:
        if getattr(e, "sqlite_errorname", "").startswith(DISK_ERRORS):
            raise CouldNotRecord(f"{path}: {e}", FREE) from None
        raise BadFile(path, f"cannot be read: {e}", DAMAGED) from None


def is_database(path: Path) -> bool:
    """Whether the path is a file with SQLite's header."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(HEADER)) == HEADER


class CampaignStore:
    """The file of one campaign. Rows are committed one by one, so that a kill loses none."""

    spec: CampaignSpec  # that the file was created with

    def __init__(self, path: Path) -> None:
        self.path = path
        self._resources = ExitStack()
        # Readers need write access too: SQLite first rolls back a killed writer's last row.
        # Reader and writer wait for each other for up to 30 s.
        uri = f"{path.absolute().as_uri()}?mode=rw"
        self._db = sqlite3.connect(uri, uri=True, isolation_level=None, timeout=30.0)
        self._resources.callback(self._db.close)
        left = iter(range(MOST_STEPS))
        self._db.set_progress_handler(lambda: next(left, None) is None, STEPS)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    @classmethod
    def create(
        cls, path: Path, spec: CampaignSpec, grid: Sequence[Combination], resume: bool = False
    ) -> Self:
        """Create a file, or with ``resume`` open an existing one of the same campaign.

        Raises ConfigError for a file of another campaign and while another process writes it,
        BadFile for a damaged one, and CouldNotRecord where it cannot be written."""
        with _lock(path) as lock:
            if not path.exists():
                with _write_errors(path):
                    write_whole(path, _new_file(spec, grid), private=True)
                return cls.open(path)._keep_lock(lock)
            if not resume:
                raise ConfigError(
                    str(path), "--out", "exists already", "a new file, or --resume to continue it"
                )
            store = cls.open(path)
            digests = {combination.config.digest() for combination in grid}
            with on_failure(store._resources.close):
                store.rows()  # damage is found before anything is written
                if store.spec != spec or store.settings().keys() != digests:
                    was, now = map(msgspec.to_builtins, (store.spec, spec))
                    if was == now:  # a packaged file or one that the campaign names has changed
                        was = next(iter(store.settings().values()))
                        now = msgspec.json.decode(msgspec.json.encode(grid[0].config))
                    raise ConfigError(
                        str(path), "--resume", f"was created with {_difference(was, now)}",
                        "the same campaign file and settings, or another --out",
                    )  # fmt: skip
            return store._keep_lock(lock)

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open an existing file for reading. Raises BadFile for a damaged file or no campaign."""
        if not path.is_file():
            raise BadFile(path, "no such file", FOREIGN)
        with _read_errors(path):
            store = cls(path)
            with on_failure(store._resources.close):
                store._check()
        return store

    def _keep_lock(self, lock: ExitStack) -> Self:
        """Keep the lock until the file is closed; remove a killed writer's partial recordings."""
        self._resources.push(lock.pop_all())
        with suppress(OSError):
            for part in self._recordings.glob(partial_name("*.mcap", "*")):
                part.unlink()
        return self

    def _check(self) -> None:
        """Raises BadFile unless this is an undamaged campaign of this format."""
        stored = "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL LIMIT 10"
        made = sorted(row[0] for row in self._db.execute(stored))
        if TABLES["campaign"] not in made:
            raise BadFile(self.path, "not a campaign", FOREIGN)
        known = dict(self._db.execute("SELECT key, value FROM campaign LIMIT 10").fetchall())
        if known.get("format") != FORMAT:
            raise BadFile(
                self.path, f"format {known.get('format')!r}, this version reads {FORMAT!r}",
                "open it with the version that created it, or run the campaign again",
            )  # fmt: skip
        if made != sorted(TABLES.values()):  # a view, for example, may be endless
            raise BadFile(self.path, "not a campaign: it has other tables or views", FOREIGN)
        (sound,) = self._db.execute("PRAGMA quick_check(1)").fetchone()
        if sound != "ok":
            raise BadFile(self.path, f"damaged: {sound}", DAMAGED)
        self.spec = msgspec.json.decode(str(known.get("spec")), type=CampaignSpec)

    def settings(self) -> dict[str, dict[str, Any]]:
        """The resolved settings of every combination, by their hash."""
        with _read_errors(self.path):
            found = self._db.execute("SELECT config_hash, settings FROM configs").fetchall()
            return {k: msgspec.json.decode(str(text), type=dict[str, Any]) for k, text in found}

    @property
    def rig(self) -> str:
        """Name of the rig of all trials."""
        return str(next(iter(self.settings().values()), {}).get("rig", "unknown"))

    def finished(self) -> set[int]:
        """Numbers of the trials that finished without an error."""
        return {row.trial for row in self.rows() if row.status == "done"}

    def add(self, row: Row, recording: bytes | None = None) -> Row:
        """Write the recording, then the row; both are on disk on return.

        On CouldNotRecord neither is left.
        """
        file = None
        if recording is not None:
            file = self._write_recording(row, recording)
            row = msgspec.structs.replace(row, recording=f"{file.parent.name}/{file.name}")
        try:
            with _write_errors(self.path):
                marks = ", ".join("?" * len(COLUMNS))
                values = [*map(_storable, msgspec.structs.astuple(row))]
                self._db.execute(f"INSERT OR REPLACE INTO trials VALUES ({marks})", values)
        except CouldNotRecord:
            if file is not None:
                file.unlink(missing_ok=True)
            raise
        return row

    @property
    def _recordings(self) -> Path:
        return self.path.with_suffix(".recordings")

    def _write_recording(self, row: Row, recording: bytes) -> Path:
        """Write the recording to the folder beside the campaign's file, atomically."""
        path = self._recordings / f"{row.trial:06d}-{row.scenario}-{row.object}.mcap"
        with _write_errors(self._recordings):
            make_private_folder(self._recordings)
            write_whole(path, recording, private=True)
        return path

    def rows(self) -> list[Row]:
        """All rows in the order of trial numbers; raises BadFile where one cannot be read."""
        with _read_errors(self.path):
            columns = ", ".join(COLUMNS)
            found = self._db.execute(f"SELECT {columns} FROM trials ORDER BY 1").fetchall()
            tables = (dict(zip(COLUMNS, values, strict=True)) for values in found)
            rows = [msgspec.convert(table, Row, strict=False) for table in tables]
            for text in {text for row in rows for text in (row.swept, row.versions or "{}")}:
                msgspec.json.decode(text, type=dict[str, Any])
            return rows

    def write_csv(self, out: TextIO) -> None:
        """All rows as CSV, without the nested columns `result` and `timing`; true is 1."""
        shown = [name for name in COLUMNS if name not in ("result", "timing")]
        writer = csv.DictWriter(out, shown, extrasaction="ignore")
        writer.writeheader()
        for row in self.rows():
            cells = msgspec.structs.asdict(row).items()
            writer.writerow({k: int(v) if isinstance(v, bool) else v for k, v in cells})


def _difference(was: Any, now: Any, key: str = "") -> str:
    """The first value that differs, and both values."""
    if isinstance(was, dict) and isinstance(now, dict):
        for name in was | now:
            if was.get(name) != now.get(name):
                inner = f"{key}.{name}" if key else name
                return _difference(was.get(name), now.get(name), inner)
    return f"{key or 'other settings'} = {was!r}, not {now!r}"


def _new_file(spec: CampaignSpec, grid: Sequence[Combination]) -> bytes:
    """Content of a campaign's file without rows."""
    configs = {c.config.digest(): msgspec.json.encode(c.config).decode() for c in grid}
    known = [("format", FORMAT), ("spec", msgspec.json.encode(spec).decode())]
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as db:
        for statement in TABLES.values():
            db.execute(statement)
        db.executemany("INSERT INTO campaign VALUES (?, ?)", known)
        db.executemany("INSERT INTO configs VALUES (?, ?)", configs.items())
        return db.serialize()


@contextmanager
def _lock(path: Path) -> Iterator[ExitStack]:
    """Make the folder and lock the file; the lock ends with the stack, or on an error in here."""
    if path.is_dir():  # `/` has no name to lock
        raise ConfigError(str(path), "--out", "is a folder", "a new file")
    try:
        make_private_folder(path.parent)
    except OSError as error:
        if error.errno in PATH_ERRORS:
            raise ConfigError(str(path), "--out", str(error.strerror), "another file") from None
        raise CouldNotRecord(f"{path}: {error.strerror}", "choose another --out") from None
    with ExitStack() as lock:
        lock_file = path.resolve().with_name(f"{path.resolve().name}.lock")
        try:
            lock.enter_context(locked(lock_file, PRIVATE_FILE, partial(_in_use, path)))
        except OSError as error:
            raise CouldNotRecord(f"{lock_file}: {error.strerror}", "choose another --out") from None
        yield lock


def _in_use(path: Path, holder: Holder | None) -> ConfigError:
    by = f"process {holder.pid}: {one_line(holder.command)}" if holder else "another process"
    return ConfigError(
        str(path), "--out", f"is being written by {by}",
        "another --out, or wait until that has ended",
    )  # fmt: skip


def _storable(value: Any) -> Any:
    """The value with text that SQLite can store: without lone surrogates."""
    return value.encode(errors="replace").decode() if isinstance(value, str) else value
