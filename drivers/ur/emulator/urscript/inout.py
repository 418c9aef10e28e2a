"""Inputs, outputs, registers of bits and readings of a robot in URScript.

Names and parameters: Universal Robots, "The URScript Programming Language". Temperatures and
currents are those of an idle arm.
"""

import math

from drivers.ur import kinematics
from drivers.ur.emulator.ports import FLAGS
from drivers.ur.emulator.urscript.parse import ScriptError
from drivers.ur.emulator.urscript.run import Builtin, PoseValue, Thread, Value, finite

INOUT: dict[str, Builtin] = {}
_GROUPS = ("standard", "configurable", "tool")
_IDLE_C, _IDLE_A = 30.0, 0.0


def _known(function: Builtin) -> Builtin:
    INOUT[function.__name__] = function
    return function


def _index(value: Value) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ScriptError("the number of an input or output is an integer")
    return value


def _digital(group: str) -> None:
    """The functions of one group, by number within it."""

    def set_out(thread: Thread, n: Value, b: Value) -> None:
        thread.robot.ports.set_digital(group, _index(n), bool(b))

    def get_out(thread: Thread, n: Value) -> bool:
        ports = thread.robot.ports
        return bool(ports.digital(ports.digital_out, group, _index(n)))

    def get_in(thread: Thread, n: Value) -> bool:
        ports = thread.robot.ports
        return bool(ports.digital(ports.digital_in, group, _index(n)))

    INOUT[f"set_{group}_digital_out"] = set_out
    INOUT[f"get_{group}_digital_out"] = get_out
    INOUT[f"get_{group}_digital_in"] = get_in


for _group in _GROUPS:
    _digital(_group)


@_known
def set_digital_out(thread: Thread, n: Value, b: Value) -> None:
    """0 to 7 the box, 8 and 9 the tool."""
    group, index = ("standard", _index(n)) if _index(n) < 8 else ("tool", _index(n) - 8)
    thread.robot.ports.set_digital(group, index, bool(b))


@_known
def get_digital_out(thread: Thread, n: Value) -> bool:
    ports = thread.robot.ports
    group, index = ("standard", _index(n)) if _index(n) < 8 else ("tool", _index(n) - 8)
    return bool(ports.digital(ports.digital_out, group, index))


@_known
def get_digital_in(thread: Thread, n: Value) -> bool:
    ports = thread.robot.ports
    group, index = ("standard", _index(n)) if _index(n) < 8 else ("tool", _index(n) - 8)
    return bool(ports.digital(ports.digital_in, group, index))


def _analog(n: Value) -> int:
    if _index(n) not in (0, 1):
        raise ScriptError(f"no analog {n}")
    return _index(n)


@_known
def set_standard_analog_out(thread: Thread, n: Value, f: Value) -> None:
    """``f`` from 0 to 1."""
    thread.robot.ports.set_analog(_analog(n), finite(f))


@_known
def set_analog_outputdomain(thread: Thread, port: Value, domain: Value) -> None:
    """0 current, 1 voltage."""
    thread.robot.ports.analog_voltage[_analog(port)] = bool(domain)


@_known
def get_standard_analog_out(thread: Thread, n: Value) -> float:
    return float(thread.robot.ports.analog_ratio[_analog(n)])


@_known
def get_standard_analog_in(thread: Thread, n: Value) -> float:
    return float(thread.robot.ports.analog_in[_analog(n)])


INOUT |= {"set_analog_out": set_standard_analog_out, "get_analog_in": get_standard_analog_in}


@_known
def set_tool_voltage(thread: Thread, voltage: Value) -> None:
    if _index(voltage) not in (0, 12, 24):
        raise ScriptError("the tool's voltage is 0, 12 or 24")
    thread.robot.ports.tool_voltage_v = _index(voltage)


def _flag(n: Value) -> int:
    if not 0 <= _index(n) < FLAGS:
        raise ScriptError(f"no flag {n}")
    return _index(n)


@_known
def set_flag(thread: Thread, n: Value, b: Value) -> None:
    thread.robot.ports.flags[_flag(n)] = bool(b)


@_known
def get_flag(thread: Thread, n: Value) -> bool:
    return bool(thread.robot.ports.flags[_flag(n)])


@_known
def read_input_boolean_register(thread: Thread, address: Value) -> bool:
    return bool(thread.robot.registers.read("input", "bit", address))


@_known
def write_output_boolean_register(thread: Thread, address: Value, value: Value) -> None:
    thread.robot.registers.write("bit", address, bool(value))


def _read(name: str) -> None:
    """Of the values that the program wrote."""
    kind = {"integer": "int", "float": "double", "boolean": "bit"}[name]

    def read(thread: Thread, address: Value) -> Value:
        return thread.robot.registers.read("output", kind, address)

    INOUT[f"read_output_{name}_register"] = read


for _name in ("integer", "float", "boolean"):
    _read(_name)


# readings


@_known
def force(thread: Thread) -> float:
    return math.hypot(*thread.robot.wrench[:3])


@_known
def get_tcp_force(thread: Thread) -> list[float]:
    return list(thread.robot.wrench)


@_known
def get_actual_tcp_speed(thread: Thread) -> list[float]:
    return list(thread.robot.motion.tcp_speed)


@_known
def get_target_tcp_pose(thread: Thread) -> PoseValue:
    return PoseValue(thread.robot.motion.tcp_pose)


@_known
def get_actual_joint_speeds(thread: Thread) -> list[float]:
    return list(thread.robot.motion.qd)


@_known
def get_target_joint_positions(thread: Thread) -> list[float]:
    return list(thread.robot.motion.q)


INOUT["get_target_joint_speeds"] = get_actual_joint_speeds


@_known
def get_target_speed_fraction(thread: Thread) -> float:
    return float(thread.robot.ports.speed_fraction)


@_known
def get_joint_temp(thread: Thread, j: Value) -> float:
    if not 0 <= _index(j) < kinematics.JOINTS:
        raise ScriptError(f"no joint {j}")
    return _IDLE_C


@_known
def get_controller_temp(thread: Thread) -> float:
    return _IDLE_C


@_known
def get_tool_current(thread: Thread) -> float:
    return _IDLE_A
