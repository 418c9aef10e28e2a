"""What the controller says by itself on port 30003: its state, every cycle.

Layout: Universal Robots, "Real-time client interface", PolyScope 3.10 to 3.15 and 5.4 to 5.8, which
differs by its end alone from earlier ones. It is a length and 139 doubles; those that the table
leaves to the maker are nought, and what is no output field of RTDE is too.
"""

import struct
from collections.abc import Mapping

from drivers.ur.emulator.rtde_wire import Values

DOUBLES = 139
# output fields of RTDE, in order, or how many doubles are nought
FIELDS: tuple[str | int, ...] = (
    "timestamp", "target_q", "target_qd", "target_qdd", "target_current", "target_moment",
    "actual_q", "actual_qd", "actual_current", "joint_control_output", "actual_TCP_pose",
    "actual_TCP_speed", "actual_TCP_force", "target_TCP_pose", "target_TCP_speed",
    "actual_digital_input_bits", "joint_temperatures", "actual_execution_time", 1, "robot_mode",
    "joint_mode", "safety_mode", 6, "actual_tool_accelerometer", 6, "speed_scaling",
    "actual_momentum", 2, "actual_main_voltage", "actual_robot_voltage", "actual_robot_current",
    "actual_joint_voltage", "actual_digital_output_bits", "runtime_state", "elbow_position",
    "elbow_velocity", "safety_status",
)  # fmt: skip
_LAYOUT = struct.Struct(f">I{DOUBLES}d")


def realtime_message(values: Mapping[str, Values]) -> bytes:
    """One packet, of the output fields of a cycle."""
    doubles: list[float] = []
    for field in FIELDS:
        doubles += [0.0] * field if isinstance(field, int) else values[field]
    return _LAYOUT.pack(_LAYOUT.size, *doubles)
