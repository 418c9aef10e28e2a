"""A bag of a lift, read with rosbags and with the MCAP library."""

import os
from collections import Counter, defaultdict
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from drivers.robotiq.calibration import GripperCalibration
from grasp.cli.main import main
from grasp.run.messages import GRIPPER, TACTILE
from scenarios.report.ros_topics import SLIP, STATE, TAXELS, TOPICS, WRENCHES
from scenarios.report.run_record import read_run
from scenarios.trial.run_folder import open_trial

START_NS = 946_684_800_000_000_000  # a run in virtual time begins on 2000-01-01


@pytest.fixture(scope="module")
def bag(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("rosbag") / "can"
    assert main(["export", str(runs[0]), "--to", "rosbag", "--out", str(out)]) == 0
    assert sorted(os.listdir(out)) == ["can.mcap", "metadata.yaml"]
    assert os.listdir(out.parent) == ["can"] and out.stat().st_mode & 0o777 == 0o700
    return out


def test_messages_hold_what_was_recorded(bag: Path, runs: list[Path]) -> None:
    from rosbags.highlevel import AnyReader

    found: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    with AnyReader([bag]) as reader:  # the types are those that the bag itself defines
        assert {c.topic: c.msgtype for c in reader.connections} == {
            name: topic.type for name, topic in TOPICS.items()
        }
        times = []
        for connection, stamp_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found[connection.topic].append((stamp_ns - START_NS, message))
            times.append(stamp_ns)
            if (header := getattr(message, "header", None)) is not None:
                assert header.stamp.sec * 10**9 + header.stamp.nanosec == stamp_ns
    assert times == sorted(times)

    run, recording = read_run(runs[0]), open_trial(runs[0])
    calibration = run.config.calibration
    assert isinstance(calibration, GripperCalibration)
    joints = found["/grasp/joint_states"]
    assert [t_ns for t_ns, _ in joints] == [state.t_ns for _, state in recording.of(GRIPPER)]
    positions = np.array([message.position for _, message in joints])
    np.testing.assert_allclose(positions, run.fingers_counts * calibration.m_per_count)
    tool = np.array([[m.point.x, m.point.y, m.point.z] for _, m in found["/grasp/tool_position"]])
    np.testing.assert_array_equal(tool, run.arm_m)

    known = ~np.isnan(run.counts[:, 0, 0])
    sampled_ns = [message.sampled_ns for _, message in recording.of(TACTILE)]
    assert [t_ns for t_ns, _ in found[TAXELS]] == sampled_ns
    taxels = np.array([message.data for _, message in found[TAXELS]])
    np.testing.assert_array_equal(taxels, run.counts[known].reshape(len(taxels), -1))
    assert [(d.label, d.size) for d in found[TAXELS][0][1].layout.dim] == [
        ("finger", 3), ("taxel", 6),
    ]  # fmt: skip
    for i, topic in enumerate(WRENCHES):
        force_n = [message.wrench.force.z for _, message in found[topic]]
        np.testing.assert_array_equal(force_n, run.estimated_n[known, i])
    slip = np.array([message.data for _, message in found[SLIP]])
    np.testing.assert_allclose(slip[:, :3], run.probabilities[known], rtol=1e-6)
    np.testing.assert_array_equal(slip[:, 3] > 0, run.registered[known])
    states = [message.data for _, message in found[STATE]]
    phases = [change.phase for change in run.phases]
    assert [a for a, b in zip(phases, [*phases[1:], ""], strict=True) if a != b] == states
    assert len(found["/diagnostics"]) >= int(run.t_s[-1] - run.t_s[0])


def test_a_player_finds_definitions_and_quality_of_service(bag: Path) -> None:
    """What `ros2 bag play`, PlotJuggler and Foxglove need of the file itself."""
    from rclpy.serialization import deserialize_message
    from rosbags.rosbag2 import Reader

    with (bag / "can.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        counts = summary.statistics.channel_message_counts
        for channel in summary.channels.values():
            schema = summary.schemas[channel.schema_id]
            assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg")
            assert schema.name == TOPICS[channel.topic].type and schema.data
            assert "reliability" in channel.metadata["offered_qos_profiles"]
            assert counts[channel.id] > 0
        read = Counter(channel.topic for _, channel, _ in reader.iter_messages())
    with Reader(bag) as written:
        assert read == {c.topic: c.msgcount for c in written.connections}
        assert written.ros_distro == "rosbags"
        kinds: dict[str, set[Any]] = defaultdict(set)
        for connection in written.connections:
            (qos,) = connection.ext.offered_qos_profiles  # type: ignore[union-attr]
            kind = (qos.reliability.name, qos.durability.name)
            kinds[TOPICS[connection.topic].qos].add(kind)
        for connection, _, data in written.messages():
            package, _, name = connection.msgtype.split("/")
            kind_of_message = getattr(import_module(f"{package}.msg"), name)
            assert isinstance(deserialize_message(bytes(data), kind_of_message), kind_of_message)
    assert kinds == {
        "sensor": {("BEST_EFFORT", "VOLATILE")},
        "latched": {("RELIABLE", "TRANSIENT_LOCAL")},
        "reliable": {("RELIABLE", "VOLATILE")},
    }
