"""A run as a ROS 2 bag: MCAP with CDR, and the topics of the node. Needs the extra `exports`."""

from collections.abc import Iterator, Mapping
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np

from grasp.files import PRIVATE_FOLDER, whole_folder
from grasp.run.messages import ARM, CONTROL, GRIPPER, TACTILE
from grasp.run.recording import UNIX_NS
from scenarios.report.ros_topics import LATCHED, SENSOR, TOPICS, Message, RosMessages
from scenarios.report.run_record import read_run
from scenarios.rigs.calibration import MANUAL
from scenarios.trial.run_folder import open_trial

VERSION: Final = (
    8  # of the metadata: read by ROS 2 Iron and later; version 9 only by Jazzy and later
)
DEPTHS = {SENSOR: 5, LATCHED: 1}


def write_rosbag(run: Path, out: Path) -> None:
    """Write a run to a new bag, complete or not at all; messages are in the order of their stamps.
    Raises BadFile as ``read_run``, OSError."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)

    def encoded(message: Message) -> tuple[int, str, bytes]:
        kind = TOPICS[message.topic].type
        data = store.serialize_cdr(_filled(store, kind, message.fields), kind)
        return message.stamp_ns, message.topic, bytes(data)

    messages = sorted(map(encoded, _messages(run)), key=itemgetter(0))
    with whole_folder(out) as folder:
        folder.rmdir()  # the writer makes it
        bag = Writer(folder, version=VERSION, storage_plugin=StoragePlugin.MCAP)
        bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with bag:
            topics = {
                name: bag.add_connection(
                    name, topic.type, typestore=store, offered_qos_profiles=[_qos(topic.qos)]
                )
                for name, topic in TOPICS.items()
            }
            for stamp_ns, topic, data in messages:
                bag.write(topics[topic], stamp_ns, data)
        folder.chmod(PRIVATE_FOLDER)


def _messages(path: Path) -> Iterator[Message]:
    """All messages of a run, step by step."""
    calibration = read_run(path).config.calibration or MANUAL
    recording = open_trial(path)
    ros = RosMessages(int(recording.metadata.get(UNIX_NS, "0")), calibration.m_per_count)
    tactile, gripper, arm = (dict(recording.of(topic)) for topic in (TACTILE, GRIPPER, ARM))
    for t_ns, control in recording.of(CONTROL):
        if t_ns in gripper and t_ns in arm:
            yield from ros.of_step(t_ns, tactile.get(t_ns), gripper[t_ns], arm[t_ns], control)


def _filled(store: Any, kind: str, fields: Mapping[str, Any]) -> Any:
    """A message of the type store. Fields that are not given are zero or empty, as in ROS."""
    given = {
        name: _value(store, node, detail, fields.get(name))
        for name, (node, detail) in store.get_msgdef(kind).fields
    }
    return store.types[kind](**given)


def _value(store: Any, node: Any, detail: Any, value: Any) -> Any:
    from rosbags.interfaces import Nodetype

    if node == Nodetype.BASE:
        return value or ("" if detail[0] == "string" else 0)
    if node == Nodetype.NAME:
        return _filled(store, detail, value or {})
    (inner, kind), _ = detail
    values = [_value(store, inner, kind, each) for each in value or []]
    numbers = inner == Nodetype.BASE and kind[0] != "string"
    return np.array(values, kind[0]) if numbers else values


def _qos(kind: str) -> Any:
    """The quality of service at which the node publishes."""
    from rosbags import interfaces as of

    unset = of.QosTime(0, 0)
    return of.Qos(
        of.QosHistory.KEEP_LAST,
        DEPTHS.get(kind, 10),
        of.QosReliability.BEST_EFFORT if kind == SENSOR else of.QosReliability.RELIABLE,
        of.QosDurability.TRANSIENT_LOCAL if kind == LATCHED else of.QosDurability.VOLATILE,
        unset, unset, of.QosLiveliness.AUTOMATIC, unset, False,
    )  # fmt: skip
