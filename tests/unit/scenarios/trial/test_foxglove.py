"""Messages for viewers: frames at the positions of arm, fingers and object."""

import json
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from grasp.run.clock import VIRTUAL_EPOCH_NS
from grasp.run.messages import ARM, GRIPPER, TRUTH
from grasp.run.recording import RunRecording
from grasp.settings import config_dir
from scenarios.lift.lift import lift
from scenarios.trial.run_folder import RUN_CHANNELS
from scenarios.world.settings import HALF_APERTURE_M
from tests.unit.scenarios.conftest import config


def lifted(runs: Path, *settings: str) -> Path:
    """The recording of a lift."""
    result = lift.run(config(*settings), 0, runs).result
    assert result is not None and result.recording is not None
    return Path(result.recording)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lifted(tmp_path_factory.mktemp("runs"))


def messages(path: Path) -> dict[str, list[tuple[str, int, dict[str, Any]]]]:
    """Messages by topic: name of the schema, time since 1970, and JSON object."""
    found = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            found[channel.topic].append((schema.name, message.log_time, json.loads(message.data)))
    return dict(found)


def test_frames_have_the_recorded_positions_of_arm_fingers_and_object(recording: Path) -> None:
    run = RunRecording(recording, RUN_CHANNELS)
    arm, gripper = dict(run.of(ARM)), dict(run.of(GRIPPER))
    truth = dict(run.of(TRUTH))
    settings = config()
    assert settings.calibration is not None
    heights = []
    for _, at_ns, message in messages(recording)["/tf"]:
        t_ns = at_ns - VIRTUAL_EPOCH_NS
        place = {each["child_frame_id"]: each["translation"] for each in message["transforms"]}
        assert place["hand"]["z"] == pytest.approx(arm[t_ns].position_m[2], abs=1e-4)
        for i, (name, side) in enumerate({"A": -1.0, "B": 1.0, "C": 1.0}.items()):
            closed_m = gripper[t_ns].positions[i] * settings.calibration.m_per_count
            reach_m = side * (HALF_APERTURE_M - closed_m)
            assert place[f"finger_{name}"].get("x", 0.0) == pytest.approx(reach_m, abs=1e-4)
        heights.append((place["object"]["z"], truth[t_ns].height_m))
    drawn, known = np.array(heights).T
    np.testing.assert_allclose(drawn - drawn[0], known - known[0], atol=2e-4)
    assert np.ptp(known) > 0.1


def test_curves_of_the_packaged_layout_are_fields_of_a_recording(recording: Path) -> None:
    layout = (config_dir() / "viewers" / "foxglove.json").read_text()
    curves = set(re.findall(r'"(/\w+)\.(\w+)', layout))
    recorded = messages(recording)
    assert len(curves) > 5
    for topic, field in curves:
        assert field in recorded[topic][0][2], f"{topic}.{field}"
