"""The person at a terminal who strikes objects and reads tape marks; asking never blocks."""

import contextlib
import os
import select
import sys

from drivers.errors import UsageError

LINE = 4096  # bytes; the kernel cuts what is typed there too
READS = 4  # at once


class TerminalOperator:
    """Asks on standard error and listens on standard input, neither of which ever blocks."""

    def __init__(self) -> None:
        self.typed = b""  # and not yet polled
        self._gone = False

    def expect(self) -> None:
        """Before anything moves: raises UsageError where the input has ended, as of a script, so
        that nobody would answer."""
        if not self._read():
            told = "nobody is there to be asked: standard input has ended"
            raise UsageError(told, "start it at a terminal: nothing was moved")

    def say(self, text: str) -> None:
        """Ask; what was typed before the question is no answer to it."""
        self._read()
        self.typed = b""
        self._print(text)

    def poll(self) -> str | None:
        """A line, once it is there. A terminal that closed counts as Ctrl-C, once: nobody is
        left."""
        if self._gone:
            return None
        ended = b"\n" not in self.typed and not self._read()
        if ended and b"\n" not in self.typed:
            self._gone = True
            self._print("standard input has ended")
            raise KeyboardInterrupt
        line, newline, rest = self.typed.partition(b"\n")
        if not newline:
            return None
        self.typed = rest
        return line.decode(errors="replace")

    def _print(self, text: str) -> None:
        with contextlib.suppress(OSError):  # the terminal was closed
            print(f">>> {text}", file=sys.stderr, flush=True)

    def _read(self) -> bool:
        """Take what is there; False at the end of the input. Never much at once: a program that
        types without end must not keep whoever looks after the arm."""
        for _ in range(READS):
            try:
                if not select.select([sys.stdin], [], [], 0)[0]:
                    break
                some = os.read(sys.stdin.fileno(), LINE)
            except (OSError, TypeError, ValueError):  # the terminal was closed, or there is none
                return False
            if not some:
                return False
            self.typed = (self.typed + some)[-LINE:]
        return True
