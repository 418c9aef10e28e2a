"""Built-in functions of emulated URScript programs, as far as ur_rtde's script uses them.

Names, parameters and defaults: Universal Robots, "The URScript Programming Language". The first
parameter is the calling thread; its ``robot`` is the emulated controller.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

from drivers.ur import kinematics
from drivers.ur.emulator.urscript import Steps, Thread
from drivers.ur.emulator.urscript_parser import Builtin
from drivers.ur.emulator.urscript_values import PoseValue, ScriptError, Value

BUILTINS: dict[str, Builtin] = {}
_MAX_QUANTITY = 1e6  # limit of any quantity, in its unit, so that results stay finite
_MAX_SLEEP_S = 3600.0
_MAX_SHOWN_CHARS = 500  # characters of a string
_MAX_PAYLOAD_KG = 12.5  # payload of a UR10e; a UR10 carries 10


def _builtin(function: Builtin) -> Builtin:
    """Register a built-in function; a generator function waits for later cycles."""
    BUILTINS[function.__name__] = function
    return function


def _finite(value: Value) -> float:
    """A finite number; otherwise the program ends."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise ScriptError(f"a finite number expected, not {value!r:.60}")
    return float(value)


def _quantity(value: Value, least: float = -_MAX_QUANTITY, most: float = _MAX_QUANTITY) -> float:
    """A number within limits; otherwise the program ends."""
    number = _finite(value)
    if not least <= number <= most:
        raise ScriptError(f"{number:g} is beyond {least:g} to {most:g}")
    return number


def _numbers(values: Value, count: int = kinematics.JOINTS) -> tuple[float, ...]:
    if not isinstance(values, list) or len(values) != count:
        raise ScriptError(f"{count} numbers expected")
    return tuple(_quantity(value) for value in values)


# motions


def _moving(thread: Thread, start: Callable[[], None]) -> Steps:
    """Wait until a motion is complete; the thread gives up the arm however it ends."""
    motion = thread.robot.motion
    motion.acquire(thread)
    try:
        start()
        yield
        while not motion.arrived:
            yield
    finally:
        motion.release_thread(thread)


@_builtin
def movel(
    thread: Thread, pose: Value, a: Value = 1.2, v: Value = 0.25, t: Value = 0, r: Value = 0
) -> Steps:
    """Move along a line. A blend radius is ignored: every line ends at rest."""
    motion = thread.robot.motion
    target = _numbers(pose)
    if not isinstance(pose, PoseValue):
        target = motion.pose_of(target, None)
    if _quantity(t):
        raise ScriptError("a line in a given time is not emulated")
    yield from _moving(thread, lambda: motion.line(target, _finite(v), _finite(a)))


@_builtin
def speedl(thread: Thread, xd: Value, a: Value = 1.2, t: Value = 0, aRot: Value = "a") -> Steps:
    """Drive for t seconds, at least one cycle. The motion continues afterwards."""
    motion = thread.robot.motion
    x, y, z, rx, ry, rz = _numbers(xd)
    motion.acquire(thread)
    try:
        motion.speed_line((x, y, z), (rx, ry, rz), _finite(a))
        yield from _cycles(thread, _quantity(t, 0.0, _MAX_SLEEP_S))
    finally:
        motion.release_thread(thread)


def _cycles(thread: Thread, seconds: float) -> Steps:
    for _ in range(max(1, round(seconds / thread.robot.period_s))):
        yield


@_builtin
def stopl(thread: Thread, a: Value, aRot: Value = "a") -> Steps:
    motion, deceleration = thread.robot.motion, _finite(a)
    yield from _moving(thread, lambda: motion.stop(deceleration))


@_builtin
def stopj(thread: Thread, a: Value) -> Steps:
    """Brake the tool on its line; the joint deceleration is taken as m/s2."""
    yield from stopl(thread, a)


@_builtin
def sync(thread: Thread) -> Steps:
    yield


@_builtin
def sleep(thread: Thread, t: Value) -> Steps:
    yield from _cycles(thread, min(_finite(t), _MAX_SLEEP_S))


@_builtin
def protective_stop(thread: Thread) -> None:
    thread.robot.protective_stop()


@_builtin
def textmsg(thread: Thread, s1: Value, s2: Value = "") -> None:
    thread.robot.log(f"{s1!s:.{_MAX_SHOWN_CHARS}}{s2!s:.{_MAX_SHOWN_CHARS}}")


# registers


@_builtin
def read_input_integer_register(thread: Thread, address: Value) -> Value:
    return thread.robot.registers.read("input", "int", address)


@_builtin
def read_input_float_register(thread: Thread, address: Value) -> Value:
    return thread.robot.registers.read("input", "double", address)


@_builtin
def write_output_integer_register(thread: Thread, address: Value, value: Value) -> None:
    if not isinstance(value, int):
        raise ScriptError("an integer register holds integers")
    thread.robot.registers.write("int", address, value)


@_builtin
def write_output_float_register(thread: Thread, address: Value, value: Value) -> None:
    thread.robot.registers.write("double", address, _finite(value))


@_builtin
def rtde_set_watchdog(
    thread: Thread, variable_name: Value, min_frequency: Value, action: Value = "pause"
) -> None:
    if action != "stop":
        raise ScriptError("a watchdog with another action than stop is not emulated")
    slowest_hz = 1.0 / _MAX_SLEEP_S
    thread.robot.set_watchdog(str(variable_name), _quantity(min_frequency, slowest_hz))


