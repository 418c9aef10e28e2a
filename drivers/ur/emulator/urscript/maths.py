"""Numbers, poses, lists and strings in URScript: functions that need no robot.

Names and parameters: Universal Robots, "The URScript Programming Language".
"""

import math
import random
from collections.abc import Callable

from drivers.ur import kinematics
from drivers.ur.emulator.urscript.parse import ScriptError
from drivers.ur.emulator.urscript.run import (
    Builtin,
    PoseValue,
    Thread,
    Value,
    finite,
    position_in,
    quantity,
)

_MAX_TEXT = 10_000
MATHS: dict[str, Builtin] = {}


def _known(function: Builtin) -> Builtin:
    MATHS[function.__name__.removesuffix("_")] = function
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
def atan2(thread: Thread, x: Value, y: Value) -> float:
    return math.atan2(finite(x), finite(y))


@_known
def pow_(thread: Thread, base: Value, exponent: Value) -> float:
    return math.pow(finite(base), finite(exponent))


@_known
def log(thread: Thread, b: Value, f: Value) -> float:
    """The base comes first."""
    return math.log(finite(f), finite(b))


@_known
def random_(thread: Thread) -> float:
    return random.random()


@_known
def norm(thread: Thread, a: Value) -> float:
    values = a if isinstance(a, list) else [a]
    return math.hypot(*(finite(value) for value in values))


@_known
def normalize(thread: Thread, v: Value) -> list[float]:
    length = norm(thread, v)
    if not isinstance(v, list) or not length:
        raise ScriptError("no direction to normalize")
    return [finite(value) / length for value in v]


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
def pose_add(thread: Thread, p_1: Value, p_2: Value) -> PoseValue:
    """Positions and rotations added each for itself, in the base frame."""
    first, second = kinematics.frame(six(p_1)), kinematics.frame(six(p_2))
    turn = kinematics.rotation_vector(second[:3, :3] @ first[:3, :3])
    return PoseValue([*(first[:3, 3] + second[:3, 3]).tolist(), *turn])


@_known
def pose_sub(thread: Thread, p_to: Value, p_from: Value) -> PoseValue:
    """Positions and rotations subtracted each for itself, in the base frame."""
    to, start = kinematics.frame(six(p_to)), kinematics.frame(six(p_from))
    turn = kinematics.rotation_vector(to[:3, :3] @ start[:3, :3].T)
    return PoseValue([*(to[:3, 3] - start[:3, 3]).tolist(), *turn])


@_known
def point_dist(thread: Thread, p_from: Value, p_to: Value) -> float:
    return math.dist(six(p_from)[:3], six(p_to)[:3])


@_known
def pose_dist(thread: Thread, p_from: Value, p_to: Value) -> float:
    return math.hypot(*pose_sub(thread, p_to, p_from))


@_known
def interpolate_pose(thread: Thread, p_from: Value, p_to: Value, alpha: Value) -> PoseValue:
    """Linear in position, about one axis in rotation."""
    start, end, share = six(p_from), six(p_to), quantity(alpha)
    turned = kinematics.turned(kinematics.rotation(start[3:]), kinematics.rotation(end[3:]), share)
    position = [a + share * (b - a) for a, b in zip(start[:3], end[:3], strict=True)]
    return PoseValue([*position, *kinematics.rotation_vector(turned)])


# lists and strings


@_known
def length(thread: Thread, v: Value) -> int:
    if not isinstance(v, list | str):
        raise ScriptError("the length of what is neither list nor string")
    return len(v)


MATHS |= {"get_list_length": length, "size": length, "str_len": length}


def _text(value: Value) -> str:
    """As a program prints it."""
    if isinstance(value, list):
        if sum(len(one) for one in value if isinstance(one, str)) > _MAX_TEXT:
            raise ScriptError("string too long")
        sign = "p" if isinstance(value, PoseValue) else ""
        return f"{sign}[{', '.join(map(_text, value))}]"
    if isinstance(value, float):
        return f"{value:g}"
    return str(value)


@_known
def to_str(thread: Thread, val: Value) -> str:
    return _text(val)


@_known
def to_num(thread: Thread, str_to_convert: Value) -> Value:
    try:
        text = _text(str_to_convert)
        return int(text) if text.strip().lstrip("+-").isdigit() else finite(float(text))
    except ValueError:
        raise ScriptError(f"no number: {_text(str_to_convert)[:60]!r}") from None


@_known
def str_cat(thread: Thread, op1: Value, op2: Value) -> str:
    joined = _text(op1) + _text(op2)
    if len(joined) > _MAX_TEXT:
        raise ScriptError("string too long")
    return joined


@_known
def str_at(thread: Thread, src: Value, index: Value) -> str:
    return _text(src)[position_in(list(_text(src)), index)]


@_known
def str_sub(thread: Thread, src: Value, index: Value, length: Value = -1) -> str:
    text = _text(src)
    start = position_in(list(text), index)
    return text[start:] if quantity(length) < 0 else text[start : start + int(quantity(length))]


@_known
def str_find(thread: Thread, src: Value, target: Value, start_from: Value = 0) -> int:
    return _text(src).find(_text(target), int(quantity(start_from)))


@_known
def str_empty(thread: Thread, s: Value) -> bool:
    return not _text(s)


@_known
def integer_to_binary_list(thread: Thread, x: Value) -> list[bool]:
    """The lowest bit first, 32 of them."""
    return [bool(int(quantity(x)) >> bit & 1) for bit in range(32)]


@_known
def binary_list_to_integer(thread: Thread, bits: Value) -> int:
    if not isinstance(bits, list) or len(bits) > 31:
        raise ScriptError("a list of up to 31 bits expected")
    return sum(bool(bit) << place for place, bit in enumerate(bits))
