"""Recordings: what goes in comes out, the same bytes each time, whatever the disk does."""

import json
import math
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import BadFile
from drivers.interfaces import ArmState, GripperState
from grasp.messages import ArmMessage, arm_message, recorded_arm
from grasp.recording import RunRecorder, RunRecording, viewer_schema

ROOT = Path(__file__).parents[3]


class Side(IntEnum):
    LEFT = 0
    RIGHT = 1


class Finger(msgspec.Struct, frozen=True):
    """One finger."""

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


def record(path: Path, count: int = 100, chunk_size: int = 4096) -> list[tuple[str, int, object]]:
    written: list[tuple[str, int, object]] = []
    with RunRecorder(path, CHANNELS, METADATA, chunk_size) as recorder:
        for index in range(count):
            written.append(("/sample", index * 10_000_000, sample(index)))
            written.append(("/event", index * 10_000_000, Event(f"tick {index}")))
            for topic, t_ns, message in written[-2:]:
                recorder.write(topic, t_ns, message)
    assert recorder.failure is None
    return written


def test_what_goes_in_comes_out(tmp_path: Path) -> None:
    written = record(tmp_path / "run.mcap")
    recording = RunRecording.open(tmp_path / "run.mcap", CHANNELS)
    assert list(recording) == written
    assert [message for _, message in recording.of("/event")] == [m for _, _, m in written[1::2]]
    assert recording.metadata == METADATA
    assert recording.complete


def test_a_topic_that_is_not_asked_for_is_left_out(tmp_path: Path) -> None:
    record(tmp_path / "run.mcap", 3)
    recording = RunRecording.open(tmp_path / "run.mcap", {"/event": Event})
    assert [topic for topic, _, _ in recording] == ["/event"] * 3


