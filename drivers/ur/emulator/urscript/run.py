"""Runs URScript: the syntax tree becomes closures and generators, threads take turns each cycle.

An expression or statement that can wait for a later controller cycle becomes a generator function,
every other one a plain function. A thread that loops or calls without ever waiting is ended, as
the controller does ("infinite loop without time"), and so is a program that uses an unknown name.
One that computes for longer than a cycle has time for is interrupted, and goes on in the next.
"""

import functools
import inspect
import math
import operator
import sys
from collections.abc import Callable, Generator, Mapping
from types import MappingProxyType
from typing import Any

import drivers.ur.emulator.urscript.syntax as syntax
from drivers.ur.emulator.urscript.parse import ScriptError

Value = Any  # int, float, bool, str, list of values, PoseValue, or None of a function without value
Steps = Generator[Any, None, Value]  # what is yielded: see INTERRUPTED
Builtin = Callable[..., Any]

MAX_THREADS = 32
MOST_BYTES = 32_000_000  # of what a program keeps: its variables, calls and unfinished expressions
_SLOT_BYTES, _CALL_BYTES = 100, 2000  # of a variable with a number in it; of a call
MAX_WORK = 2_000_000  # of one thread between two waits: see `syntax.Weigher`
MOST_AT_ONCE = 300  # work; what is more can be interrupted
MAX_CALLS_DEEP = 40
MOST = 1e6  # of whatever an arm is told, in its unit: what is made of it stays finite
LOOK_EACH = 200  # work; looking at the clock is some of it
_MAX_TEXT = 10_000
_INT_RANGE = 2**31


INTERRUPTED = True  # yielded by a thread that does not wait, but has no time left


def never() -> bool:
    """Time without end."""
    return False


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
        self.interrupted = False
        self._spent = 0
        self._unseen = 0  # work since the clock was looked at

    @property
    def robot(self) -> Any:
        """What the built-in functions act on."""
        return self.program.robot

    def step(self) -> bool:
        """Run until the thread waits for the next cycle or is interrupted; False when it has
        ended."""
        if not self.interrupted:
            self._spent = 0
        try:
            self.interrupted = next(self.steps) is INTERRUPTED
        except StopIteration:
            self.interrupted = False
            return False
        return True

    def spend(self, work: int) -> bool:
        """Count what is run at most before the next call; True when it has to wait for time."""
        self._spent += work
        if self._spent > MAX_WORK:
            raise ScriptError("infinite loop without time")
        return self.look(work)

    def look(self, work: int) -> bool:
        """True when there is no time for so much work."""
        self._unseen += work
        if self._unseen < LOOK_EACH:
            return False
        self._unseen = 0
        return self.program.out_of_time()


class Scope:
    """Variables of one call."""

    __slots__ = ("_held", "local", "result", "shared", "thread")

    def __init__(self, thread: Thread, local: dict[str, Value]) -> None:
        self.thread = thread
        self.local = local
        self.shared = thread.program.shared
        self.result: Value = None
        self._held = _CALL_BYTES + sum(map(size_of, local.values()))
        thread.program.hold(self._held)

    def put(self, name: str, value: Value, shared: bool) -> None:
        """Give a variable its value."""
        values = self.shared if shared else self.local
        self._hold(size_of(value) - (size_of(values[name]) if name in values else 0), shared)
        values[name] = value

    def put_element(self, name: str, at: Value, value: Value) -> None:
        values = self[name]
        place, new = position_in(values, at), element_for(values, value)
        self._hold(size_of(new) - size_of(values[place]), name not in self.local)
        values[place] = new

    def __getitem__(self, name: str) -> Value:
        for values in (self.local, self.shared):
            if name in values:
                return values[name]
        raise ScriptError(f"variable {name} has no value yet")

    def _hold(self, more: int, shared: bool) -> None:
        if more:
            self.thread.program.hold(more)
            self._held += 0 if shared else more

    def end(self) -> None:
        self.thread.program.hold(-self._held)


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
        values, held = [], 0
        try:
            for code in operands:
                value = code.now(scope) if code.now else (yield from code.steps(scope))
                values.append(value)
                scope.thread.program.hold(size_of(value))
                held += size_of(value)
            return operation(scope, *values)
        finally:
            scope.thread.program.hold(-held)

    return Code(None, steps)


def charged(code: Code, work: int) -> Code:
    """As the code, which is first counted, and may be interrupted before it."""

    def steps(scope: Scope) -> Steps:
        if scope.thread.spend(work):
            yield INTERRUPTED
        return code.now(scope) if code.now else (yield from code.steps(scope))

    return Code(None, steps)


def size_of(value: Value) -> int:
    """Bytes; a string that two variables share counts twice."""
    if isinstance(value, list):
        return _SLOT_BYTES + sum(map(size_of, value))
    return _SLOT_BYTES + sys.getsizeof(value) if isinstance(value, str) else _SLOT_BYTES


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
        self.work = 1  # to count at each call

    def call(self, thread: Thread, arguments: tuple[Value, ...]) -> Steps:
        if thread.spend(self.work):
            yield INTERRUPTED
        if thread.deep >= MAX_CALLS_DEEP:
            raise ScriptError("calls nested too deep")
        values = map(copied, arguments)
        scope = Scope(thread, dict(zip(self.parameters, values, strict=True)))
        thread.deep += 1
        try:
            yield from self.body.steps(scope)
        finally:
            scope.end()
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
        self._held = 0  # bytes
        self.robot = robot
        self.shared: dict[str, Value] = {}
        self.critical: Thread | None = None
        self._handles = 0
        self._threads: list[Thread] = []
        self._turn: list[Thread] = []  # who has not waited yet in this turn
        self.out_of_time = never
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

    def hold(self, size: int) -> None:
        """Count bytes that are kept; below 0: that are kept no more."""
        self._held += size
        if size > 0 and self._held > MOST_BYTES:
            raise ScriptError(f"out of memory: a program has {MOST_BYTES // 10**6} MB")

    def kill(self, handle: Value, by: Thread) -> None:
        """End a thread; a handle of none, or of one that has ended, is ignored."""
        for thread in [thread for thread in self._threads if thread.handle == handle]:
            if thread is by:
                raise ScriptError("a thread cannot kill itself")
            self._end(thread)

    @property
    def interrupted(self) -> bool:
        """Not all threads have had their turn."""
        return bool(self._turn)

    def step(self, out_of_time: Callable[[], bool] = never) -> bool:
        """One cycle; False once the main thread has ended. Raises ScriptError.

        Each thread runs until it waits, in turn. When there is no time left, the turn is continued
        in the next cycle.
        """
        main, self.out_of_time = self._threads[0], out_of_time
        try:
            self._turn = self._turn or list(self._threads)
            while self._turn and not out_of_time():
                if not self._step(self._turn[0]):
                    del self._turn[0]
        except Halt:
            return False
        except (ArithmeticError, RecursionError, TypeError, ValueError) as error:
            raise ScriptError(f"{type(error).__name__}: {error}") from error
        return main in self._threads

    def _step(self, thread: Thread) -> bool:
        """True when the thread was interrupted."""
        waiting = self.critical is not None and self.critical is not thread
        if waiting or thread not in self._threads:
            return False
        if not thread.step():
            self._end(thread)
        return thread.interrupted

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
