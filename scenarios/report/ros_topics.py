"""The ROS 2 topics of a run: their table, and the messages of a control step as plain values.

Nothing here imports ROS. The node makes messages of `rclpy` from these values, an export those of a
bag. Units and frames follow REP 103 and REP 105: m, rad, N, s. docs/ros.md describes each topic.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from drivers.interfaces import FINGER_NAMES, FINGERS, GripperState
from grasp.control.fault import ARM, DETECTOR, FINGERTIPS, GRIPPER, LOOP, Fault
from grasp.run.messages import ArmMessage, ControlMessage, TactileMessage

# Kinds of quality of service: best effort and short queue; the last value for late subscribers;
# reliable.
SENSOR, LATCHED, RELIABLE = "sensor", "latched", "reliable"


class Topic(NamedTuple):
    """Type of a topic's messages, and its quality of service."""

    type: str
    qos: str


JOINTS, TOOL, TAXELS, SLIP, STATE, DIAGNOSTICS = (
    "/grasp/joint_states", "/grasp/tool_position", "/grasp/taxels", "/grasp/slip", "/grasp/state",
    "/diagnostics",
)  # fmt: skip
ARM_JOINTS = [
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint",
    "wrist_3_joint",
]  # fmt: skip
FINGER_LINKS = [f"finger_{name.lower()}" for name in FINGER_NAMES]
WRENCHES = [f"/grasp/{link}/wrench" for link in FINGER_LINKS]
TOPICS: dict[str, Topic] = {
    JOINTS: Topic("sensor_msgs/msg/JointState", SENSOR),
    TOOL: Topic("geometry_msgs/msg/PointStamped", SENSOR),
    **dict.fromkeys(WRENCHES, Topic("geometry_msgs/msg/WrenchStamped", SENSOR)),
    TAXELS: Topic("std_msgs/msg/Float32MultiArray", SENSOR),
    SLIP: Topic("std_msgs/msg/Float32MultiArray", SENSOR),
    STATE: Topic("std_msgs/msg/String", LATCHED),
    DIAGNOSTICS: Topic("diagnostic_msgs/msg/DiagnosticArray", RELIABLE),
}
ARM_BASE = "base"  # frame of the arm's controller, as in ur_description
OK, WARN, ERROR, STALE = 0, 1, 2, 3  # levels of DiagnosticStatus
IDLE = "idle"  # state between lifts, when no device is open
DEVICES = (GRIPPER, ARM, FINGERTIPS, DETECTOR, LOOP)
DIAGNOSTICS_NS = 1_000_000_000  # period

Fields = dict[str, Any]  # field names to numbers, texts, lists, or fields of a nested message


class Message(NamedTuple):
    """One ROS message: its topic, Unix time of its sample in ns, and its fields."""

    topic: str
    stamp_ns: int
    fields: Fields


