"""Recordings of runs: MCAP files with one JSON channel a topic, written chunk by chunk.

A recorder never disturbs a run: it raises no exception into the loop, keeps its first failure and
removes the incomplete file. Equal messages give equal bytes, because times come from the caller. A
writer that is killed leaves a file without an index, whose complete chunks can be read.
"""

import io
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
import zstandard
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from drivers.errors import BadFile
from grasp.files import private_opener
from grasp.run.mcap_writer import COMPRESSION, McapWriter

LIBRARY = "grasp-controller"  # without version, which is in the metadata
METADATA_NAME = "run"
UNIX_NS = "unix_ns"  # of the metadata; 0 if absent
PATH_REMEDY = (
    "give a run's folder, such as runs/NAME (`grasp runs` lists the names), or its .mcap file"
)
CHUNK_MESSAGES = 200  # most that a kill of the process loses: about 0.4 s of a run
# Bounds of what is read, unpacked. A run has 0.3 MB/s and lasts an hour at most (``deadline_s``).
# Its chunks have 0.1 MB, and compression makes it six times smaller.
MOST_CHUNK_BYTES, MOST_BYTES, MOST_RATIO = 8_000_000, 1_200_000_000, 100
RECORD_BYTES = 128  # counted for every record beside its content

Channels = Mapping[str, type[msgspec.Struct]]
_Schema = dict[str, Any]
PLAIN_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string"}


def _viewer_schema(schema: _Schema, defs: _Schema) -> _Schema | None:
    """JSON Schema that MCAP viewers accept: nested objects, no references; None if there is none.

    Viewers reject a whole channel if one property has no plain ``type``. So an optional value is
    described by its type, and a list of lists, a union or a tuple of mixed types is recorded but
    left out of the schema.
    """
    if "$ref" in schema:
        return _viewer_schema(defs[schema["$ref"].rsplit("/", 1)[-1]], defs)
    if "anyOf" in schema:
        options = [option for option in schema["anyOf"] if option.get("type") != "null"]
        return _viewer_schema(options[0], defs) if len(options) == 1 else None
    if "enum" in schema:
        kinds = {type(value) for value in schema["enum"] if value is not None}
        return {"type": PLAIN_TYPES[kinds.pop()]} if len(kinds) == 1 else None
    match schema.get("type"):
        case "object":
            inner = schema.get("properties", {}).items()
            properties = {name: _viewer_schema(value, defs) for name, value in inner}
            described = {name: value for name, value in properties.items() if value is not None}
            return {"type": "object", "properties": described}
        case "array":
            first, *others = schema.get("prefixItems") or [schema.get("items") or {}]
            mixed = any(item != first for item in others)
            items = None if mixed else _viewer_schema(first, defs)
            nested = items is None or items["type"] == "array"
            return None if nested else {"type": "array", "items": items}
        case "boolean" | "integer" | "number" | "string":
            return {key: schema[key] for key in ("type", "contentEncoding") if key in schema}
    return None


@cache
def _schema(kind: type[msgspec.Struct]) -> bytes:
    """JSON Schema of a message for viewers. Raises TypeError for a type without a JSON form."""
    schema = msgspec.json.schema(kind)
    return msgspec.json.encode(_viewer_schema(schema, schema["$defs"]))


