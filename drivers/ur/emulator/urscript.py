"""Interpreter of URScript programs: a syntax tree, and threads that run in turn each cycle.

Each node evaluates its ``parts`` in order and computes its value from theirs. ``now`` does so at
once. ``steps`` is a generator that yields where the program waits for the next controller cycle.
``waits`` says whether a node needs ``steps``. A statement's value is a signal, or None to continue.
"""

from collections.abc import Callable, Generator
from typing import Any

from drivers.ur.emulator.urscript_values import (
    ScriptError,
    Value,
    copied,
    element,
    element_for,
    position_in,
)

Steps = Generator[None, None, Value]
# first argument: the calling thread; a generator function waits for cycles
Builtin = Callable[..., Any]

MAX_STEPS = 20_000  # limit for one thread in one cycle: statements and calls
MAX_THREADS = 32
BREAK, CONTINUE, RETURN = "break", "continue", "return"  # signals


class Thread:
    """Thread of a running program."""

    def __init__(self, program: "Program", handle: int, function: "Function") -> None:
        self.program = program
        self.robot = program.robot  # emulated controller, for the built-in functions
        self.handle = handle
        self.left = MAX_STEPS
        self.steps = function.call(self)

    def step(self) -> bool:
        """Run until the thread waits for the next cycle; False when it has ended."""
        self.left = MAX_STEPS
        try:
            next(self.steps)
        except StopIteration:
            return False
        return True

    def spend(self) -> None:
        self.left -= 1
        if self.left < 0:
            raise ScriptError("infinite loop without time")


class Scope:
    """Variables of one call."""

    __slots__ = ("local", "result", "thread")

    def __init__(self, thread: Thread, local: dict[str, Value]) -> None:
        self.thread = thread
        self.local = local
        self.result: Value = None

    def __getitem__(self, name: str) -> Value:
        for values in (self.local, self.thread.program.shared):
            if name in values:
                return values[name]
        raise ScriptError(f"variable {name} has no value yet")


class Function:
    """Function or thread of the program; forward references are filled in by the definition."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.parameters: tuple[str, ...] = ()
        self.body: Block | None = None
        self.is_thread = False

    def call(self, thread: Thread, *arguments: Value) -> Steps:
        assert self.body is not None  # noqa: S101  (the parser refuses undefined functions)
        local = dict(zip(self.parameters, map(copied, arguments), strict=True))
        scope = Scope(thread, local)
        yield from self.body.steps(scope)
        return scope.result


class Program:
    """A running program: global variables and threads, the first of which is the main one."""

    def __init__(self, main: Function, robot: Any) -> None:
        self.name = main.name
        self.robot = robot
        self.shared: dict[str, Value] = {}
        self.critical: Thread | None = None  # in a critical section: no other one runs
        self._handles = 0
        self._threads: list[Thread] = []
        self.start(main)

    def start(self, function: Function) -> int:
        """Start a thread; returns its handle."""
        if len(self._threads) >= MAX_THREADS:
            raise ScriptError("too many threads")
        self._handles += 1
        self._threads.append(Thread(self, self._handles, function))
        return self._handles

    def kill(self, handle: Value, by: Thread) -> None:
        """End a thread; an invalid handle is ignored."""
        if (thread := self.other_thread(handle, by)) is not None:
            self._end(thread)

    def other_thread(self, handle: Value, by: Thread) -> Thread | None:
        """Running thread with this handle; raises ScriptError for the calling thread itself."""
        if handle == by.handle:
            raise ScriptError("a thread cannot kill or join itself")
        return next((each for each in self._threads if each.handle == handle), None)

    def step(self) -> bool:
        """Run one cycle: each thread in turn until it waits. False once the main thread has ended.
        Raises ScriptError."""
        main = self._threads[0]
        try:
            for thread in list(self._threads):
                blocked = self.critical is not None and self.critical is not thread
                if not blocked and thread in self._threads and not thread.step():
                    self._end(thread)
        except RecursionError:
            raise ScriptError("nested too deep") from None
        except (ArithmeticError, TypeError, ValueError) as error:
            raise ScriptError(f"{type(error).__name__}: {error}") from error
        return main in self._threads

    def _end(self, thread: Thread) -> None:
        self._threads.remove(thread)
        thread.steps.close()
        if self.critical is thread:
            self.critical = None

    def close(self) -> None:
        """End all threads, so that they release their resources."""
        for thread in list(self._threads):
            self._end(thread)


# expressions


class Node:
    """Node of the syntax tree."""

    waits: bool

    def __init__(self, *parts: "Node") -> None:
        self.parts = parts
        self.waits = any(part.waits for part in parts)

    def apply(self, scope: Scope, *values: Value) -> Value:
        """Value computed from the values of its parts; not used by nodes that override ``now``."""
        raise NotImplementedError

    def now(self, scope: Scope) -> Value:
        return self.apply(scope, *[part.now(scope) for part in self.parts])

    def steps(self, scope: Scope) -> Steps:
        values = []
        for part in self.parts:
            values.append((yield from part.steps(scope)) if part.waits else part.now(scope))
        return self.apply(scope, *values)


class Literal(Node):
    """A number, a boolean or a string."""

    def __init__(self, value: float | str) -> None:
        super().__init__()
        self._value = value

    def now(self, scope: Scope) -> Value:
        return self._value


class Name(Node):
    """A variable."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name

    def now(self, scope: Scope) -> Value:
        return scope[self.name]


class Operation(Node):
    """A function of the values of its parts."""

    def __init__(self, function: Callable[..., Value], *parts: Node) -> None:
        super().__init__(*parts)
        self._function = function

    def apply(self, scope: Scope, *values: Value) -> Value:
        return self._function(*values)


