"""Programs given to a controller: their compilation, and those that run beside the main one."""

import threading
from collections import deque
from typing import Any

from drivers.fairness import Budget
from drivers.ur.emulator.urscript.builtins import SECONDARY
from drivers.ur.emulator.urscript.compile import compile_program
from drivers.ur.emulator.urscript.parse import ScriptError
from drivers.ur.emulator.urscript.run import Builtin, Compiled, Program

_MOST_WAITING = 8


class Compilation:
    """Of the text given last, in a thread of its own, so that cycles go on meanwhile. One text at a
    time: what was replaced is left to end before the next begins."""

    def __init__(self, builtins: dict[str, Builtin]) -> None:
        self._builtins = builtins
        self._text: str | None = None
        self._thread: threading.Thread | None = None
        self._made: tuple[str, Compiled | BaseException] | None = None

    def begin(self, text: str) -> None:
        """In place of another; nothing is done before the next ``take``."""
        self._text = text

    def take(self, wait: bool) -> Compiled | ScriptError | None:
        """What has become of the text, once that is known, which can be waited for."""
        if self._text is None:
            return None
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, args=(self._text,), daemon=True)
            self._thread.start()
        if wait:
            self._thread.join()
        if self._thread.is_alive() or self._made is None:
            return None
        text, made = self._made
        self._thread = self._made = None
        if text != self._text:
            return self.take(wait)
        self._text = None
        if isinstance(made, Compiled | ScriptError):
            return made
        raise made

    def _work(self, text: str) -> None:
        try:
            self._made = text, compile_program(text, self._builtins)
        except BaseException as error:  # belongs to whoever takes the result
            self._made = text, error

    def cancel(self) -> None:
        self._text = None

    def close(self) -> None:
        self.cancel()
        if self._thread is not None:
            self._thread.join()


class Secondary:
    """Secondary programs, one after the other: they take no time, move nothing and leave the main
    program alone."""

    def __init__(self, robot: Any) -> None:
        self._robot = robot
        self._waiting: deque[str] = deque()
        self._compilation = Compilation(SECONDARY)
        self._compiles = False
        self._program: Program | None = None

    def load(self, text: str) -> None:
        if len(self._waiting) < _MOST_WAITING:
            self._waiting.append(text)
        else:
            self._robot.log(f"secondary program refused: {_MOST_WAITING} are waiting")

    def step(self, budget: Budget, wait: bool) -> None:
        """What there is time for."""
        if self._program is None and not self._compiles and self._waiting:
            self._compilation.begin(self._waiting.popleft())
            self._compiles = True
        try:
            if made := self._compilation.take(wait):
                self._compiles = False
                if isinstance(made, ScriptError):
                    raise made
                self._program = Program(made, self._robot, most_threads=1)
            if self._program is not None and not self._program.step(budget.spent):
                self._end()
        except ScriptError as error:
            self._robot.script_error(error)
            self._end()

    def _end(self) -> None:
        if self._program is not None:
            self._program.close()
        self._program = None

    def clear(self) -> None:
        self._end()
        self._waiting.clear()
        self._compilation.cancel()
        self._compiles = False

    def close(self) -> None:
        self.clear()
        self._compilation.close()
