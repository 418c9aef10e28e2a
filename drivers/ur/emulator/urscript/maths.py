"""Numbers, poses and lists in URScript: functions that need no robot.

Names and parameters: Universal Robots, "The URScript Programming Language".
"""

import math
from collections.abc import Callable

from drivers.ur import kinematics
from drivers.ur.emulator.urscript.parse import ScriptError
from drivers.ur.emulator.urscript.run import (
    Builtin,
    PoseValue,
    Thread,
    Value,
    finite,
    quantity,
)

MATHS: dict[str, Builtin] = {}


def _known(function: Builtin) -> Builtin:
    MATHS[function.__name__] = function
    return function


def _of_one(name: str, function: Callable[[float], float]) -> None:
    def apply(thread: Thread, f: Value) -> Value:
        return function(finite(f))

    MATHS[name] = apply


for _name in ("sin", "cos", "tan", "asin", "acos", "atan", "sqrt", "ceil", "floor"):
    _of_one(_name, getattr(math, _name))
_of_one("d2r", math.radians)
_of_one("r2d", math.degrees)


@_known
def norm(thread: Thread, a: Value) -> float:
    values = a if isinstance(a, list) else [a]
    return math.hypot(*(finite(value) for value in values))


# poses


def six(values: Value) -> tuple[float, ...]:
    """Six numbers that an arm may be given."""
    if not isinstance(values, list) or len(values) != kinematics.JOINTS:
        raise ScriptError("six numbers expected")
    return tuple(quantity(value) for value in values)


def three(values: Value) -> tuple[float, ...]:
    if not isinstance(values, list) or len(values) != 3:
        raise ScriptError("three numbers expected")
    return tuple(quantity(value) for value in values)


@_known
def pose_trans(thread: Thread, p_from: Value, p_from_to: Value) -> PoseValue:
    return PoseValue(
        kinematics.pose(kinematics.frame(six(p_from)) @ kinematics.frame(six(p_from_to)))
    )


@_known
def pose_inv(thread: Thread, p_from: Value) -> PoseValue:
    return PoseValue(kinematics.pose(kinematics.inverted(kinematics.frame(six(p_from)))))


@_known
def pose_sub(thread: Thread, p_to: Value, p_from: Value) -> PoseValue:
    """Positions and rotations subtracted each for itself, in the base frame."""
    to, start = kinematics.frame(six(p_to)), kinematics.frame(six(p_from))
    turn = kinematics.rotation_vector(to[:3, :3] @ start[:3, :3].T)
    return PoseValue([*(to[:3, 3] - start[:3, 3]).tolist(), *turn])


@_known
def size(thread: Thread, v: Value) -> int:
    if not isinstance(v, list | str):
        raise ScriptError("the length of what is neither list nor string")
    return len(v)
