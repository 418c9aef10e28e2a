"""Values of URScript, and what operators do with them."""

import operator
from collections.abc import Callable, Mapping
from typing import Any

Value = Any  # int, float, bool, str, list of values, PoseValue; None: no value

INT_RANGE = 2**31


class ScriptError(Exception):
    """The program is invalid, or failed at run time; the controller ends it."""


class PoseValue(list[float]):
    """A ``p[...]``; copied on assignment like every list of URScript."""


def copied(value: Value) -> Value:
    """Copy of a list; other values as they are."""
    return type(value)(value) if isinstance(value, list) else value


def _arithmetic(function: Callable[[Any, Any], Any]) -> Callable[[Value, Value], Value]:
    """Arithmetic on numbers only, with the controller's range of integers."""

    def apply(left: Value, right: Value) -> Value:
        if not isinstance(left, int | float) or not isinstance(right, int | float):
            raise ScriptError("arithmetic or comparison of what is not a number")
        value = function(left, right)
        if isinstance(value, int) and not -INT_RANGE <= value < INT_RANGE:
            raise ScriptError("integer overflow")
        return value

    return apply


_ON_NUMBERS = {
    "Add": operator.add, "Sub": operator.sub, "Mult": operator.mul, "Div": operator.truediv,
    "Mod": operator.mod, "Lt": operator.lt, "Gt": operator.gt, "LtE": operator.le,
    "GtE": operator.ge,
}  # fmt: skip
# by their names in Python's syntax tree
OPERATORS: Mapping[str, Callable[[Value, Value], Value]] = {
    "Eq": operator.eq,
    "NotEq": operator.ne,
    **{name: _arithmetic(function) for name, function in _ON_NUMBERS.items()},
}


def negative(value: Value) -> Value:
    return OPERATORS["Sub"](0, value)


def make_list(*values: Value) -> list[Value]:
    return [element_for([], value) for value in values]


def make_pose(*values: Value) -> PoseValue:
    if len(values) != 6 or not all(isinstance(value, int | float) for value in values):
        raise ScriptError("a pose is six numbers")
    return PoseValue(map(float, values))


def element(values: Value, at: Value) -> Value:
    """Element of a list; raises ScriptError for an invalid index."""
    return values[position_in(values, at)]


def position_in(values: Value, at: Value) -> int:
    """Index of a list element; raises ScriptError when invalid."""
    if not isinstance(values, list) or not isinstance(at, int):
        raise ScriptError("index into what is no list, or by what is no integer")
    if not 0 <= at < len(values):
        raise ScriptError(f"index {at} out of range")
    return at


def set_element(values: Value, at: Value, value: Value) -> None:
    values[position_in(values, at)] = element_for(values, value)


def element_for(values: list[Value], value: Value) -> Value:
    """Value to store in a list: poses hold numbers, other lists hold no lists."""
    simple = not isinstance(value, list) or isinstance(value, PoseValue)
    if not simple or (isinstance(values, PoseValue) and not isinstance(value, int | float)):
        raise ScriptError("a list does not hold this")
    return copied(value)
