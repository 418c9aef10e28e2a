"""RTDE server side (Universal Robots, "RTDE Guide"): bytes in, bytes out.

A packet is a big-endian uint16 of its whole size, one byte of type, and a body. After setup a
connection receives data packets only. Nothing is sent before the reply to a request, because
clients read exactly one packet as that reply. The fields are those that ur_rtde or this project
uses; currents, voltages, temperatures and the like are constants of an idle arm.
"""

import struct
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

from drivers.ur.emulator.controller import (
    REGISTERS,
    Controller,
    Profile,
    RobotMode,
    RuntimeState,
    SafetyMode,
    Values,
)

PORT = 30004
PROTOCOL_VERSION = 2  # version 1 is refused: no client here uses it
HEADER = struct.Struct(">HB")
MAX_BYTES = 65535 - HEADER.size  # of a body
NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"

_MAX_RECIPES = 255
_MAX_NAMES = 1000  # of one recipe
_MAX_INPUTS = 5000  # of all input recipes of one client
_MIN_HZ = 1.0  # RTDE Guide: 1 to 125 or 500
_FREQUENCY = struct.Struct(">d")


class PacketType(IntEnum):
    """Type byte of a packet, a letter."""

    PROTOCOL_VERSION = ord("V")
    CONTROLLER_VERSION = ord("v")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")
    DATA = ord("U")


STRUCT_CODES = {
    "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "DOUBLE": "d",
    "VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i",
}  # fmt: skip
_STRUCTS = {kind: struct.Struct(f">{code}") for kind, code in STRUCT_CODES.items()}


# output fields

_POWER_ON, _PROGRAM_RUNNING, _POWER_BUTTON = 1 << 0, 1 << 1, 1 << 3  # robot_status_bits
_JOINT_RUNNING, _JOINT_POWER_OFF = 253, 245  # joint_mode
_SAFETY_BITS = {
    SafetyMode.NORMAL: 1 << 0,
    SafetyMode.PROTECTIVE_STOP: 1 << 2 | 1 << 10,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | 1 << 10,
}


class Field(NamedTuple):
    """Output field: RTDE type, and values in a cycle."""

    type: str
    values: Callable[[Controller], Values]


def _constant(kind: str, *values: float) -> Field:
    return Field(kind, lambda controller: values)


def _register(direction: str, kind: str, index: int) -> Field:
    return Field(
        {"int": "INT32", "double": "DOUBLE"}[kind],
        lambda controller: (controller.registers.values[direction, kind][index],),
    )


def _status_bits(controller: Controller) -> Values:
    power = _POWER_ON if controller.robot_mode is not RobotMode.POWER_OFF else 0
    program = _PROGRAM_RUNNING if controller.runtime_state is RuntimeState.PLAYING else 0
    return (power | program | _POWER_BUTTON,)


def _joint_modes(controller: Controller) -> Values:
    running = controller.robot_mode is RobotMode.RUNNING
    return (_JOINT_RUNNING if running else _JOINT_POWER_OFF,) * 6


