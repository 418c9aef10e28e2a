"""Runs URScript: the syntax tree becomes closures and generators, threads take turns each cycle.

An expression or statement that can wait for a later controller cycle becomes a generator function,
every other one a plain function. A thread that loops or calls without ever waiting is ended, as
the controller does ("infinite loop without time"), and so is a program that uses an unknown name.
"""

import functools
import inspect
import math
import operator
from collections.abc import Callable, Generator, Mapping
from types import MappingProxyType
from typing import Any

import drivers.ur.emulator.urscript.syntax as syntax
from drivers.ur.emulator.urscript.parse import ScriptError

Value = Any  # int, float, bool, str, list of values, PoseValue, or None of a function without value
Steps = Generator[None, None, Value]  # yields where it waits for the next cycle
Builtin = Callable[..., Any]

MAX_THREADS = 32
MAX_LOOPS = 100_000  # of one thread between two waits: loops and calls
MAX_CALLS_DEEP = 40
MOST = 1e6  # of whatever an arm is told, in its unit: what is made of it stays finite
_MAX_TEXT = 10_000
_INT_RANGE = 2**31


class PoseValue(list[float]):
    """A ``p[...]``; as every list of URScript it is copied when it is assigned."""


class Halt(Exception):
    """``halt``: the program ends, and nothing is wrong."""


class Thread:
    """One thread of a running program."""

    def __init__(self, program: "Program", handle: int, steps: Steps) -> None:
        self.program = program
        self.handle = handle
        self.steps = steps
        self.deep = 0
        self._loops = 0

    @property
    def robot(self) -> Any:
        """What the built-in functions act on."""
        return self.program.robot

    def step(self) -> bool:
        """Run until the thread waits for the next cycle; False when it has ended."""
        self._loops = 0
        try:
            next(self.steps)
        except StopIteration:
            return False
        return True

    def spend(self) -> None:
        """Count a loop or a call."""
        self._loops += 1
        if self._loops > MAX_LOOPS:
            raise ScriptError("infinite loop without time")


class Scope:
    """Variables of one call."""

    __slots__ = ("local", "result", "shared", "thread")

    def __init__(self, thread: Thread, local: dict[str, Value]) -> None:
        self.thread = thread
        self.local = local
        self.shared = thread.program.shared
        self.result: Value = None

    def put(self, name: str, value: Value, shared: bool) -> None:
        """Give a variable its value."""
        (self.shared if shared else self.local)[name] = value

    def put_element(self, name: str, at: Value, value: Value) -> None:
        values = self[name]
        values[position_in(values, at)] = element_for(values, value)

    def __getitem__(self, name: str) -> Value:
        for values in (self.local, self.shared):
            if name in values:
                return values[name]
        raise ScriptError(f"variable {name} has no value yet")


def _at_once(now: Callable[[Scope], Value] | None, scope: Scope) -> Steps:
    """Stepwise form of code that never waits."""
    yield from ()
    return now(scope) if now else None


class Code:
    """Compiled expression (its value is the result) or statement (the result is a signal)."""

    __slots__ = ("now", "steps")

    def __init__(
        self,
        now: Callable[[Scope], Value] | None = None,
        steps: Callable[[Scope], Steps] | None = None,
    ) -> None:
        self.now = now
        self.steps = steps or functools.partial(_at_once, now)


BREAK, CONTINUE, RETURN = "break", "continue", "return"  # signals; None goes on


def lift(operation: Callable[..., Value], operands: list[Code]) -> Code:
    """Evaluate the operands in order, then apply the operation."""
    plain = [code.now for code in operands if code.now is not None]
    if len(plain) == len(operands):
        return Code(lambda scope: operation(scope, *[now(scope) for now in plain]))

    def steps(scope: Scope) -> Steps:
        values = []
        for code in operands:
            values.append(code.now(scope) if code.now else (yield from code.steps(scope)))
        return operation(scope, *values)

    return Code(None, steps)


def copied(value: Value) -> Value:
    return type(value)(value) if isinstance(value, list) else value


def _checked(value: Value) -> Value:
    """Results of arithmetic within the controller's types."""
    if isinstance(value, int) and not -_INT_RANGE <= value < _INT_RANGE:
        raise ScriptError("integer overflow")
    if isinstance(value, str) and len(value) > _MAX_TEXT:
        raise ScriptError("string too long")
    return value


def _arithmetic(function: Callable[[Any, Any], Any], left: Value, right: Value) -> Value:
    if not isinstance(left, int | float) or not isinstance(right, int | float):
        raise ScriptError("arithmetic on what is not a number")
    return _checked(function(left, right))


def _plus(left: Value, right: Value) -> Value:
    if isinstance(left, str) and isinstance(right, str):
        return _checked(left + right)
    return _arithmetic(operator.add, left, right)


def _compare(function: Callable[[Any, Any], bool], left: Value, right: Value) -> bool:
    if not isinstance(left, int | float) or not isinstance(right, int | float):
        raise ScriptError("comparison of what is not a number")
    return function(left, right)


def _numbers(function: Callable[[Any, Any], Any]) -> Callable[[Value, Value], Value]:
    return functools.partial(_arithmetic, function)


