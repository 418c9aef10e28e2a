"""Values of the RTDE output fields, from the state of the emulated controller.

Status bits: "RTDE Guide". Currents, voltages, temperatures and the like are constants of an idle
arm: nothing here models them.
"""

import math

from drivers.ur.emulator.controller import Controller, RobotMode, RuntimeState, SafetyMode
from drivers.ur.emulator.rtde_wire import BITS, E_SERIES_OUTPUT_TYPES, STRUCT_CODES, Values

_POWER_ON, _PROGRAM_RUNNING, _POWER_BUTTON = 1 << 0, 1 << 1, 1 << 3
_JOINT_RUNNING, _JOINT_POWER_OFF = 253, 245
_TOOL_RUNNING = 253
_SAFETY_BITS = {
    SafetyMode.NORMAL: 1 << 0,
    SafetyMode.PROTECTIVE_STOP: 1 << 2 | 1 << 10,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | 1 << 10,
}


def _idle(kind: str) -> Values:
    code = STRUCT_CODES[kind]
    zero: float = 0.0 if code[-1] == "d" else 0
    return (zero,) * int(code[:-1] or 1)


_CONSTANT: dict[str, Values] = {
    **{name: _idle(kind) for name, kind in E_SERIES_OUTPUT_TYPES.items()},
    "joint_temperatures": (30.0,) * 6,
    "actual_joint_voltage": (48.0,) * 6,
    "actual_tool_accelerometer": (0.0, 0.0, -9.82),
    "speed_scaling": (1.0,),
    "tool_mode": (_TOOL_RUNNING,),
    "tool_temperature": (30.0,),
    "tool_analog_input_types": (0b11,),
    "actual_main_voltage": (48.0,),
    "actual_robot_voltage": (48.0,),
    "actual_robot_current": (0.5,),
}
_REGISTER_NAMES = {
    (direction, kind): [f"{direction}_{kind}_register_{index}" for index in range(48)]
    for direction in ("input", "output")
    for kind in ("int", "double")
}
_BIT_NAMES = {
    direction: [f"{direction}_bit_register_{index}" for index in range(BITS)]
    for direction in ("input", "output")
}


def output_values(controller: Controller) -> dict[str, Values]:
    """One cycle's values by field name."""
    motion, ports = controller.motion, controller.ports
    pose, speed = motion.tcp_pose, motion.tcp_speed
    running = controller.robot_mode is RobotMode.RUNNING
    values = {
        **_CONSTANT,
        "timestamp": (controller.cycles * controller.period_s,),
        "actual_q": motion.q,
        "target_q": motion.q,
        "actual_qd": motion.qd,
        "target_qd": motion.qd,
        "actual_TCP_pose": pose,
        "target_TCP_pose": pose,
        "actual_TCP_speed": speed,
        "target_TCP_speed": speed,
        "actual_TCP_force": controller.wrench,
        "ft_raw_wrench": controller.raw_wrench,
        "tcp_offset": motion.tcp_offset,
        "payload": (controller.payload_kg,),
        "payload_cog": controller.payload_cog_m,
        "robot_mode": (controller.robot_mode,),
        "joint_mode": ((_JOINT_RUNNING if running else _JOINT_POWER_OFF),) * 6,
        "safety_mode": (controller.safety_mode,),
        "safety_status": (controller.safety_mode,),
        "tcp_force_scalar": (math.hypot(*controller.wrench[:3]),),
        "speed_scaling": (ports.speed_fraction,),
        "target_speed_fraction": (ports.speed_fraction,),
        "actual_digital_input_bits": (ports.digital_in,),
        "actual_digital_output_bits": (ports.digital_out,),
        "standard_analog_input0": (ports.analog_in[0],),
        "standard_analog_input1": (ports.analog_in[1],),
        "standard_analog_output0": (ports.analog_out(0),),
        "standard_analog_output1": (ports.analog_out(1),),
        "tool_output_voltage": (ports.tool_voltage_v,),
        "analog_io_types": (ports.analog_types,),
        "runtime_state": (controller.runtime_state,),
        "robot_status_bits": (_status_bits(controller),),
        "safety_status_bits": (_SAFETY_BITS[controller.safety_mode],),
    }
    for key, names in _REGISTER_NAMES.items():
        values.update(zip(names, zip(controller.registers.values[key]), strict=True))
    for direction, names in _BIT_NAMES.items():
        bits = controller.registers.values[direction, "bit"]
        values.update(zip(names, zip(bits), strict=True))
        for first in (0, 32):
            word = sum(bool(bit) << place for place, bit in enumerate(bits[first : first + 32]))
            values[f"{direction}_bit_registers{first}_to_{first + 31}"] = (word,)
    return values


def _status_bits(controller: Controller) -> int:
    power = _POWER_ON if controller.robot_mode is not RobotMode.POWER_OFF else 0
    program = _PROGRAM_RUNNING if controller.runtime_state is RuntimeState.PLAYING else 0
    return power | program | _POWER_BUTTON
