"""Runs on disk: MCAP files with one JSON channel a topic, written chunk by chunk.

A recorder never disturbs a run: nothing here raises into the loop, the first failure is kept and
the half-written file goes. The same messages give the same bytes: times come from the caller, and
no clock, host name or random number gets in. A writer that is killed leaves a file without its
index; all chunks that were complete are read back.
"""

import contextlib
import io
import itertools
import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Footer, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from drivers.errors import BadFile
from grasp.files import private_opener

_Schema = dict[str, Any]
PLAIN_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string"}


def viewer_schema(kind: type[msgspec.Struct]) -> _Schema:
    """JSON Schema of a message as MCAP viewers read it: nested objects, no references.

    Viewers refuse a whole channel over a property without a plain ``type``: an optional value is
    described by its type, and what has no plain type at all (a list of lists, a union, a tuple of
    mixed types) is left undescribed, which a schema allows; it is recorded all the same.
    """
    schema = msgspec.json.schema(kind)
    plain = _plain_schema(schema, schema.get("$defs", {}), ())
    if plain is None or plain["type"] != "object":
        raise TypeError(f"{kind.__name__} is no JSON object")
    return plain


def schema_name(kind: type[msgspec.Struct]) -> str:
    """What viewers know it by: a type of theirs says so itself."""
    return str(getattr(kind, "schema_name", kind.__name__))


def _plain_schema(schema: _Schema, defs: _Schema, within: tuple[str, ...]) -> _Schema | None:
    """The schema without references, or None when a viewer would refuse it."""
    if (reference := schema.get("$ref")) is not None:
        if reference in within:
            return None
        return _plain_schema(defs[reference.rsplit("/", 1)[-1]], defs, (*within, reference))
    if "anyOf" in schema:
        options = [option for option in schema["anyOf"] if option.get("type") != "null"]
        return _plain_schema(options[0], defs, within) if len(options) == 1 else None
    if "enum" in schema:
        kinds = {type(value) for value in schema["enum"] if value is not None}
        return {"type": PLAIN_TYPES[kinds.pop()]} if len(kinds) == 1 else None
    match schema.get("type"):
        case "object":
            inner = schema.get("properties", {}).items()
            properties = {name: _plain_schema(value, defs, within) for name, value in inner}
            described = {name: value for name, value in properties.items() if value is not None}
            return {"type": "object", "properties": described}
        case "array":
            first, *others = schema.get("prefixItems") or [schema.get("items") or {}]
            mixed = any(item != first for item in others)
            items = None if mixed else _plain_schema(first, defs, within)
            nested = items is None or items["type"] == "array"
            return None if nested else {"type": "array", "items": items}
        case "boolean" | "integer" | "number" | "string":
            return {key: schema[key] for key in ("type", "contentEncoding") if key in schema}
    return None


LIBRARY = "grasp-controller"  # fixed: the libraries' versions belong in the metadata
METADATA_NAME = "run"
UNIX_NS = "unix_ns"  # of the metadata; a file without it counts from nought
FILE_WANTED = "give the path of a run's .mcap file"
CHUNK_BYTES = 32 * 1024  # at most this much is lost to a kill: about half a second of a run

Channels = Mapping[str, type[msgspec.Struct]]


class RunRecorder:
    """Writes one run to ``path``. No method raises; look at ``failure`` when the run is over.

    channels: topic to message type; a type that has no JSON form is a TypeError here, before
    anything runs. A message that is not written is a ``failure``. Times are integer nanoseconds of
    the run's own clock; in the file they count from 1970, by ``unix_ns`` of the metadata, the
    instant at which that clock stood at nought.
    """

    def __init__(
        self,
        path: Path,
        channels: Channels,
        metadata: Mapping[str, str],
        chunk_size: int = CHUNK_BYTES,
    ) -> None:
        self.path = path
        self.failure: Exception | None = None
        self._kinds = dict(channels)
        self._encode = msgspec.json.Encoder(enc_hook=_plain).encode
        self._stream: _Unbuffered | None = None
        self._writer: Writer | None = None
        self._topics: dict[str, tuple[int, Iterator[int]]] = {}
        self._unix_ns = int(metadata.get(UNIX_NS, "0"))
        schemas = {
            topic: msgspec.json.encode(viewer_schema(kind)) for topic, kind in channels.items()
        }
        try:
            self._start(schemas, metadata, chunk_size)
        except Exception as error:
            self._fail(error)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, topic: str, t_ns: int, message: msgspec.Struct) -> None:
        """Append one message; after a failure nothing more is written."""
        if self._writer is None:
            self.failure = self.failure or ValueError(
                f"{self.path} was closed before the last message"
            )
            return
        try:
            if not isinstance(message, self._kinds[topic]):
                raise TypeError(f"{topic} takes {self._kinds[topic].__name__}, not {message!r:.80}")
            channel_id, sequence = self._topics[topic]
            at_ns = self._unix_ns + t_ns
            data = self._encode(message)
            self._writer.add_message(channel_id, at_ns, data, at_ns, next(sequence))
        except Exception as error:
            self._fail(error)

    def close(self) -> None:
        """Write the index and close the file. Twice is once."""
        writer, self._writer = self._writer, None
        if writer is None or self._stream is None:
            return
        try:
            writer.finish()
            self._stream.close()
        except Exception as error:
            self._fail(error)

    def _start(
        self, schemas: Mapping[str, bytes], metadata: Mapping[str, str], chunk_size: int
    ) -> None:
        self._stream = _Unbuffered(io.FileIO(self.path, "w", opener=private_opener))
        writer = Writer(self._stream, chunk_size=chunk_size, compression=CompressionType.ZSTD)
        writer.start(profile="", library=LIBRARY)
        writer.add_metadata(METADATA_NAME, dict(sorted(metadata.items())))
        for topic, schema in schemas.items():
            schema_id = writer.register_schema(
                schema_name(self._kinds[topic]), "jsonschema", schema
            )
            channel_id = writer.register_channel(topic, "json", schema_id)
            self._topics[topic] = channel_id, itertools.count()
        self._writer = writer

    def _fail(self, error: Exception) -> None:
        self.failure = self.failure or error
        self._writer = None
        if self._stream is None:
            return
        with contextlib.suppress(Exception):
            self._stream.close()
        with contextlib.suppress(OSError):
            _remove_file(self.path)