@given(texts=st.lists(st.text(st.characters(codec="utf-8"), max_size=30), max_size=20))
def test_any_text_survives(texts: list[str], tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("any") / "run.mcap"
    with RunRecorder(path, {"/event": Event}, {}, chunk_size=64) as recorder:
        for index, text in enumerate(texts):
            recorder.write("/event", index, Event(text))
    assert recorder.failure is None
    assert [message.text for _, _, message in RunRecording.open(path, {"/event": Event})] == texts


def test_same_messages_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one.mcap", "two.mcap"):
        record(tmp_path / name)
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()


def test_metadata_order_does_not_matter(tmp_path: Path) -> None:
    for name, metadata in (("one", METADATA), ("two", dict(reversed(METADATA.items())))):
        RunRecorder(tmp_path / name, CHANNELS, metadata).close()
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_numpy_numbers_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RunRecorder(path, {"/finger": Finger}, {}) as recorder:
        recorder.write("/finger", 0, Finger(np.float64(1.5), np.int16(1)))  # type: ignore[arg-type]
    assert recorder.failure is None
    assert list(RunRecording.open(path, {"/finger": Finger})) == [("/finger", 0, Finger(1.5, 1))]


def test_a_device_that_never_ends_is_refused_at_once() -> None:
    with pytest.raises(BadFile, match="is no file"):
        RunRecording.open(Path("/dev/zero"), {})


def test_an_empty_run_is_a_recording(tmp_path: Path) -> None:
    RunRecorder(tmp_path / "run.mcap", CHANNELS, METADATA).close()
    recording = RunRecording.open(tmp_path / "run.mcap", CHANNELS)
    assert recording.complete
    assert recording.metadata == METADATA
    assert list(recording) == []


# Failures


def test_a_full_disk_is_a_failure_and_not_an_exception(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.symlink_to("/dev/full")
    recorder = RunRecorder(path, CHANNELS, METADATA)
    recorder.write("/event", 0, Event("lost"))
    recorder.close()
    assert isinstance(recorder.failure, OSError)
    assert not path.is_symlink()
    assert Path("/dev/full").exists()


@pytest.fixture
def file_limit() -> Iterator[int]:
    """Files end at 16 KiB, as a disk that runs full in the middle of a run."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    limit = 16 * 1024
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    yield limit
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_runs_full_leaves_nothing_half_written(tmp_path: Path, file_limit: int) -> None:
    path = tmp_path / "run.mcap"
    recorder = RunRecorder(path, CHANNELS, METADATA, chunk_size=256)
    for index in range(200):
        recorder.write("/event", index, Event(os.urandom(40).hex() * 4))
    failure = recorder.failure
    recorder.close()
    assert isinstance(failure, OSError)
    assert recorder.failure is failure
    assert not path.exists()


def test_a_disk_that_is_full_at_the_end_leaves_nothing_half_written(
    tmp_path: Path, file_limit: int
) -> None:
    path = tmp_path / "run.mcap"
    recorder = RunRecorder(path, CHANNELS, METADATA, chunk_size=1 << 20)
    for index in range(500):
        recorder.write("/event", index, Event(os.urandom(40).hex()))
    assert recorder.failure is None
    recorder.close()
    assert isinstance(recorder.failure, OSError)
    assert not path.exists()


def test_a_folder_that_is_missing_is_a_failure(tmp_path: Path) -> None:
    with RunRecorder(tmp_path / "none" / "run.mcap", CHANNELS, {}) as recorder:
        recorder.write("/event", 0, Event("lost"))
    assert isinstance(recorder.failure, FileNotFoundError)


@pytest.mark.parametrize(
    ("topic", "t_ns", "message", "kind"),
    [
        ("/unknown", 0, Event("a"), KeyError),
        ("/event", 0, sample(1), TypeError),
        ("/event", 0, Event(object()), TypeError),  # type: ignore[arg-type]
        ("/event", 0, Event("\ud800"), UnicodeEncodeError),
        ("/event", -1, Event("before time began"), Exception),
    ],
)
def test_a_wrong_message_is_a_failure_and_not_an_exception(
    tmp_path: Path, topic: str, t_ns: int, message: msgspec.Struct, kind: type[Exception]
) -> None:
    path = tmp_path / "run.mcap"
    with RunRecorder(path, CHANNELS, METADATA) as recorder:
        recorder.write(topic, t_ns, message)
        recorder.write("/event", 1, Event("after"))
    assert isinstance(recorder.failure, kind)
    assert not path.exists()


def test_a_message_after_the_end_is_dropped_and_the_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorder = RunRecorder(path, CHANNELS, METADATA)
    recorder.write("/event", 0, Event("kept"))
    recorder.close()
    recorder.close()
    assert recorder.failure is None
    recorder.write("/event", 1, Event("late"))
    recorder.close()
    assert isinstance(recorder.failure, ValueError)
    assert [m.text for _, _, m in RunRecording.open(path, CHANNELS)] == ["kept"]


# Killed writers and bad files

KILLED_WRITER = """
import itertools, sys, pathlib, msgspec
sys.path.insert(0, sys.argv[2])
from grasp.recording import RunRecorder

class Event(msgspec.Struct):
    text: str

recorder = RunRecorder(pathlib.Path(sys.argv[1]), {"/event": Event}, {"seed": "7"}, 2048)
for index in itertools.count():
    recorder.write("/event", index, Event(f"tick {index}"))
    if index == 1000:
        print("far enough", flush=True)
        sys.stdin.read()
"""


def test_a_killed_writer_leaves_its_complete_chunks(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", KILLED_WRITER, str(path), str(ROOT)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"far enough\n"
        writer.send_signal(signal.SIGKILL)
    recording = RunRecording.open(path, {"/event": Event})
    texts = [message.text for _, message in recording.of("/event")]
    assert texts == [f"tick {index}" for index in range(len(texts))]
    assert len(texts) > 950  # a chunk of 2 KiB holds 43 of them
    assert not recording.complete
    assert recording.metadata == {"seed": "7"}


def test_a_file_cut_anywhere_gives_a_prefix(tmp_path: Path) -> None:
    written = record(tmp_path / "run.mcap", 20, chunk_size=1024)
    whole = (tmp_path / "run.mcap").read_bytes()
    lengths = []
    for end in range(8, len(whole), 7):
        (tmp_path / "cut.mcap").write_bytes(whole[:end])
        recording = RunRecording.open(tmp_path / "cut.mcap", CHANNELS)
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
        RunRecording.open(path, CHANNELS)


@pytest.mark.parametrize("content", [None, b"", b"\x89MCA", b"{}", b"x" * 1000])
def test_what_is_no_recording_is_refused_with_a_remedy(
    tmp_path: Path, content: bytes | None
) -> None:
    path = tmp_path / "run.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BadFile, match=r"run\.mcap") as caught:
        RunRecording.open(path, CHANNELS)
    assert ".mcap" in caught.value.remedy


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadFile):
        RunRecording.open(tmp_path, {})


def test_a_message_of_another_version_is_refused_by_topic(tmp_path: Path) -> None:
    record(tmp_path / "run.mcap", 1)
    recording = RunRecording.open(tmp_path / "run.mcap", {"/event": Finger})
    with pytest.raises(BadFile, match="/event"):
        list(recording)


# Schemas


def viewer_refuses(schema: dict[str, object], top: bool = True) -> list[str]:
    """What an MCAP viewer's reader of JSON schemas cannot take, by its own rules."""
    if top and schema.get("type") != "object":
        return [f"top level is {schema.get('type')}"]
    problems = []
    properties = schema["properties"]
    assert isinstance(properties, dict)
    for name, value in properties.items():
        kind = value.get("type")
        item = value["items"] if kind == "array" else value
        if item.get("type") == "object":
            problems += viewer_refuses(item, top=False)
        elif item.get("type") not in ("boolean", "integer", "number", "string"):
            problems.append(f"{name}: {value}")
    return problems


@pytest.mark.parametrize("kind", [Sample, Event, Finger, GripperState, ArmState])
def test_a_viewer_can_read_every_schema(kind: type[msgspec.Struct]) -> None:
    schema = viewer_schema(kind)
    assert viewer_refuses(schema) == []
    assert "$ref" not in json.dumps(schema)


def test_schema_describes_what_has_a_plain_type() -> None:
    properties = viewer_schema(Sample)["properties"]
    assert properties["counts"] == {"type": "array", "items": {"type": "integer"}}
    assert properties["phase"] == {"type": "string"}
    assert properties["note"] == {"type": "string"}
    finger = properties["fingers"]["items"]
    assert finger["description"] == "One finger."
    assert finger["properties"]["force_n"] == {"type": "number"}
    assert finger["properties"]["side"]["type"] == "integer"
    assert properties.keys().isdisjoint({"grid", "mixed", "either"})


def test_a_type_without_json_form_is_refused_before_the_run(tmp_path: Path) -> None:
    class Opaque(msgspec.Struct):
        array: np.ndarray

    with pytest.raises(TypeError):
        RunRecorder(tmp_path / "run.mcap", {"/opaque": Opaque}, {})
    assert not (tmp_path / "run.mcap").exists()


def test_what_an_arm_said_that_is_no_number_is_none_again_when_it_is_read() -> None:
    nan = math.nan
    said = ArmState(
        1, 2, (0.1, nan, 0.3), (nan, 0.0, nan), True, False, nan, 0.5, sampled_ns=7
    )  # fmt: skip
    message = msgspec.json.decode(msgspec.json.encode(arm_message(said)), type=ArmMessage)
    assert message.position_m == (0.1, None, 0.3)
    assert repr(recorded_arm(message)) == repr(said)