class RunRecorder:
    """Writes one run to ``path``. No method raises; check ``failure`` after the run.

    channels: topic to message type; the constructor raises TypeError for a type without a JSON
    form. A message that is not written is a ``failure``. Times are integer nanoseconds of the run's
    clock. In the file they count from 1970, by the metadata's ``unix_ns``, the time at which that
    clock was zero.
    """

    def __init__(
        self,
        path: Path,
        channels: Channels,
        metadata: Mapping[str, str],
        chunk_messages: int = CHUNK_MESSAGES,
    ) -> None:
        self.path = path
        self.failure: Exception | None = None
        self.empty = True  # no message yet
        self._encode = msgspec.json.Encoder(enc_hook=_plain).encode
        self._stream: io.BufferedWriter | None = None
        self._writer: McapWriter | None = None
        self._chunk_messages = chunk_messages
        self._chunk: list[tuple[int, int, bytes]] = []  # channel, time and JSON of each message
        self._topics: dict[str, tuple[type[msgspec.Struct], int]] = {}  # message type, channel
        self._unix_ns = int(metadata.get(UNIX_NS, "0"))
        schemas = {topic: _schema(kind) for topic, kind in channels.items()}
        try:
            self._stream = io.BufferedWriter(io.FileIO(path, "w", opener=private_opener))
            known = dict(sorted(metadata.items()))
            writer = McapWriter(self._stream, LIBRARY, METADATA_NAME, known)
            for topic, kind in channels.items():
                name = getattr(kind, "schema_name", kind.__name__)  # some viewers know by name
                self._topics[topic] = kind, writer.add_channel(topic, name, schemas[topic])
            self._writer = writer
        except Exception as error:
            self._fail(error)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, topic: str, t_ns: int, message: msgspec.Struct) -> None:
        """Append one message; does nothing after a failure."""
        if self._writer is None:
            closed = ValueError(f"{self.path} was closed before the last message")
            self.failure = self.failure or closed
            return
        try:
            kind, channel = self._topics[topic]
            if not isinstance(message, kind):
                raise TypeError(f"{topic} takes {kind.__name__}, not {message!r:.80}")
            self.empty = False
            self._chunk.append((channel, self._unix_ns + t_ns, self._encode(message)))
            if len(self._chunk) >= self._chunk_messages:
                self._writer.write_chunk(self._chunk)
                self._chunk.clear()
        except Exception as error:
            self._fail(error)

    def close(self) -> None:
        """Write the last chunk and the index, and close the file; safe to call twice."""
        writer, self._writer = self._writer, None
        if writer is None or self._stream is None:
            return
        try:
            if self._chunk:
                writer.write_chunk(self._chunk)
            writer.finish()
            self._stream.close()
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Keep the first failure, and remove the file unless it is a device (`/dev/null`)."""
        self.failure = self.failure or error
        self._writer = None
        if self._stream is None:
            return
        with suppress(Exception):
            self._stream.close()
        with suppress(OSError):
            if self.path.is_symlink() or self.path.is_file():
                self.path.unlink()


class RunRecording:
    """Recording in memory: ``metadata``, and messages of ``channels`` decoded as their types.

    ``complete`` is False when the writer was killed and so did not write the last chunk.
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
                    text = record.metadata.get(UNIX_NS, "0")
                    try:
                        unix_ns = int(text)
                    except ValueError:
                        problem = f"damaged recording: {UNIX_NS} is {text!r:.40}"
                        raise BadFile(path, problem, PATH_REMEDY) from None
                case Footer():
                    self.complete = True

    def __iter__(self) -> Iterator[tuple[str, int, Any]]:
        """Topic, time in ns and message, in the order written."""
        for topic, t_ns, data in self._messages:
            if topic in self._decoders:
                yield topic, t_ns, self._decode(topic, data)

    def of(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Time in ns and message of one topic, in the order written."""
        found = (message[1:] for message in self._messages if message[0] == topic)
        return ((t_ns, self._decode(topic, data)) for t_ns, data in found)

    def _decode(self, topic: str, data: bytes) -> Any:
        try:
            return self._decoders[topic].decode(data)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            remedy = "read it with the version that recorded it (see the file's metadata)"
            problem = f"a message on {topic} does not fit: {error}"
            raise BadFile(self.path, problem, remedy) from error


def _plain(value: object) -> Any:
    """Convert a NumPy value to a number or list; raises TypeError for other types."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form")


def _records(path: Path) -> Iterator[McapRecord]:
    """All records up to the end, or to where the writer was killed. Raises BadFile."""
    if path.is_char_device():  # may be endless
        raise BadFile(path, "is no file", PATH_REMEDY)
    try:
        size = path.stat().st_size
        data = path.read_bytes() if size <= MOST_BYTES else b""
    except OSError as error:
        raise BadFile(path, str(error.strerror), PATH_REMEDY) from error
    if size > MOST_BYTES:
        raise BadFile(path, f"{size} bytes, more than {MOST_BYTES}", PATH_REMEDY)
    if not data.startswith(MCAP0_MAGIC):
        problem = "is no MCAP recording" if data else "is empty: its writer never started"
        raise BadFile(path, problem, PATH_REMEDY)
    total, most = len(data), min(MOST_BYTES, MOST_CHUNK_BYTES + MOST_RATIO * len(data))
    try:
        for record in StreamReader(_Truncated(data), emit_chunks=True, validate_crcs=True).records:
            records = [record]
            if isinstance(record, Chunk):
                total += record.uncompressed_size
                records = breakup_chunk(_unpacked(record), validate_crc=True)
            total += RECORD_BYTES * len(records)
            if total > most:
                raise ValueError(f"it unpacks to more than {most} bytes")
            yield from records
    except EndOfFile:
        return  # without a footer
    except Exception as error:  # the library has no base class for errors of damaged files
        remedy = "record again, or restore the file from a copy"
        raise BadFile(path, f"damaged recording: {error}", remedy) from error


def _unpacked(chunk: Chunk) -> Chunk:
    """The chunk without compression. The library would unpack it to any size. Raises ValueError."""
    size, data = chunk.uncompressed_size, chunk.data
    if size > MOST_CHUNK_BYTES:
        raise ValueError(f"a chunk of {size} bytes, more than {MOST_CHUNK_BYTES}")
    if chunk.compression == COMPRESSION:  # one byte more shows a chunk that is larger than it says
        decompressor = zstandard.ZstdDecompressor(max_window_size=1 << 27)
        data = decompressor.stream_reader(data).read(size + 1)
    elif chunk.compression:
        raise ValueError(f"a chunk with compression {chunk.compression!r:.20}, not {COMPRESSION}")
    if len(data) != size:
        raise ValueError(f"a chunk does not unpack to the {size} bytes that it states")
    return replace(chunk, compression="", data=data)


class _Truncated(io.BytesIO):
    """File that may end within a record, where the library would otherwise report damage."""

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size)
        if size is not None and len(data) < size:
            raise EndOfFile
        return data
