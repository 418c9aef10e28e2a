"""Writes MCAP files with JSON messages in zstd chunks.

The library `mcap` writes the same records in three times the time.
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from io import BufferedWriter

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

COMPRESSION = "zstd"
LEVEL = 1  # between control steps a third of the default level's time, for files of the same size
# opcode, length of the rest, channel, sequence number, time of logging, time of publishing
MESSAGE = struct.Struct("<BQHIQQ")
FIXED_BYTES = MESSAGE.size - struct.calcsize("<BQ")  # of its length, before the JSON


class McapWriter:
    """Writes one file: first the channels, then chunks of messages, then ``finish``.

    Each chunk reaches the kernel at once, so that it survives a kill of the process.
    """

    def __init__(
        self, stream: BufferedWriter, library: str, metadata_name: str, metadata: Mapping[str, str]
    ) -> None:
        self._stream = stream
        self._compress = zstandard.ZstdCompressor(LEVEL).compress
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._counts: dict[int, int] = {}  # messages of each channel
        self._write(MCAP0_MAGIC + _encoded([Header("", library)]))
        record = _encoded([Metadata(metadata_name, dict(metadata))])
        self._metadata = MetadataIndex(
            offset=self._stream.tell(), length=len(record), name=metadata_name
        )
        self._write(record)

    def add_channel(self, topic: str, schema_name: str, schema: bytes) -> int:
        """Add a channel of JSON messages, before the first chunk; returns its number."""
        number = len(self._channels) + 1
        self._schemas.append(
            Schema(id=number, name=schema_name, encoding="jsonschema", data=schema)
        )
        self._channels.append(
            Channel(id=number, topic=topic, message_encoding="json", schema_id=number, metadata={})
        )
        return number

    def write_chunk(self, messages: Sequence[tuple[int, int, bytes]]) -> None:
        """Write messages, at least one: channel, time in ns since 1970, and JSON."""
        content, pack, counts = bytearray(self._definitions()), MESSAGE.pack, self._counts
        index: dict[int, list[int]] = {}  # by channel: time and offset of each message, in turn
        for channel, t_ns, data in messages:
            sequence = counts.get(channel, 0)
            counts[channel] = sequence + 1
            index.setdefault(channel, []).extend((t_ns, len(content)))
            length = FIXED_BYTES + len(data)
            content += pack(Opcode.MESSAGE, length, channel, sequence, t_ns, t_ns)
            content += data
        times = [t_ns for _, t_ns, _ in messages]
        chunk = Chunk(
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_size=len(content),
            uncompressed_crc=zlib.crc32(content),
            compression=COMPRESSION,
            data=self._compress(content),
        )
        self._write_with_index(chunk, index)

    def _definitions(self) -> bytes:
        """Schemas and channels, for the first chunk."""
        pairs = zip(self._schemas, self._channels, strict=True)
        return b"" if self._chunks else _encoded([record for pair in pairs for record in pair])

    def _write_with_index(self, chunk: Chunk, index: Mapping[int, Sequence[int]]) -> None:
        start, written = self._stream.tell(), _encoded([chunk])
        length, offsets = len(written), dict[int, int]()
        for channel, places in index.items():
            offsets[channel] = start + len(written)
            written += _message_index(channel, places)
        self._write(written)
        self._chunks.append(
            ChunkIndex(
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                chunk_start_offset=start,
                chunk_length=length,
                message_index_offsets=offsets,
                message_index_length=len(written) - length,
                compression=COMPRESSION,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
            )
        )

    def finish(self) -> None:
        """Write the index of the whole file; does not close the stream."""
        self._write(_encoded([DataEnd(0)]))
        start, summary, offsets = self._stream.tell(), b"", []
        groups: tuple[tuple[Opcode, Sequence[McapRecord]], ...] = (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, []),
            (Opcode.METADATA_INDEX, [self._metadata]),
        )
        for opcode, records in groups:
            group = _encoded(records)
            offsets.append(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offsets_start = start + len(summary)
        summary += _encoded(offsets)
        footer = Footer(start, offsets_start, 0)
        footer.summary_crc = zlib.crc32(summary + _encoded([footer])[:-4])  # all but the sum itself
        self._write(summary + _encoded([footer]) + MCAP0_MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            metadata_count=1,
            schema_count=len(self._schemas),
        )

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._stream.flush()


def _encoded(records: Sequence[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    encoded: bytes = builder.end()
    return encoded


def _message_index(channel: int, places: Sequence[int]) -> bytes:
    """Record with the times and offsets of a channel's messages in the chunk before it."""
    length = 8 * len(places)
    pattern = f"<BQHI{len(places)}Q"
    return struct.pack(pattern, Opcode.MESSAGE_INDEX, 6 + length, channel, length, *places)
