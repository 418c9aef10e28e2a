"""Recordings: written messages are read back, with equal bytes each time; full disks; damage."""

import math
import os
import resource
import tracemalloc
from collections.abc import Iterator
from enum import IntEnum
from itertools import count
from pathlib import Path
from typing import Literal

import msgspec
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.writer import MCAP0_MAGIC, Writer

from drivers.errors import BadFile
from drivers.interfaces import ArmState
from grasp.run.mcap_writer import LEVEL
from grasp.run.messages import ArmMessage, arm_message, recorded_arm
from grasp.run.recording import LIBRARY, METADATA_NAME, RunRecorder, RunRecording


class Side(IntEnum):
    LEFT = 0
    RIGHT = 1


class Finger(msgspec.Struct, frozen=True):
    """Values of one finger."""

    force_n: float
    side: Side


class Sample(msgspec.Struct, frozen=True):
    counts: tuple[int, ...]
    fingers: tuple[Finger, Finger]
    t_s: float
    phase: Literal["lift", "hold"] = "lift"
    note: str | None = None
    grid: tuple[tuple[int, ...], ...] = ()
    mixed: tuple[int, str] = (1, "a")
    either: int | str = 0


class Event(msgspec.Struct, frozen=True):
    text: str


CHANNELS = {"/sample": Sample, "/event": Event}
METADATA = {"seed": "1", "commit": "abc", "config": "[grasp]\nforce_n = 1\n"}


def sample(index: int) -> Sample:
    fingers = (Finger(0.1 * index, Side.LEFT), Finger(0.2, Side.RIGHT))
    return Sample(tuple(range(index, index + 20)), fingers, 0.01 * index)


def record(
    path: Path, samples: int = 100, chunk_messages: int = 9
) -> list[tuple[str, int, object]]:
    written: list[tuple[str, int, object]] = []
    with RunRecorder(path, CHANNELS, METADATA, chunk_messages) as recorder:
        for index in range(samples):
            written.append(("/sample", index * 10_000_000, sample(index)))
            written.append(("/event", index * 10_000_000, Event(f"tick {index}")))
            for topic, t_ns, message in written[-2:]:
                recorder.write(topic, t_ns, message)
    assert recorder.failure is None
    return written


def test_written_messages_are_read_back(tmp_path: Path) -> None:
    written = record(tmp_path / "run.mcap")
    recording = RunRecording(tmp_path / "run.mcap", CHANNELS)
    assert list(recording) == written
    assert [message for _, message in recording.of("/event")] == [m for _, _, m in written[1::2]]
    assert recording.metadata == METADATA
    assert recording.complete


def test_same_messages_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one.mcap", "two.mcap"):
        record(tmp_path / name)
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()


def test_the_bytes_are_those_of_the_mcap_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zstandard, "compress", zstandard.ZstdCompressor(LEVEL).compress)
    written = record(tmp_path / "run.mcap", 20, chunk_messages=9)
    library = Writer(str(tmp_path / "library.mcap"))
    library.start(library=LIBRARY)
    library.add_metadata(METADATA_NAME, dict(sorted(METADATA.items())))
    with (tmp_path / "run.mcap").open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        library.register_schema(schema.name, schema.encoding, schema.data)
        library.register_channel(channel.topic, "json", channel.schema_id)
    numbers, counts = {"/sample": 1, "/event": 2}, {"/sample": count(), "/event": count()}
    for i, (topic, t_ns, message) in enumerate(written):
        if i % 9 == 0:
            library.flush()
        data = msgspec.json.encode(message)
        library.add_message(numbers[topic], t_ns, data, t_ns, next(counts[topic]))
    library.finish()
    assert (tmp_path / "run.mcap").read_bytes() == (tmp_path / "library.mcap").read_bytes()


# Failures