_ZERO_VECTORS = (
    "target_qdd target_current target_moment actual_current joint_control_output actual_TCP_force "
    "payload_inertia"
)
_ZERO_NUMBERS = (
    "actual_execution_time actual_momentum standard_analog_input0 standard_analog_input1 "
    "standard_analog_output0 standard_analog_output1"
)
_REGISTER_FIELDS = {
    f"{direction}_{kind}_register_{index}": (direction, kind, index)
    for direction in ("input", "output")
    for kind in ("int", "double")
    for index in range(REGISTERS)
}
_FORCE_SENSOR = "ft_raw_wrench"  # e-Series only
OUTPUTS: dict[str, Field] = {
    "timestamp": Field("DOUBLE", lambda c: (c.cycles * c.period_s,)),
    "actual_q": Field("VECTOR6D", lambda c: c.motion.q),
    "target_q": Field("VECTOR6D", lambda c: c.motion.q),
    "actual_qd": Field("VECTOR6D", lambda c: c.motion.qd),
    "target_qd": Field("VECTOR6D", lambda c: c.motion.qd),
    "actual_TCP_pose": Field("VECTOR6D", lambda c: c.motion.tcp_pose),
    "target_TCP_pose": Field("VECTOR6D", lambda c: c.motion.tcp_pose),
    "actual_TCP_speed": Field("VECTOR6D", lambda c: c.motion.tcp_speed),
    "target_TCP_speed": Field("VECTOR6D", lambda c: c.motion.tcp_speed),
    "tcp_offset": Field("VECTOR6D", lambda c: c.motion.tcp_offset),
    "payload": Field("DOUBLE", lambda c: (c.payload_kg,)),
    "payload_cog": Field("VECTOR3D", lambda c: c.payload_cog_m),
    "robot_mode": Field("INT32", lambda c: (c.robot_mode,)),
    "joint_mode": Field("VECTOR6INT32", _joint_modes),
    "safety_mode": Field("INT32", lambda c: (c.safety_mode,)),
    "speed_scaling": Field("DOUBLE", lambda c: (c.speed_fraction,)),
    "target_speed_fraction": Field("DOUBLE", lambda c: (c.speed_fraction,)),
    "runtime_state": Field("UINT32", lambda c: (c.runtime_state,)),
    "robot_status_bits": Field("UINT32", _status_bits),
    "safety_status_bits": Field("UINT32", lambda c: (_SAFETY_BITS[c.safety_mode],)),
    "joint_temperatures": _constant("VECTOR6D", *(30.0,) * 6),
    "actual_joint_voltage": _constant("VECTOR6D", *(48.0,) * 6),
    "actual_tool_accelerometer": _constant("VECTOR3D", 0.0, 0.0, -9.82),
    "actual_main_voltage": _constant("DOUBLE", 48.0),
    "actual_robot_voltage": _constant("DOUBLE", 48.0),
    "actual_robot_current": _constant("DOUBLE", 0.5),
    "actual_digital_input_bits": _constant("UINT64", 0),
    "actual_digital_output_bits": _constant("UINT64", 0),
    _FORCE_SENSOR: _constant("VECTOR6D", *(0.0,) * 6),
    **{name: _constant("VECTOR6D", *(0.0,) * 6) for name in _ZERO_VECTORS.split()},
    **{name: _constant("DOUBLE", 0.0) for name in _ZERO_NUMBERS.split()},
    **{name: _register(*which) for name, which in _REGISTER_FIELDS.items()},
}

# inputs other than registers and speed slider are accepted without effect
_BYTES = (
    "standard_digital_output_mask standard_digital_output configurable_digital_output_mask "
    "configurable_digital_output tool_digital_output_mask tool_digital_output "
    "standard_analog_output_mask standard_analog_output_type"
)
INPUTS: dict[str, str] = {
    "speed_slider_mask": "UINT32",
    **dict.fromkeys(_BYTES.split(), "UINT8"),
    "speed_slider_fraction": "DOUBLE",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
    **{name: OUTPUTS[name].type for name in _REGISTER_FIELDS if name.startswith("input")},
}


class Sample(dict[str, bytes]):
    """Output fields of one cycle, each packed at its first use."""

    def __init__(self, controller: Controller) -> None:
        super().__init__()
        self._controller = controller

    def __missing__(self, name: str) -> bytes:
        field = OUTPUTS[name]
        self[name] = _STRUCTS[field.type].pack(*field.values(self._controller))
        return self[name]


def packet(kind: PacketType, body: bytes = b"") -> bytes:
    """A packet; raises ValueError for a body longer than ``MAX_BYTES``."""
    if len(body) > MAX_BYTES:
        raise ValueError(f"a packet of {len(body)} bytes")
    return HEADER.pack(HEADER.size + len(body), kind) + body


class InputRecipe:
    """Names of inputs, in order, and the format of their values."""

    def __init__(self, names: list[str]) -> None:
        codes = [STRUCT_CODES[INPUTS[name]] for name in names]
        self._widths = [
            (name, int(code[:-1] or 1)) for name, code in zip(names, codes, strict=True)
        ]
        self._struct = struct.Struct(">" + "".join(codes))

    def unpack(self, body: bytes) -> dict[str, Values] | None:
        """Values by name; None when the body has a wrong length."""
        if len(body) != self._struct.size:
            return None
        flat = iter(self._struct.unpack(body))
        return {name: tuple(next(flat) for _ in range(n)) for name, n in self._widths}


class RtdeServer:
    """State shared by all connections: claims of inputs, and written values."""

    def __init__(self, profile: Profile) -> None:
        self.profile = profile
        self.claims: dict[str, object] = {}
        self.ignored_packets = 0
        self._written: dict[str, Values] = {}

    def write(self, values: dict[str, Values]) -> None:
        self._written.update(values)

    def take_inputs(self) -> dict[str, Values]:
        """Inputs written since the last call; the controller reads them once per cycle."""
        written, self._written = self._written, {}
        return written

    def output_type(self, name: str) -> str:
        known = name in OUTPUTS and (self.profile.e_series or name != _FORCE_SENSOR)
        return OUTPUTS[name].type if known else NOT_FOUND

    def claim(self, names: list[str], owner: object) -> None:
        """Claim these inputs for an owner; other clients' requests then get IN_USE."""
        for name in names:
            self.claims.setdefault(name, owner)

    def release(self, owner: object) -> None:
        self.claims = {name: one for name, one in self.claims.items() if one is not owner}


