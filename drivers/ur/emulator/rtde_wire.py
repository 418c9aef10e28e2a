"""RTDE on the wire: framing, data types, field names (Universal Robots, "RTDE Guide").

A packet is a big-endian uint16 of its whole size, one byte of type, and a body. The names and types
below are those of the guide that a client of this project or ur_rtde asks for.
"""

import struct
from collections.abc import Mapping
from enum import IntEnum
from operator import itemgetter

PORT = 30004
PROTOCOL_VERSION = 2
HEADER = struct.Struct(">HB")
MOST_BYTES = 65535 - HEADER.size  # of a body

NOT_FOUND = "NOT_FOUND"
IN_USE = "IN_USE"

Scalar = int | float
Values = tuple[Scalar, ...]


class PacketType(IntEnum):
    """The type byte, a letter."""

    PROTOCOL_VERSION = ord("V")
    CONTROLLER_VERSION = ord("v")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")
    DATA = ord("U")
    TEXT = ord("M")


STRUCT_CODES = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
_CELLS = {kind: struct.Struct(f">{code}") for kind, code in STRUCT_CODES.items()}

BITS = 128  # 0-63 in words, 64-127 one by one
REGISTERS = 48  # 0-23 for fieldbus and PLC, 24-47 for external RTDE clients

_VECTORS = (
    "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current "
    "actual_current_window joint_control_output actual_TCP_pose actual_TCP_speed "
    "actual_TCP_force target_TCP_pose target_TCP_speed joint_temperatures actual_joint_voltage "
    "payload_inertia tcp_offset"
)
_DOUBLES = (
    "timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum "
    "actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0 "
    "standard_analog_input1 standard_analog_output0 standard_analog_output1 payload io_current "
    "euromap67_24V_voltage euromap67_24V_current tool_analog_input0 tool_analog_input1 "
    "tool_output_current tool_temperature tcp_force_scalar joint_position_deviation_ratio "
    "collision_detection_ratio"
)
_WORDS = (
    "runtime_state robot_status_bits safety_status_bits analog_io_types euromap67_input_bits "
    "euromap67_output_bits tool_mode tool_analog_input_types script_control_line"
)


def _registers(direction: str) -> dict[str, str]:
    types = {f"{direction}_bit_registers{low}_to_{low + 31}": "UINT32" for low in (0, 32)}
    types |= {f"{direction}_bit_register_{index}": "BOOL" for index in range(64, 128)}
    types |= {f"{direction}_int_register_{index}": "INT32" for index in range(REGISTERS)}
    return types | {f"{direction}_double_register_{index}": "DOUBLE" for index in range(REGISTERS)}


OUTPUT_TYPES: dict[str, str] = {
    **dict.fromkeys(_VECTORS.split(), "VECTOR6D"),
    **dict.fromkeys(_DOUBLES.split(), "DOUBLE"),
    **dict.fromkeys(("actual_tool_accelerometer", "payload_cog"), "VECTOR3D"),
    **dict.fromkeys(("elbow_position", "elbow_velocity"), "VECTOR3D"),
    **dict.fromkeys(("actual_digital_input_bits", "actual_digital_output_bits"), "UINT64"),
    **dict.fromkeys(("robot_mode", "safety_mode"), "INT32"),
    **dict.fromkeys(_WORDS.split(), "UINT32"),
    **dict.fromkeys(("safety_status", "tool_output_voltage", "time_scale_source"), "INT32"),
    **dict.fromkeys(("tool_output_mode", "tool_digital_output0_mode"), "UINT8"),
    "tool_digital_output1_mode": "UINT8",
    "joint_mode": "VECTOR6INT32",
    **_registers("output"),
    **_registers("input"),
}
E_SERIES_OUTPUT_TYPES: dict[str, str] = {**OUTPUT_TYPES, "ft_raw_wrench": "VECTOR6D"}

INPUT_TYPES: dict[str, str] = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    **dict.fromkeys(("standard_digital_output_mask", "standard_digital_output"), "UINT8"),
    **dict.fromkeys(("configurable_digital_output_mask", "configurable_digital_output"), "UINT8"),
    **dict.fromkeys(("tool_digital_output_mask", "tool_digital_output"), "UINT8"),
    **dict.fromkeys(("standard_analog_output_mask", "standard_analog_output_type"), "UINT8"),
    **dict.fromkeys(("standard_analog_output_0", "standard_analog_output_1"), "DOUBLE"),
    "external_force_torque": "VECTOR6D",
    **_registers("input"),
}


def packet(kind: PacketType, body: bytes = b"") -> bytes:
    """Raises ValueError for a body beyond ``MOST_BYTES``."""
    if len(body) > MOST_BYTES:
        raise ValueError(f"a packet of {len(body)} bytes")
    return HEADER.pack(HEADER.size + len(body), kind) + body


def text_packet(message: str) -> bytes:
    """A message for people, of level "error" (RTDE Guide, "Text message", protocol 2)."""
    said, source = message.encode()[:200], b"emulator"
    level = 1
    body = bytes([len(said)]) + said + bytes([len(source)]) + source + bytes([level])
    return packet(PacketType.TEXT, body)


def split_names(text: bytes) -> list[str]:
    """Names of a recipe. ur_rtde ends its list with a comma; an empty name is no name."""
    return [name for name in text.decode("ascii", "replace").split(",") if name]


class Splitter:
    """Cuts a byte stream into packets; ``broken`` once it can no longer tell where one begins."""

    def __init__(self) -> None:
        self._held = bytearray()
        self.broken = False

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Complete packets so far, each as type and body."""
        self._held += data
        found: list[tuple[int, bytes]] = []
        while not self.broken and len(self._held) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._held)
            if size < HEADER.size:
                self.broken = True
            elif len(self._held) < size:
                break
            else:
                found.append((kind, bytes(self._held[HEADER.size : size])))
                del self._held[:size]
        return found


class Cells(dict[str, bytes]):
    """Fields of one cycle, each packed when it is first asked for. Its name must be among the
    values."""

    def __init__(self, values: Mapping[str, Values], types: Mapping[str, str]) -> None:
        self._values = values
        self._types = types

    def __missing__(self, name: str) -> bytes:
        self[name] = _CELLS[self._types[name]].pack(*self._values[name])
        return self[name]


class Recipe:
    """Field names of known types, in order, packed behind the recipe's id."""

    def __init__(self, number: int, names: list[str], types: dict[str, str]) -> None:
        codes = [STRUCT_CODES[types[name]] for name in names]
        self.names = names
        self._cells_of = itemgetter(names[0], *names)  # never of one alone
        self._number = bytes([number])
        self._struct = struct.Struct(">B" + "".join(codes))
        self._widths = [int(code[:-1] or 1) for code in codes]

    def pack(self, cells: "Cells") -> bytes:
        """A data packet."""
        return packet(PacketType.DATA, self._number + b"".join(self._cells_of(cells)[1:]))

    def unpack(self, body: bytes) -> dict[str, Values] | None:
        """Values by name; None when the body is not as long as the recipe says."""
        if len(body) != self._struct.size:
            return None
        flat = self._struct.unpack(body)[1:]
        values: dict[str, Values] = {}
        at = 0
        for name, width in zip(self.names, self._widths, strict=True):
            values[name] = flat[at : at + width]
            at += width
        return values
