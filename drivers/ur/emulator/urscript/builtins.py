"""Functions that an emulated URScript program may call: what the script of ur_rtde needs.

Names, parameters and defaults: Universal Robots, "The URScript Programming Language". The first
parameter is the calling thread; its ``robot`` is the emulated controller.
"""

import math
from collections.abc import Callable, Sequence

from drivers.ur import kinematics
from drivers.ur.emulator.urscript.maths import MATHS, six, three
from drivers.ur.emulator.urscript.parse import ScriptError
from drivers.ur.emulator.urscript.run import (
    Builtin,
    PoseValue,
    Steps,
    Thread,
    Value,
    finite,
    quantity,
)

BUILTINS: dict[str, Builtin] = {}
_MAX_SLEEP_S = 3600.0
_MOST_SHOWN = 500  # characters of a string
_MOST_KG = 12.5  # of a UR10e; a UR10 carries 10
_SLOWEST_HZ = 1.0 / _MAX_SLEEP_S  # of a watchdog


def _known(function: Builtin) -> Builtin:
    """A generator function is one that waits for later cycles."""
    BUILTINS[function.__name__] = function
    return function


def _moving(thread: Thread, start: Callable[[], None]) -> Steps:
    """A motion until its end; in whichever way the thread ends, the arm is free afterwards."""
    motion = thread.robot.motion
    motion.take(thread)
    try:
        start()
        yield
        while not motion.arrived:
            yield
    finally:
        motion.let_go(thread)


@_known
def movel(
    thread: Thread, pose: Value, a: Value = 1.2, v: Value = 0.25, t: Value = 0, r: Value = 0
) -> Steps:
    """A blend radius is ignored: every line ends at rest."""
    motion = thread.robot.motion
    target = six(pose)
    if not isinstance(pose, PoseValue):
        target = motion.pose_of(target, None)
    if quantity(t):
        raise ScriptError("a line in a given time is not emulated")
    yield from _moving(thread, lambda: motion.line(target, finite(v), finite(a)))


def _duration(t: Value) -> float:
    return quantity(t, 0.0, _MAX_SLEEP_S)


def _joints(thread: Thread, pose: Sequence[float], near: Value = None) -> list[float] | None:
    """Joint angles for a pose, or None."""
    q = thread.robot.motion.joints_for(pose, None if near is None else six(near))
    return None if q is None else list(q)


@_known
def speedl(thread: Thread, xd: Value, a: Value = 1.2, t: Value = 0, aRot: Value = "a") -> Steps:
    """For t seconds; without t until the speed is reached. The motion goes on afterwards."""
    motion = thread.robot.motion
    x, y, z, rx, ry, rz = six(xd)
    yield from _kept(thread, lambda: motion.speed_line((x, y, z), (rx, ry, rz), finite(a)), t)


def _kept(thread: Thread, start: Callable[[], None], t: Value) -> Steps:
    """A motion that goes on after its call has lasted for t seconds, at least a cycle."""
    motion = thread.robot.motion
    motion.take(thread)
    try:
        start()
        for _ in range(max(1, round(_duration(t) / thread.robot.period_s))):
            yield
    finally:
        motion.let_go(thread)


@_known
def stopl(thread: Thread, a: Value, aRot: Value = "a") -> Steps:
    motion, deceleration = thread.robot.motion, finite(a)
    yield from _moving(thread, lambda: motion.stop(deceleration))


@_known
def stopj(thread: Thread, a: Value) -> Steps:
    """The tool brakes on its line, by the joints' figure taken as m/s2."""
    yield from stopl(thread, a)


@_known
def sync(thread: Thread) -> Steps:
    yield


@_known
def sleep(thread: Thread, t: Value) -> Steps:
    for _ in range(max(1, round(min(finite(t), _MAX_SLEEP_S) / thread.robot.period_s))):
        yield


def _shown(value: Value) -> Value:
    """Strings of a list by their beginnings, for the log keeps no more."""
    if not isinstance(value, list):
        return value
    return type(value)(one[:_MOST_SHOWN] if isinstance(one, str) else one for one in value)


@_known
def textmsg(thread: Thread, s1: Value, s2: Value = "") -> None:
    thread.robot.log(f"{_shown(s1)}{_shown(s2)}")


# registers


@_known
def read_input_integer_register(thread: Thread, address: Value) -> Value:
    return thread.robot.registers.read("input", "int", address)


@_known
def read_input_float_register(thread: Thread, address: Value) -> Value:
    return thread.robot.registers.read("input", "double", address)


@_known
def write_output_integer_register(thread: Thread, address: Value, value: Value) -> None:
    if not isinstance(value, int):
        raise ScriptError("an integer register holds integers")
    thread.robot.registers.write("int", address, value)


@_known
def write_output_float_register(thread: Thread, address: Value, value: Value) -> None:
    thread.robot.registers.write("double", address, finite(value))