class RtdeConnection:
    """Connection of one client; ``broken`` once its bytes are not packets."""

    def __init__(self, server: RtdeServer) -> None:
        self._server = server
        self._unparsed = bytearray()
        self.broken = False
        self._inputs: list[InputRecipe] = []
        self._input_names = 0  # of all input recipes
        self._output: list[str] = []
        self._every = 1  # cycles per data packet
        self._started = False

    def close(self) -> None:
        self._server.release(self)

    def feed(self, data: bytes) -> bytes:
        """Replies to the requests in these bytes."""
        self._unparsed += data
        replies = []
        while len(self._unparsed) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._unparsed)
            self.broken = size < HEADER.size
            if self.broken or len(self._unparsed) < size:
                break
            replies.append(self._reply(kind, bytes(self._unparsed[HEADER.size : size])))
            del self._unparsed[:size]
        return b"".join(replies)

    def sample(self, cycle: int, sample: Sample) -> bytes:
        """Data packet of this cycle, or nothing."""
        if not self._started or cycle % self._every:
            return b""
        values = b"".join(sample[name] for name in self._output)
        return packet(PacketType.DATA, b"\x01" + values)

    def _reply(self, kind: int, body: bytes) -> bytes:
        match kind:
            case PacketType.PROTOCOL_VERSION:
                accepted = int.from_bytes(body, "big") == PROTOCOL_VERSION
                return packet(PacketType.PROTOCOL_VERSION, bytes([accepted]))
            case PacketType.CONTROLLER_VERSION:
                version = struct.pack(">4I", *self._server.profile.version)
                return packet(PacketType.CONTROLLER_VERSION, version)
            case PacketType.OUTPUTS:
                return packet(PacketType.OUTPUTS, self._set_up_outputs(body))
            case PacketType.INPUTS:
                return packet(PacketType.INPUTS, self._set_up_inputs(body))
            case PacketType.START:
                self._started = bool(self._output)
                return packet(PacketType.START, bytes([self._started]))
            case PacketType.PAUSE:
                self._started = False
                return packet(PacketType.PAUSE, bytes([1]))
            case PacketType.DATA:
                self._receive_inputs(body)
            case _:
                self._server.ignored_packets += 1
        return b""

    def _set_up_outputs(self, body: bytes) -> bytes:
        rate = self._server.profile.rate_hz
        frequency_hz = _FREQUENCY.unpack_from(body)[0] if len(body) >= _FREQUENCY.size else 0.0
        names = _names(body[_FREQUENCY.size :])
        types = [self._server.output_type(name) for name in names[:_MAX_NAMES]]
        valid = _MIN_HZ <= frequency_hz <= rate and 0 < len(names) <= _MAX_NAMES
        valid = valid and NOT_FOUND not in types
        self._output = names if valid else []
        self._every = round(rate / frequency_hz) if valid else 1
        return bytes([valid]) + ",".join(types).encode()

    def _set_up_inputs(self, body: bytes) -> bytes:
        names = _names(body)
        types = [self._input_type(name) for name in names[:_MAX_NAMES]]
        valid = 0 < len(names) <= _MAX_NAMES and self._input_names + len(names) <= _MAX_INPUTS
        valid = valid and NOT_FOUND not in types and IN_USE not in types
        valid = valid and len(self._inputs) < _MAX_RECIPES
        if valid:
            self._inputs.append(InputRecipe(names))
            self._input_names += len(names)
            self._server.claim(names, self)
        return bytes([len(self._inputs) if valid else 0]) + ",".join(types).encode()

    def _input_type(self, name: str) -> str:
        if name not in INPUTS:
            return NOT_FOUND
        free = self._server.claims.get(name, self) is self
        return INPUTS[name] if free else IN_USE

    def _receive_inputs(self, body: bytes) -> None:
        number = body[0] if body else 0
        known = 0 < number <= len(self._inputs)
        values = self._inputs[number - 1].unpack(body[1:]) if known else None
        if values is None:
            self._server.ignored_packets += 1
        else:
            self._server.write(values)


def _names(text: bytes) -> list[str]:
    """Names in a recipe; empty ones are ignored, since ur_rtde ends its list with a comma."""
    return [name for name in text.decode("ascii", "replace").split(",") if name]