# state

# read without arguments, from the controller
_STATE: dict[str, Callable[[Any], Value]] = {
    "is_steady": lambda robot: robot.motion.steady,
    "get_actual_tcp_pose": lambda robot: PoseValue(robot.motion.tcp_pose),
    "get_actual_tool_flange_pose": lambda robot: PoseValue(kinematics.pose(robot.motion.flange)),
    "get_target_tcp_speed": lambda robot: list(robot.motion.tcp_speed),
    "get_steptime": lambda robot: robot.period_s,
    "get_tcp_offset": lambda robot: PoseValue(robot.motion.tcp_offset),
    "get_target_payload": lambda robot: robot.payload_kg,
    "get_target_payload_cog": lambda robot: list(robot.payload_cog_m),
    # of six joints or axes; not modelled
    "get_joint_torques": lambda robot: [0.0] * 6,
    "get_target_payload_inertia": lambda robot: [0.0] * 6,
}


def _getter(get: Callable[[Any], Value]) -> Builtin:
    return lambda thread: get(thread.robot)


BUILTINS |= {name: _getter(get) for name, get in _STATE.items()}


@_builtin
def set_tcp(thread: Thread, pose: Value) -> None:
    thread.robot.motion.set_tcp(_numbers(pose))


@_builtin
def set_payload(thread: Thread, m: Value, cog: Value = None) -> None:
    centre = (0.0, 0.0, 0.0) if cog is None else _numbers(cog, 3)
    thread.robot.set_payload(_quantity(m, 0.0, _MAX_PAYLOAD_KG), centre)


@_builtin
def set_target_payload(thread: Thread, m: Value, cog: Value, inertia: Value = None) -> None:
    set_payload(thread, m, cog)


# geometry


@_builtin
def norm(thread: Thread, a: Value) -> float:
    values = a if isinstance(a, list) else [a]
    return math.hypot(*(_finite(value) for value in values))


@_builtin
def pose_trans(thread: Thread, p_from: Value, p_from_to: Value) -> PoseValue:
    first, second = (kinematics.frame(_numbers(pose)) for pose in (p_from, p_from_to))
    return PoseValue(kinematics.pose(first @ second))


@_builtin
def pose_sub(thread: Thread, p_to: Value, p_from: Value) -> PoseValue:
    """Difference of positions and of rotations, in the base frame."""
    to, start = (kinematics.frame(_numbers(pose)) for pose in (p_to, p_from))
    turn = kinematics.rotation_vector(to[:3, :3] @ start[:3, :3].T)
    return PoseValue([*(to[:3, 3] - start[:3, 3]).tolist(), *turn])


def _joints(thread: Thread, pose: Sequence[float], near: Value = None) -> list[float] | None:
    """Joint angles for a pose, or None; it takes as long as a hundred statements."""
    thread.spend(100)
    q = thread.robot.motion.joints_for(pose, None if near is None else _numbers(near))
    return None if q is None else list(q)


@_builtin
def get_inverse_kin(
    thread: Thread, x: Value, qnear: Value = None, *tolerances: Value
) -> list[float]:
    q = _joints(thread, _numbers(x), qnear)
    if q is None:
        raise ScriptError("no inverse kinematics solution")
    return q


@_builtin
def get_inverse_kin_has_solution(
    thread: Thread, pose: Value, qnear: Value = None, *tolerances: Value
) -> bool:
    return _joints(thread, _numbers(pose), qnear) is not None


@_builtin
def get_forward_kin(thread: Thread, q: Value = None, tcp: Value = None) -> PoseValue:
    motion = thread.robot.motion
    joints = motion.q if q is None else _numbers(q)
    return PoseValue(motion.pose_of(joints, None if tcp is None else _numbers(tcp)))


@_builtin
def is_within_safety_limits(thread: Thread, pose: Value) -> bool:
    """Whether a pose is reachable; no other limit is modelled."""
    values = _numbers(pose)
    if isinstance(pose, PoseValue):
        return _joints(thread, values) is not None
    return all(abs(angle) <= kinematics.JOINT_RANGE for angle in values)


# used by ur_rtde's script, but not emulated


def _without_effect(name: str) -> Builtin:
    """Function for a setting that is not modelled; it writes to the log."""

    def taken(thread: Thread, *values: Value) -> None:
        thread.robot.log(f"{name} has no effect: it is not emulated")

    return taken


def _not_emulated(name: str) -> Builtin:
    def refuse(thread: Thread, *values: Value, **named: Value) -> None:
        raise ScriptError(f"{name} is not emulated")

    return refuse


# ur_rtde's script always calls the first two at its start
_WITHOUT_EFFECT = "force_mode_set_damping force_mode_set_gain_scaling set_gravity zero_ftsensor"
_NOT_EMULATED = (
    "enable_external_ft_sensor end_force_mode end_freedrive_mode end_teach_mode force_mode "
    "freedrive_mode ft_rtde_input_enable get_actual_joint_positions_history get_freedrive_status "
    "get_target_waypoint movej servoc servoj speedj teach_mode tool_contact"
)
BUILTINS |= {name: _without_effect(name) for name in _WITHOUT_EFFECT.split()}
BUILTINS |= {name: _not_emulated(name) for name in _NOT_EMULATED.split()}
