"""The SQLite file of a campaign: one row a trial, on the disk before the next one is asked for."""

import csv
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Self, TextIO

import msgspec

from drivers.errors import BadFile, ConfigError, CouldNotRecord
from grasp.settings import Layer, load
from scenarios.campaign.spec import CampaignSpec, Combination
from scenarios.campaign.worker import Finished, Row

FORMAT = "grasp-campaign 1"
_TYPES = {int: "INTEGER", float: "REAL", bool: "INTEGER", str: "TEXT"}
COLUMNS = Row.__struct_fields__


@contextmanager
def _stored(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):
            raise CouldNotRecord(
                f"{path}: {error}", "free the disk or the file, then go on with --resume"
            ) from None
        raise BadFile(path, str(error), "name the file of a campaign") from None


class CampaignStore:
    """One campaign on disk. Rows are committed one by one: a kill loses none that was written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        # a writer waits for a reader, such as `grasp campaign summary`, this long
        self._db = sqlite3.connect(path, isolation_level=None, timeout=30.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._db.close()

    @classmethod
    def create(cls, path: Path, spec: CampaignSpec, places: Sequence[Combination]) -> Self:
        """A new file; raises ConfigError when there is one, CouldNotRecord when it cannot be."""
        if path.exists():
            raise ConfigError(
                str(path), "--out", "exists already", "a new file, or --resume to go on with it"
            )
        return cls._begun(path, spec, places)

    @classmethod
    def _begun(cls, path: Path, spec: CampaignSpec, places: Sequence[Combination]) -> Self:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CouldNotRecord(f"{path}: {error.strerror}", "choose another --out") from None
        with _stored(path):
            store = cls(path)
            store._create(spec, places)
        return store

    def _create(self, spec: CampaignSpec, places: Sequence[Combination]) -> None:
        self._db.execute("PRAGMA journal_mode=WAL")
        self._db.execute("BEGIN")
        self._db.execute("CREATE TABLE campaign (key TEXT PRIMARY KEY, value TEXT)")
        self._db.execute("CREATE TABLE configs (config_hash TEXT PRIMARY KEY, settings TEXT)")
        self._db.execute(f"CREATE TABLE trials ({_declarations()})")
        self._db.executemany(
            "INSERT INTO campaign VALUES (?, ?)",
            (("format", FORMAT), ("spec", msgspec.json.encode(spec).decode())),
        )
        self._db.executemany(
            "INSERT OR IGNORE INTO configs VALUES (?, ?)",
            ((p.config.digest(), msgspec.json.encode(p.config).decode()) for p in places),
        )
        self._db.execute("COMMIT")

    @classmethod
    def open(cls, path: Path) -> Self:
        """A file that exists; raises BadFile when it is none of ours."""
        if not path.is_file():
            raise BadFile(path, "no such file", "name the file of a campaign")
        with _stored(path):
            store = cls(path)
            try:
                if store._said("format") != FORMAT:
                    raise BadFile(
                        path, f"not of format {FORMAT!r}", "open it with the version that made it"
                    )
            except sqlite3.OperationalError:
                store._db.close()
                raise BadFile(path, "not a campaign", "name the file of a campaign") from None
            return store

    @classmethod
    def resume(cls, path: Path, spec: CampaignSpec, places: Sequence[Combination]) -> Self:
        """The file, if it is of this campaign, else ConfigError; a new one if there is none, or
        one that was killed before it held anything."""
        if not path.exists() or _blank(path):
            return cls._begun(path, spec, places)
        store = cls.open(path)
        known = {row[0] for row in store._db.execute("SELECT config_hash FROM configs")}
        if store.spec != spec or known != {p.config.digest() for p in places}:
            store._db.close()
            raise ConfigError(
                str(path), "--resume", "was begun with another campaign or other settings",
                "the same campaign file and settings, or another --out",
            )  # fmt: skip
        return store

    def _said(self, key: str) -> str:
        row = self._db.execute("SELECT value FROM campaign WHERE key = ?", (key,)).fetchone()
        return str(row[0]) if row else ""

    @property
    def spec(self) -> CampaignSpec:
        """Raises BadFile for one of another version."""
        try:
            table = msgspec.json.decode(self._said("spec"), type=dict[str, Any])
            return load(CampaignSpec, [Layer("spec", table)])
        except ConfigError as error:
            raise BadFile(self.path, str(error), "open it with the version that made it") from None

    def finished(self) -> set[int]:
        """Numbers of the trials that ran; those that errored are not among them."""
        found = self._db.execute("SELECT trial FROM trials WHERE status = 'done'")
        return {int(number) for (number,) in found}

    def add(self, finished: Finished) -> Row:
        """Write the recording, then the row; both are on disk when this returns."""
        row = finished.row
        with _stored(self.path):
            if finished.recording is not None:
                row = msgspec.structs.replace(row, recording=self._keep(finished))
            marks = ", ".join("?" * len(COLUMNS))
            self._db.execute(f"INSERT OR REPLACE INTO trials VALUES ({marks})", _values(row))
        return row

    def _keep(self, finished: Finished) -> str:
        """Path of the recording, relative to the file's folder."""
        assert finished.recording is not None  # noqa: S101
        row = finished.row
        name = f"{row.trial:06d}-{row.scenario}-{row.object}.mcap"
        folder = self.path.with_suffix(".recordings")
        try:
            folder.mkdir(exist_ok=True)
            (folder / name).write_bytes(finished.recording)
        except OSError as error:
            raise CouldNotRecord(
                f"{folder}: {error.strerror}", "free the disk, then go on with --resume"
            ) from None
        return f"{folder.name}/{name}"

    def rows(self) -> list[Row]:
        """All rows by trial number."""
        names = ", ".join(COLUMNS)
        with _stored(self.path):
            found = self._db.execute(f"SELECT {names} FROM trials ORDER BY trial").fetchall()
        return [
            msgspec.convert(dict(zip(COLUMNS, values, strict=True)), Row, strict=False)
            for values in found
        ]

    def write_csv(self, out: TextIO) -> None:
        """All rows as CSV, without the nested columns `result` and `timing`."""
        shown = [name for name in COLUMNS if name not in ("result", "timing")]
        writer = csv.DictWriter(out, shown, extrasaction="ignore")
        writer.writeheader()
        for row in self.rows():
            writer.writerow(msgspec.structs.asdict(row))


def _blank(path: Path) -> bool:
    """True for a database without any table, and for an empty file."""
    with _stored(path), closing(sqlite3.connect(path)) as db:
        return bool(db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0)


def _declarations() -> str:
    first, *others = Row.__struct_fields__
    kinds = {field.name: field.type for field in msgspec.structs.fields(Row)}
    columns = [f"{name} {_sql_type(kinds[name])}" for name in others]
    return ", ".join([f"{first} INTEGER PRIMARY KEY", *columns])


def _sql_type(kind: Any) -> str:
    plain = next((t for t in getattr(kind, "__args__", (kind,)) if t is not type(None)), str)
    return _TYPES[plain]


def _values(row: Row) -> tuple[Any, ...]:
    return tuple(getattr(row, name) for name in COLUMNS)
