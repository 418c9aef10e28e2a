"""Running URScript programs: threads that run in turn each cycle."""

from collections.abc import Callable, Generator
from typing import Any

from drivers.ur.emulator.urscript_parser import Script
from drivers.ur.emulator.urscript_values import (
    OPERATORS,
    ScriptError,
    Value,
    copied,
    element,
    make_list,
    make_pose,
    negative,
    set_element,
)

Steps = Generator[None, None, Value]
Function = Callable[["Thread"], Steps]  # function of the program; a step a cycle

MAX_STEPS = 2_000  # limit for all threads in one cycle: statements, conditions, calls of functions
MAX_THREADS = 32
_RUNTIME: dict[str, Any] = {  # what translated code calls
    **OPERATORS,
    **{f.__name__: f for f in (copied, element, make_list, make_pose, negative, set_element)},
}


class Thread:
    """Thread of a running program."""

    def __init__(self, program: "Program", handle: int, function: Function) -> None:
        self.program = program
        self.robot = program.robot  # emulated controller, for the built-in functions
        self.handle = handle
        self.steps = function(self)

    def spend(self, steps: int = 1) -> bool:
        """Count steps; True, so that a condition counts itself."""
        self.program.left -= steps
        if self.program.left < 0:
            raise ScriptError(f"infinite loop detected: {MAX_STEPS} steps in a cycle, no sync()")
        return True


class Program:
    """A running program: global variables and threads, the first of which is the main one."""

    def __init__(self, script: Script, robot: Any) -> None:
        self.name = script.name
        self.robot = robot
        self.critical: Thread | None = None  # in a critical section: no other one runs
        self.left = 0  # steps of this cycle
        self._handles = 0
        self._threads: list[Thread] = []
        names: dict[str, Any] = {"__builtins__": {}, **_RUNTIME}
        names |= {f"b_{name}": function for name, function in script.builtins.items()}
        exec(script.code, names)  # defines the functions; nothing but what the parser translates
        self.start(names[f"f_{script.name}"])

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

    def join(self, handle: Value, by: Thread) -> Steps:
        """Wait for the end of a thread; an invalid handle is ignored."""
        while self.other_thread(handle, by) is not None:
            yield

    def step(self) -> bool:
        """Run one cycle: each thread in turn until it waits. False once the main thread has ended.
        Raises ScriptError."""
        main, self.left = self._threads[0], MAX_STEPS
        try:
            for thread in list(self._threads):
                blocked = self.critical is not None and self.critical is not thread
                # a thread that waits for the next cycle yields None
                if not blocked and thread in self._threads and next(thread.steps, "ended"):
                    self._end(thread)
        except RecursionError:
            raise ScriptError("nested too deep") from None
        except NameError as error:
            raise ScriptError(f"a variable has no value yet: {error}") from None
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