class RosMessages:
    """Makes the messages of one run, step by step.

    ``unix_ns``: Unix time at which the run's clock was 0. ``m_per_count``: fingertip travel of a
    motor count, by the hand's calibration.
    """

    def __init__(self, unix_ns: int, m_per_count: float) -> None:
        self._unix_ns, self._m_per_count = unix_ns, m_per_count
        self._state = ""
        # level and fault by device: its first, or most severe
        self.problems: dict[str, tuple[int, Fault]] = {}
        self._diagnosed_ns: int | None = None

    def of_step(
        self, t_ns: int, tactile: TactileMessage | None, gripper: GripperState, arm: ArmMessage,
        control: ControlMessage,
    ) -> list[Message]:  # fmt: skip
        """Messages of a control step at ``t_ns``; the arguments are its messages in a recording.
        ``tactile`` is None before rest counts were taken. The state is included when it changes,
        diagnostics once a second and when they change."""
        made = [self._joints(gripper, arm)]
        if None not in arm.position_m:
            x, y, z = arm.position_m
            made.append(self._at(arm.t_ns, TOOL, ARM_BASE, {"point": {"x": x, "y": y, "z": z}}))
        if tactile is not None:
            sampled_ns = tactile.sampled_ns
            for topic, link, force_n in zip(
                WRENCHES, FINGER_LINKS, control.estimated_n, strict=True
            ):
                wrench = {"wrench": {"force": {"z": force_n}}}
                made.append(self._at(sampled_ns, topic, f"{link}_tip", wrench))
            taxels = array(tactile.counts, finger=FINGERS, taxel=len(tactile.counts) // FINGERS)
            made.append(Message(TAXELS, self._unix_ns + sampled_ns, taxels))
            slip = array([*control.probabilities, control.registered], slip=FINGERS + 1)
            made.append(Message(SLIP, self._unix_ns + sampled_ns, slip))
        if control.phase != self._state:
            self._state = control.phase
            made.append(Message(STATE, self._unix_ns + t_ns, {"data": control.phase}))
        changed = self._note(control)
        if changed or self._diagnosed_ns is None or t_ns - self._diagnosed_ns >= DIAGNOSTICS_NS:
            self._diagnosed_ns = t_ns
            stamp_ns = self._unix_ns + t_ns
            made.append(diagnostics(stamp_ns, self.problems, control.phase))
        return made

    def _joints(self, gripper: GripperState, arm: ArmMessage) -> Message:
        """Fingers and, where they are known, the arm's joints; the stamp is that of the older
        sample, so that it never goes back."""
        names, stamp_ns = [*FINGER_LINKS], gripper.t_ns
        position = [counts * self._m_per_count for counts in gripper.positions]
        known = [each for each in arm.joints_rad or () if each is not None]
        if len(known) == len(ARM_JOINTS):
            names, position = names + ARM_JOINTS, position + known
            stamp_ns = min(stamp_ns, arm.t_ns)
        return self._at(stamp_ns, JOINTS, "", {"name": names, "position": position})

    def _at(self, t_ns: int, topic: str, frame: str, fields: Fields) -> Message:
        stamp_ns = self._unix_ns + t_ns
        return Message(topic, stamp_ns, {"header": header(stamp_ns, frame), **fields})

    def _note(self, control: ControlMessage) -> bool:
        """Remember each device's problem; returns whether one is new or more severe."""
        before = dict(self.problems)
        for level, faults in ((WARN, control.reported), (ERROR, control.errors + control.faults)):
            for fault in faults:
                if self.problems.get(fault.device, (OK,))[0] < level:
                    self.problems[fault.device] = level, fault
        return self.problems != before


def header(stamp_ns: int, frame: str = "") -> Fields:
    """A std_msgs/Header."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def array(values: Iterable[float], **sizes: int) -> Fields:
    """A Float32MultiArray, row-major, with a name and a size for each dimension."""
    data = [float(value) for value in values]
    dims, stride = [], len(data)
    for label, size in sizes.items():
        dims.append({"label": label, "size": size, "stride": stride})
        stride //= size
    return {"layout": {"dim": dims, "data_offset": 0}, "data": data}


def diagnostics(
    stamp_ns: int, problems: Mapping[str, tuple[int, Fault]], state: str, **more: str
) -> Message:
    """A DiagnosticArray with one status a device. ``problems``: level and fault by device;
    ``more``: further values of the status `grasp`."""
    worst = max((level for level, _ in problems.values()), default=OK)
    statuses = [_status("grasp", worst, state, more)]
    text = "not open" if state == IDLE else "ok"
    for device in (*DEVICES, *(name for name in problems if name not in DEVICES)):
        level, fault = problems.get(device, (STALE if state == IDLE else OK, None))
        known = {} if fault is None else {"code": fault.code, "remedy": fault.remedy, **fault.data}
        statuses.append(_status(f"grasp: {device}", level, fault.message if fault else text, known))
    return Message(DIAGNOSTICS, stamp_ns, {"header": header(stamp_ns), "status": statuses})


def _status(name: str, level: int, message: str, values: Mapping[str, object]) -> Fields:
    pairs = [{"key": key, "value": str(value)} for key, value in values.items()]
    return {"level": level, "name": name, "message": message, "hardware_id": "", "values": pairs}
