"""What viewers draw by themselves: their own schemas, the run's own numbers, and little room."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.json_format import ParseDict
from mcap.reader import make_reader

from grasp.clock import VIRTUAL_EPOCH_NS
from grasp.messages import ARM, GRIPPER, TRUTH
from grasp.recording import RunRecording
from scenarios.lift import lift
from scenarios.trial.run_folder import OF_THE_MACHINE, RESULT, RUN_CHANNELS
from tests.unit.scenarios.conftest import config

THEIRS = {
    "foxglove.Log": Log, "foxglove.FrameTransforms": FrameTransforms,
    "foxglove.SceneUpdate": SceneUpdate, "foxglove.Grid": Grid,
}  # fmt: skip


def lifted(runs: Path, *settings: str) -> Path:
    """The recording of a lift."""
    result = lift.run(config(*settings), 0, runs).result
    assert result is not None and result.recording is not None
    return Path(result.recording)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lifted(tmp_path_factory.mktemp("runs"))


def messages(path: Path) -> dict[str, list[tuple[str, int, dict[str, Any]]]]:
    """By topic: name of the schema, time since 1970, and the JSON object."""
    found = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            found[channel.topic].append((schema.name, message.log_time, json.loads(message.data)))
    return dict(found)


def as_protobuf_has_it(told: Any) -> Any:
    """Times are texts there."""
    if isinstance(told, dict):
        if told.keys() == {"sec", "nsec"}:
            seconds = np.datetime64(told["sec"], "s")
            return f"{seconds}.{told['nsec']:09d}Z"
        return {key: as_protobuf_has_it(value) for key, value in told.items()}
    return [as_protobuf_has_it(each) for each in told] if isinstance(told, list) else told


def test_foxglove_s_own_package_knows_every_field(recording: Path) -> None:
    seen = set()
    for topic, of_topic in messages(recording).items():
        for name, at_ns, told in of_topic:
            if name not in THEIRS:
                assert not name.startswith("foxglove."), topic
                continue
            read = ParseDict(as_protobuf_has_it(told), THEIRS[name]())  # raises for what it lacks
            seen.add(name)
            if isinstance(read, Log | Grid):
                assert read.timestamp.seconds * 10**9 + read.timestamp.nanos <= at_ns
    assert seen == THEIRS.keys()


def test_frames_stand_where_arm_and_fingers_were(recording: Path) -> None:
    own = RunRecording.open(recording, RUN_CHANNELS)
    arm, gripper = dict(own.of(ARM)), dict(own.of(GRIPPER))
    truth = dict(own.of(TRUTH))
    settings = config()
    assert settings.calibration is not None
    heights = []
    for _, at_ns, told in messages(recording)["/tf"]:
        t_ns = at_ns - VIRTUAL_EPOCH_NS
        place = {each["child_frame_id"]: each["translation"] for each in told["transforms"]}
        assert place["hand"]["z"] == pytest.approx(arm[t_ns].position_m[2], abs=1e-4)
        for i, (name, side) in enumerate({"A": -1.0, "B": 1.0, "C": 1.0}.items()):
            closed_m = gripper[t_ns].positions[i] * settings.calibration.m_per_count
            reach_m = side * (settings.contact.half_aperture_m - closed_m)
            assert place[f"finger_{name}"].get("x", 0.0) == pytest.approx(reach_m, abs=1e-4)
        heights.append((place["object"]["z"], truth[t_ns].height_m))
    drawn, known = np.array(heights).T
    np.testing.assert_allclose(drawn - drawn[0], known - known[0], atol=2e-4)
    assert np.ptp(known) > 0.1


def test_the_result_is_attached_and_equal_runs_are_equal_files(
    recording: Path, tmp_path: Path
) -> None:
    with recording.open("rb") as file:
        (attachment,) = make_reader(file).iter_attachments()
    beside = json.loads((recording.parent / RESULT).read_bytes())
    assert attachment.name == RESULT
    told = json.loads(attachment.data)
    assert told == {key: value for key, value in beside.items() if key not in OF_THE_MACHINE}
    assert told["outcome"]
    assert lifted(tmp_path).read_bytes() == recording.read_bytes()
