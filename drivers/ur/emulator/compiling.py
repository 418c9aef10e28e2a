"""Programs given to a controller: their compilation, and those that run beside the main one."""

import time
from collections import deque
from functools import partial
from typing import Any

from drivers.fairness import Allowance, Budget, Slowly
from drivers.ur.emulator.urscript.builtins import SECONDARY
from drivers.ur.emulator.urscript.compile import compile_program
from drivers.ur.emulator.urscript.parse import ScriptError
from drivers.ur.emulator.urscript.run import Builtin, Compiled, Program

_MOST_WAITING = 8
_VAIN = 4.0  # times what it took: work on a text that another replaced before it was done


def compiling_allowance() -> Allowance:
    """Of the processor's time, for the programs that one controller is sent: the script of a client
    takes a tenth of a second, the longest one that is taken some three, none waits for longer than
    two."""
    return Allowance(0.05, at_once_s=0.25, longest_s=2.0)


class Compilation:
    """Of the text given last, in slices of the cycles. It is not begun while ``allowance`` says to
    wait; one text after the other would else cost more than any of them."""

    def __init__(self, builtins: dict[str, Builtin], allowance: Allowance) -> None:
        self._builtins = builtins
        self._allowance = allowance
        self._text: str | None = None
        self._work: Slowly[Compiled] | None = None
        self._worked_s = 0.0

    @property
    def busy(self) -> bool:
        """There is more to do in this cycle."""
        if self._work is None and self._allowance.wait_s:
            return False
        return self._text is not None

    def begin(self, text: str) -> None:
        """In place of another; nothing is done before the next ``go_on``."""
        self.cancel()
        self._text = text

    def go_on(self, budget: Budget) -> tuple[str, Compiled | ScriptError] | None:
        """The text and what has become of it, once that is known."""
        if self._text is None or not self.busy:
            return None
        began_s = time.thread_time()
        if self._work is None:
            self._work = Slowly(partial(compile_program, self._text, self._builtins))
            self._worked_s = 0.0
        done = self._work.go_on(budget.left_s)
        budget.use(self._work.worked_s)
        used_s = self._work.worked_s + time.thread_time() - began_s
        self._worked_s += used_s
        self._allowance.use(used_s)
        if not done:
            return None
        (text, work), self._text, self._work = (self._text, self._work), None, None
        try:
            return text, work.result()
        except ScriptError as error:
            return text, error

    def cancel(self) -> None:
        if self._work is not None:
            self._work.cancel()
            self._allowance.use((_VAIN - 1.0) * self._worked_s)
        self._text = self._work = None


class Secondary:
    """Secondary programs, one after the other: they take no time, move nothing and leave the main
    program alone."""

    def __init__(self, robot: Any, allowance: Allowance) -> None:
        self._robot = robot
        self._waiting: deque[str] = deque()
        self._compilation = Compilation(SECONDARY, allowance)
        self._compiles = False
        self._program: Program | None = None

    def load(self, text: str) -> None:
        if len(self._waiting) < _MOST_WAITING:
            self._waiting.append(text)
        else:
            self._robot.log(f"secondary program refused: {_MOST_WAITING} are waiting")

    @property
    def busy(self) -> bool:
        """There is more to do in this cycle."""
        begins = bool(self._waiting) and not self._compiles
        return begins or self._compilation.busy or self._program is not None

    def step(self, budget: Budget) -> None:
        """What there is time for."""
        if self._program is None and not self._compiles and self._waiting:
            self._compilation.begin(self._waiting.popleft())
            self._compiles = True
        try:
            if done := self._compilation.go_on(budget):
                self._compiles = False
                if isinstance(done[1], ScriptError):
                    raise done[1]
                self._program = Program(done[1], self._robot, most_threads=1)
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