class Index(Operation):
    """``values[at]``."""

    def __init__(self, base: Node, at: Node) -> None:
        super().__init__(element, base, at)


class Logical(Node):
    """``and``, ``or`` with short-circuit evaluation."""

    def __init__(self, sign: str, left: Node, right: Node) -> None:
        super().__init__(left, right)
        self._left, self._right, self._decided = left, right, sign == "or"

    def now(self, scope: Scope) -> Value:
        value = bool(self._left.now(scope))
        return value if value is self._decided else bool(self._right.now(scope))

    def steps(self, scope: Scope) -> Steps:
        value = bool((yield from _evaluated(self._left, scope)))
        if value is self._decided:
            return value
        return bool((yield from _evaluated(self._right, scope)))


class Call(Node):
    """Call ``name(a, b, key=c)`` of a built-in or program function; ``keys`` name the last
    arguments."""

    def __init__(
        self, function: Builtin, *parts: Node, keys: tuple[str, ...] = (), waits: bool
    ) -> None:
        super().__init__(*parts)
        self._function, self._keys, self._returns_steps = function, keys, waits
        self._positional = len(parts) - len(keys)
        self.waits = self.waits or waits

    def apply(self, scope: Scope, *values: Value) -> Value:
        scope.thread.spend()
        if not self._keys:
            return self._function(scope.thread, *values)
        named = dict(zip(self._keys, values[self._positional :], strict=True))
        return self._function(scope.thread, *values[: self._positional], **named)

    def steps(self, scope: Scope) -> Steps:
        result = yield from super().steps(scope)
        return (yield from result) if self._returns_steps else result


class Run(Node):
    """``run name()``: start a thread; its value is the handle."""

    def __init__(self, function: Function) -> None:
        super().__init__()
        self._function = function

    def now(self, scope: Scope) -> Value:
        return scope.thread.program.start(self._function)


# statements


class Evaluate(Node):
    """An expression as a statement."""

    def apply(self, scope: Scope, *values: Value) -> None:
        return None


class Assign(Node):
    """``name = value``; without ``shared`` it sets a global variable only if one exists."""

    def __init__(self, name: str, value: Node, shared: bool) -> None:
        super().__init__(value)
        self._name, self._shared = name, shared

    def apply(self, scope: Scope, *values: Value) -> None:
        name, shared = self._name, scope.thread.program.shared
        here = not self._shared and (name in scope.local or name not in shared)
        (scope.local if here else shared)[name] = copied(values[0])


class AssignElement(Node):
    """``name[at] = value``."""

    def __init__(self, name: str, at: Node, value: Node) -> None:
        super().__init__(at, value)
        self._name = name

    def apply(self, scope: Scope, *values: Value) -> None:
        at, value = values
        target = scope[self._name]
        target[position_in(target, at)] = element_for(target, value)


class Block(Node):
    """Statements in order."""

    def now(self, scope: Scope) -> Value:
        for part in self.parts:
            scope.thread.spend()
            if (signal := part.now(scope)) is not None:
                return signal
        return None

    def steps(self, scope: Scope) -> Steps:
        for part in self.parts:
            scope.thread.spend()
            signal = (yield from part.steps(scope)) if part.waits else part.now(scope)
            if signal is not None:
                return signal
        return None


class If(Node):
    """Pairs of condition and body, in order; the last condition may be a literal True."""

    def __init__(self, branches: list[tuple[Node, Block]]) -> None:
        super().__init__(*(part for branch in branches for part in branch))
        self._branches = branches

    def now(self, scope: Scope) -> Value:
        for condition, body in self._branches:
            if condition.now(scope):
                return body.now(scope)
        return None

    def steps(self, scope: Scope) -> Steps:
        for condition, body in self._branches:
            if (yield from _evaluated(condition, scope)):
                return (yield from _evaluated(body, scope))
        return None


class While(Node):
    """A loop."""

    def __init__(self, condition: Node, body: Block) -> None:
        super().__init__(condition, body)
        self._condition, self._body = condition, body
        self.waits = True

    def steps(self, scope: Scope) -> Steps:
        while (yield from _evaluated(self._condition, scope)):
            scope.thread.spend()
            signal = yield from _evaluated(self._body, scope)
            if signal == BREAK:
                break
            if signal == RETURN:
                return signal
        return None


class Return(Node):
    """End of a function, with or without a value."""

    def apply(self, scope: Scope, *values: Value) -> str:
        scope.result = values[0] if values else None
        return RETURN


class Kill(Node):
    """End of the thread with this handle."""

    def apply(self, scope: Scope, *values: Value) -> None:
        scope.thread.program.kill(values[0], scope.thread)


class Join(Node):
    """Wait for the end of the thread with this handle; an invalid handle is ignored."""

    def __init__(self, handle: Node) -> None:
        super().__init__(handle)
        self.waits = True

    def steps(self, scope: Scope) -> Steps:
        handle = yield from _evaluated(self.parts[0], scope)
        while scope.thread.program.other_thread(handle, scope.thread) is not None:
            yield


class Critical(Node):
    """``enter_critical`` or ``exit_critical``: no other thread runs in between."""

    def __init__(self, enter: bool) -> None:
        super().__init__()
        self._enter = enter

    def now(self, scope: Scope) -> None:
        scope.thread.program.critical = scope.thread if self._enter else None


def _evaluated(node: Node, scope: Scope) -> Steps:
    if node.waits:
        return (yield from node.steps(scope))
    return node.now(scope)