class RunRecording:
    """One recording in memory: ``metadata``, and messages decoded as their types.

    ``complete`` is False when the writer was killed: the last chunk is missing then.
    """

    def __init__(self, path: Path, channels: Channels) -> None:
        self.path = path
        self.metadata: dict[str, str] = {}
        self.complete = False
        self._messages: list[tuple[str, int, bytes]] = []
        self._decoders = {topic: msgspec.json.Decoder(kind) for topic, kind in channels.items()}
        topics: dict[int, str] = {}
        unix_ns = 0
        for record in _records(path):
            match record:
                case Message():
                    topic, t_ns = topics[record.channel_id], record.log_time - unix_ns
                    self._messages.append((topic, t_ns, record.data))
                case Channel():
                    topics[record.id] = record.topic
                case Metadata(name=name) if name == METADATA_NAME:
                    self.metadata = record.metadata
                    unix_ns = _unix_ns(path, record.metadata)
                case Footer():
                    self.complete = True

    @classmethod
    def open(cls, path: Path, channels: Channels) -> Self:
        """Read ``path``; topics that ``channels`` does not name are left out."""
        return cls(path, channels)

    def __iter__(self) -> Iterator[tuple[str, int, Any]]:
        """Topic, time in ns and message, in the order written."""
        for topic, t_ns, data in self._messages:
            if topic in self._decoders:
                yield topic, t_ns, self._decode(topic, data)

    def of(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Time in ns and message of one topic, in the order written."""
        return (
            (t_ns, self._decode(name, data)) for name, t_ns, data in self._messages if name == topic
        )

    def _decode(self, topic: str, data: bytes) -> Any:
        try:
            return self._decoders[topic].decode(data)
        except (msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise BadFile(
                self.path,
                f"a message on {topic} does not fit: {error}",
                "read it with the version that recorded it (see the file's metadata)",
            ) from error


def _plain(value: object) -> Any:
    """A number or list for what numpy computed."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form")


class _Unbuffered(io.BufferedWriter):
    """Hands every write to the kernel at once: what was written survives a kill."""

    def write(self, data: Any, /) -> int:
        count: int = super().write(data)
        self.flush()
        return count


def _remove_file(path: Path) -> None:
    """Remove a file or a link, never a device (a run may be recorded to /dev/null)."""
    mode = os.lstat(path).st_mode
    if stat.S_ISREG(mode) or stat.S_ISLNK(mode):
        path.unlink()


def _unix_ns(path: Path, metadata: Mapping[str, str]) -> int:
    text = metadata.get(UNIX_NS, "0")
    try:
        return int(text)
    except ValueError:
        raise BadFile(path, f"damaged recording: {UNIX_NS} is {text!r:.40}", FILE_WANTED) from None


def _records(path: Path) -> Iterator[McapRecord]:
    stream = _Cut(_load(path))
    try:
        yield from StreamReader(stream, validate_crcs=True).records
    except EndOfFile:
        return  # the writer was killed: there is no footer
    except Exception as error:  # the library names no base for what damage may raise
        raise BadFile(
            path, f"damaged recording: {error}", "record again, or restore the file from a copy"
        ) from error


class _Cut(io.BytesIO):
    """A file that may end in the middle of a record: the library takes that for damage."""

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size)
        if size is not None and len(data) < size:
            raise EndOfFile
        return data


def _load(path: Path) -> bytes:
    if path.is_char_device():  # which may never end
        raise BadFile(path, "is no file", FILE_WANTED)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadFile(path, str(error.strerror), FILE_WANTED) from error
    if data.startswith(MCAP0_MAGIC):
        return data
    problem = "is no MCAP recording" if data else "is empty: its writer never started"
    raise BadFile(path, problem, FILE_WANTED)