@_known
def rtde_set_watchdog(
    thread: Thread,
    variable_name: Value,
    min_frequency: Value,
    action: Value = "pause",
) -> None:
    if action != "stop":
        raise ScriptError("a watchdog with another action than stop is not emulated")
    thread.robot.set_watchdog(str(variable_name), quantity(min_frequency, _SLOWEST_HZ))


# state


@_known
def is_steady(thread: Thread) -> bool:
    return bool(thread.robot.motion.steady)


@_known
def get_actual_tcp_pose(thread: Thread) -> PoseValue:
    return PoseValue(thread.robot.motion.tcp_pose)


@_known
def get_actual_tool_flange_pose(thread: Thread) -> PoseValue:
    return PoseValue(kinematics.pose(thread.robot.motion.flange))


@_known
def get_target_tcp_speed(thread: Thread) -> list[float]:
    return list(thread.robot.motion.tcp_speed)


@_known
def get_actual_joint_positions(thread: Thread) -> list[float]:
    return list(thread.robot.motion.q)


@_known
def get_joint_torques(thread: Thread) -> list[float]:
    return [0.0] * kinematics.JOINTS


@_known
def get_steptime(thread: Thread) -> float:
    return float(thread.robot.period_s)


@_known
def set_tcp(thread: Thread, pose: Value) -> None:
    thread.robot.motion.set_tcp(six(pose))


@_known
def get_tcp_offset(thread: Thread) -> PoseValue:
    return PoseValue(thread.robot.motion.tcp_offset)


@_known
def set_payload(thread: Thread, m: Value, cog: Value = None) -> None:
    centre = (0.0, 0.0, 0.0) if cog is None else three(cog)
    thread.robot.set_payload(quantity(m, 0.0, _MOST_KG), centre)


@_known
def set_target_payload(thread: Thread, m: Value, cog: Value, inertia: Value = None) -> None:
    thread.robot.set_payload(quantity(m, 0.0, _MOST_KG), three(cog))


@_known
def get_target_payload(thread: Thread) -> float:
    return float(thread.robot.payload_kg)


@_known
def get_target_payload_cog(thread: Thread) -> list[float]:
    return list(thread.robot.payload_cog_m)


@_known
def get_target_payload_inertia(thread: Thread) -> list[float]:
    return [0.0] * 6


@_known
def protective_stop(thread: Thread) -> None:
    thread.robot.protective_stop()


@_known
def zero_ftsensor(thread: Thread) -> None:
    thread.robot.zero_wrench()


def _without_effect(name: str, reason: str) -> Builtin:
    """For a setting of what this emulator does not model: the log says so."""

    def taken(thread: Thread, value: Value) -> None:
        thread.robot.log(f"{name} has no effect: {reason}")

    return taken


# ur_rtde's script sets these two as it starts, whether it is ever asked for force mode or not
for _name in ("force_mode_set_damping", "force_mode_set_gain_scaling"):
    BUILTINS[_name] = _without_effect(_name, "force mode is not emulated")
BUILTINS["set_gravity"] = _without_effect("set_gravity", "gravity is not modelled")


# geometry


@_known
def get_inverse_kin(
    thread: Thread,
    x: Value,
    qnear: Value = None,
    maxPositionError: Value = 1e-10,
    maxOrientationError: Value = 1e-10,
) -> list[float]:
    q = _joints(thread, six(x), qnear)
    if q is None:
        raise ScriptError("no inverse kinematics solution")
    return q


@_known
def get_inverse_kin_has_solution(
    thread: Thread,
    pose: Value,
    qnear: Value = None,
    maxPositionError: Value = 1e-10,
    maxOrientationError: Value = 1e-10,
) -> bool:
    return _joints(thread, six(pose), qnear) is not None


@_known
def get_forward_kin(thread: Thread, q: Value = None, tcp: Value = None) -> PoseValue:
    motion = thread.robot.motion
    joints = motion.q if q is None else six(q)
    return PoseValue(motion.pose_of(joints, None if tcp is None else six(tcp)))


@_known
def is_within_safety_limits(thread: Thread, pose: Value) -> bool:
    """Reach is the only limit that is modelled."""
    values = six(pose)
    if isinstance(pose, PoseValue):
        return _joints(thread, values) is not None
    return all(abs(angle) <= 2.0 * math.pi for angle in values)


def _not_emulated(name: str) -> Builtin:
    def refuse(thread: Thread, *values: Value, **named: Value) -> None:
        raise ScriptError(f"{name} is not emulated")

    return refuse


# what ur_rtde's script names beside
_NOT_EMULATED = (
    "direct_torque enable_external_ft_sensor end_force_mode end_freedrive_mode end_teach_mode "
    "force_mode freedrive_mode ft_rtde_input_enable get_actual_joint_positions_history "
    "get_coriolis_and_centrifugal_torques get_freedrive_status get_jacobian "
    "get_jacobian_time_derivative get_mass_matrix get_target_joint_accelerations "
    "get_target_waypoint movec movej movep servoc servoj speedj teach_mode tool_contact"
)


BUILTINS |= MATHS | {name: _not_emulated(name) for name in _NOT_EMULATED.split()}