@pytest.fixture
def file_limit() -> Iterator[int]:
    """Limit files to 16 KiB, like a disk that becomes full during a run."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    limit = 16 * 1024
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    yield limit
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_runs_full_leaves_nothing_half_written(tmp_path: Path, file_limit: int) -> None:
    path = tmp_path / "run.mcap"
    recorder = RunRecorder(path, CHANNELS, METADATA, chunk_messages=2)
    for index in range(200):
        recorder.write("/event", index, Event(os.urandom(40).hex() * 4))
    failure = recorder.failure
    recorder.close()
    assert isinstance(failure, OSError)
    assert recorder.failure is failure
    assert not path.exists()


def test_a_wrong_message_is_a_failure_and_not_an_exception(tmp_path: Path) -> None:
    for topic, message in (("/unknown", Event("a")), ("/event", sample(1))):
        with RunRecorder(tmp_path / "run.mcap", CHANNELS, METADATA) as recorder:
            recorder.write(topic, 0, message)
            recorder.write("/event", 1, Event("after"))
        assert isinstance(recorder.failure, KeyError | TypeError), topic
        assert not (tmp_path / "run.mcap").exists(), topic


# Killed writers and bad files


def test_a_truncated_file_gives_a_prefix_of_the_messages(tmp_path: Path) -> None:
    written = record(tmp_path / "run.mcap", 20, chunk_messages=9)
    whole = (tmp_path / "run.mcap").read_bytes()
    lengths = []
    for end in range(8, len(whole), 13):
        (tmp_path / "cut.mcap").write_bytes(whole[:end])
        recording = RunRecording(tmp_path / "cut.mcap", CHANNELS)
        messages = list(recording)
        assert messages == written[: len(messages)]
        lengths.append(len(messages))
    assert lengths == sorted(lengths)
    assert lengths[0] == 0
    assert lengths[-1] == len(written)


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    record(path, 50)
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(BadFile, match="damaged"):
        RunRecording(path, CHANNELS)


@pytest.mark.parametrize("stated", [20_000_000, 1_000])
def test_a_chunk_that_unpacks_to_too_much_is_refused_unread(tmp_path: Path, stated: int) -> None:
    packed = zstandard.compress(bytes(20_000_000))
    builder = RecordBuilder()
    builder.write(MCAP0_MAGIC)
    Chunk("zstd", packed, 0, 0, 0, stated).write(builder)
    path = tmp_path / "run.mcap"
    path.write_bytes(builder.end())
    tracemalloc.start()
    with pytest.raises(BadFile, match=f"chunk .*{stated} bytes"):
        RunRecording(path, CHANNELS)
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


def test_many_chunks_that_unpack_to_too_much_are_refused(tmp_path: Path) -> None:
    builder = RecordBuilder()
    builder.write(MCAP0_MAGIC)
    for _ in range(30):
        Chunk("zstd", zstandard.compress(bytes(900_000)), 0, 0, 0, 900_000).write(builder)
    path = tmp_path / "run.mcap"
    path.write_bytes(builder.end())
    with pytest.raises(BadFile, match=r"unpacks to more than 8\d{6} bytes"):
        RunRecording(path, CHANNELS)


@pytest.mark.parametrize("content", [None, b"", b"\x89MCA", b"{}", b"x" * 1000])
def test_other_files_are_refused_with_a_remedy(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "run.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BadFile, match=r"run\.mcap") as caught:
        RunRecording(path, CHANNELS)
    assert ".mcap" in caught.value.remedy


# Schemas


def test_nan_in_an_arm_state_survives_recording() -> None:
    nan = math.nan
    recorded = ArmState(
        1, 2, (0.1, nan, 0.3), (nan, 0.0, nan), True, False, nan, 0.5, sampled_ns=7,
        joints_rad=(0.1, nan, 0.3, 0.4, 0.5, 0.6),
    )  # fmt: skip
    message = msgspec.json.decode(msgspec.json.encode(arm_message(recorded)), type=ArmMessage)
    assert message.position_m == (0.1, None, 0.3)
    assert repr(recorded_arm(message)) == repr(recorded)
