"""What the controller says by itself on ports 30001 and 30002: a version once, its state at 10 Hz.

Layouts: Universal Robots, "Client Interfaces", PolyScope 3.5 to 3.15 and 5.x. Currents, voltages
and temperatures are those of an idle arm. No messages (texts, errors, variables) are sent.
"""

import math
import struct
import zlib
from collections.abc import Mapping

from drivers.ur import kinematics
from drivers.ur.emulator.controller import Controller, RobotMode, RuntimeState, SafetyMode
from drivers.ur.emulator.plans import JOINT_RANGE, JOINT_SPEEDS
from drivers.ur.emulator.rtde_wire import Values
from drivers.ur.emulator.settings import Profile

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


RATE_HZ = 10
_STATE, _MESSAGE, _VERSION = 16, 20, 3
_RUNNING, _OFF = 253, 245
_TOOL_V, _BOX_V, _C = 0.0, 48.0, 30.0
_UR10, _JOINT_RADPS2 = 2, 15.0
_DEFAULTS = (1.05, 1.4, 0.25, 1.2, 0.6)  # of joints and tool: speed and acceleration; a radius
_DH_ALPHA = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)
_DH_THETA = (0.0,) * 6


def _package(kind: int, layout: str, *values: object) -> bytes:
    body = struct.pack(">" + layout, *values)
    return struct.pack(">IB", 5 + len(body), kind) + body


def version_message(profile: Profile, name: bytes = b"URControl") -> bytes:
    """The first thing that a client hears."""
    major, minor, bugfix, build = profile.version
    date = b"01-08-2022, 00:00:00"
    layout = f"QbbB{len(name)}sBBii{len(date)}s"
    values = (0, -2, _VERSION, len(name), name, major, minor, bugfix, build, date)
    return _package(_MESSAGE, layout, *values)


def state_message(controller: Controller, profile: Profile) -> bytes:
    """All that is known of the robot, one package behind the other."""
    body = b"".join(
        (
            _mode(controller), _joints(controller), _tool(controller), _box(controller, profile),
            _cartesian(controller), _KINEMATICS, _CONFIGURATION,
            _package(7, "7d", *controller.wrench, 0.0), _package(8, "3?", False, False, False),
        )
    )  # fmt: skip
    return struct.pack(">IB", 5 + len(body), _STATE) + body


def _mode(controller: Controller) -> bytes:
    powered = controller.robot_mode is not RobotMode.POWER_OFF
    flags = (
        True, True, powered,
        controller.safety_mode is SafetyMode.ROBOT_EMERGENCY_STOP,
        controller.safety_mode is SafetyMode.PROTECTIVE_STOP,
        controller.runtime_state is RuntimeState.PLAYING,
        controller.runtime_state is RuntimeState.PAUSED,
    )  # fmt: skip
    now_us = round(controller.cycles * controller.period_s * 1e6)
    fraction = controller.ports.speed_fraction
    values = (now_us, *flags, controller.robot_mode, 0, fraction, fraction, 1.0, 0)
    return _package(0, "Q7?BB3dB", *values)


def _joints(controller: Controller) -> bytes:
    motion = controller.motion
    mode = _RUNNING if controller.robot_mode is RobotMode.RUNNING else _OFF
    values: list[float] = []
    for q, qd in zip(motion.q, motion.qd, strict=True):
        values += (q, q, qd, 0.0, _BOX_V, _C, _C, mode)
    return _package(1, "3d4fB" * kinematics.JOINTS, *values)


def _tool(controller: Controller) -> bytes:
    voltage = controller.ports.tool_voltage_v
    return _package(2, "BBddfBffB", 0, 0, 0.0, 0.0, _BOX_V, voltage, 0.0, _C, _RUNNING)


def _box(controller: Controller, profile: Profile) -> bytes:
    ports = controller.ports
    domains = [int(voltage) for voltage in ports.analog_voltage]
    values = (
        ports.digital_in, ports.digital_out, 1, 1, *ports.analog_in, *domains,
        ports.analog_out(0), ports.analog_out(1), _C, _BOX_V, 0.5, 0.0,
        controller.safety_mode, 0, 0, 0,
    )  # fmt: skip
    newer = profile.version[0] >= 5
    return _package(3, "iiBBddBBddffffBBBI" + "BB" * newer, *values, *(0, 0) * newer)


def _cartesian(controller: Controller) -> bytes:
    return _package(4, "12d", *controller.motion.tcp_pose, *controller.motion.tcp_offset)


def _kinematics() -> bytes:
    columns = (_DH_THETA, kinematics.A_M, kinematics.D_M, _DH_ALPHA)
    sums = [zlib.crc32(struct.pack(">4d", *joint)) for joint in zip(*columns, strict=True)]
    flat = [value for column in columns for value in column]
    return _package(5, "6I24dI", *sums, *flat, 0)


def _configuration() -> bytes:
    limits = [value for _ in JOINT_SPEEDS for value in (-JOINT_RANGE, JOINT_RANGE)]
    rates = [value for speed in JOINT_SPEEDS for value in (speed, _JOINT_RADPS2)]
    arm = (*kinematics.A_M, *kinematics.D_M, *_DH_ALPHA, *_DH_THETA)
    return _package(6, "12d12d5d24d4i", *limits, *rates, *_DEFAULTS, *arm, 0, 0, _UR10, 0)


_KINEMATICS, _CONFIGURATION = _kinematics(), _configuration()