OPERATORS: Mapping[str, Callable[[Value, Value], Value]] = MappingProxyType(
    {
        "+": _plus,
        "-": _numbers(operator.sub),
        "*": _numbers(operator.mul),
        "/": _numbers(operator.truediv),
        "%": _numbers(operator.mod),
        "==": operator.eq,
        "!=": operator.ne,
        "<": functools.partial(_compare, operator.lt),
        ">": functools.partial(_compare, operator.gt),
        "<=": functools.partial(_compare, operator.le),
        ">=": functools.partial(_compare, operator.ge),
        "xor": lambda left, right: bool(left) != bool(right),
    }
)


def negative(value: Value) -> Value:
    if not isinstance(value, int | float):
        raise ScriptError("minus before what is not a number")
    return _checked(-value)


def position_in(values: Value, at: Value) -> int:
    """A valid place in a list."""
    if not isinstance(values, list) or not isinstance(at, int):
        raise ScriptError("index into what is no list, or by what is no integer")
    if not 0 <= at < len(values):
        raise ScriptError(f"index {at} out of range")
    return int(at)


def make_pose(values: tuple[Value, ...]) -> PoseValue:
    if len(values) != 6 or not all(isinstance(value, int | float) for value in values):
        raise ScriptError("a pose is six numbers")
    return PoseValue(map(float, values))


def make_list(values: tuple[Value, ...]) -> list[Value]:
    return [element_for([], value) for value in values]


def element_for(values: list[Value], value: Value) -> Value:
    """What may be stored in this list: poses hold numbers, other lists no further list."""
    simple = not isinstance(value, list) or isinstance(value, PoseValue)
    if not simple or (isinstance(values, PoseValue) and not isinstance(value, int | float)):
        raise ScriptError("a list does not hold this")
    return copied(value)


class UserFunction:
    """A function or thread of the program; the body is filled in once all names are known."""

    def __init__(self, definition: syntax.Function) -> None:
        self.name = definition.name
        self.parameters = definition.parameters
        self.thread = definition.thread
        self.body = Code()

    def call(self, thread: Thread, arguments: tuple[Value, ...]) -> Steps:
        thread.spend()
        if thread.deep >= MAX_CALLS_DEEP:
            raise ScriptError("calls nested too deep")
        values = map(copied, arguments)
        scope = Scope(thread, dict(zip(self.parameters, values, strict=True)))
        thread.deep += 1
        yield from self.body.steps(scope)
        thread.deep -= 1
        return scope.result


_signature = functools.cache(inspect.signature)


def check_arguments(builtin: Builtin, call: syntax.Call) -> None:
    """The built-in takes what the call gives it; raises ScriptError."""
    named = dict(call.named)
    try:
        _signature(builtin).bind(None, *call.positional, **named)
    except TypeError as error:
        raise ScriptError(f"{call.name}: {error}") from None


class Compiled:
    """A program ready to be started any number of times."""

    def __init__(self, name: str, main: UserFunction) -> None:
        self.name = name
        self.main = main


class Program:
    """A running program: global variables and threads, the first of which is the main one."""

    def __init__(self, compiled: Compiled, robot: Any, most_threads: int = MAX_THREADS) -> None:
        self.name = compiled.name
        self._most_threads = most_threads
        self.robot = robot
        self.shared: dict[str, Value] = {}
        self.critical: Thread | None = None
        self._handles = 0
        self._threads: list[Thread] = []
        self.start(compiled.main)

    def start(self, function: UserFunction) -> int:
        """Start a thread; returns its handle."""
        if len(self._threads) >= self._most_threads:
            raise ScriptError(f"too many threads: {self._most_threads + 1}")
        self._handles += 1
        thread = Thread(self, self._handles, iter(()))  # type: ignore[arg-type]
        thread.steps = function.call(thread, ())
        self._threads.append(thread)
        return thread.handle

    def kill(self, handle: Value, by: Thread) -> None:
        """End a thread; a handle of none, or of one that has ended, is ignored."""
        for thread in [thread for thread in self._threads if thread.handle == handle]:
            if thread is by:
                raise ScriptError("a thread cannot kill itself")
            self._end(thread)

    def step(self) -> bool:
        """One cycle: each thread runs until it waits, in turn. False once the main thread has
        ended. Raises ScriptError."""
        main = self._threads[0]
        try:
            for thread in list(self._threads):
                waiting = self.critical is not None and self.critical is not thread
                if not waiting and thread in self._threads and not thread.step():
                    self._end(thread)
        except Halt:
            return False
        except (ArithmeticError, RecursionError, TypeError, ValueError) as error:
            raise ScriptError(f"{type(error).__name__}: {error}") from error
        return main in self._threads

    def _end(self, thread: Thread) -> None:
        self._threads.remove(thread)
        thread.steps.close()
        if self.critical is thread:
            self.critical = None

    def close(self) -> None:
        """End all threads, so that what they hold is let go of."""
        for thread in list(self._threads):
            self._end(thread)


def quantity(value: Value, least: float = -MOST, most: float = MOST) -> float:
    """A number that an arm may be given; anything else ends the program."""
    number = finite(value)
    if not least <= number <= most:
        raise ScriptError(f"{number:g} is beyond {least:g} to {most:g}")
    return number


def finite(value: Value) -> float:
    """A finite number; anything else ends the program."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise ScriptError(f"a finite number expected, not {value!r}")
    return float(value)
