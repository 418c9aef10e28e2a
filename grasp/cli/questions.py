"""Questions to the person at the terminal."""

import os
import select
import sys
from contextlib import suppress

from drivers.errors import UsageError
from scenarios.trial.operator_prompts import WITHDRAWN

TYPED_BYTES = 4096  # most input kept; the kernel's limit of a line too
READS = 4  # most reads in a row


def confirm(question: str, word: str, given: bool) -> None:
    """Ask a person to type a word, unless the option was given; otherwise raises UsageError."""
    if given:
        return
    if sys.stdin is None or not sys.stdin.isatty():
        raise UsageError(f"no terminal for the question: {question}", f"if yes, add --{word}")
    print(f"{question} Type {word}: ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() != word:
        raise UsageError(f"{word!r} was not typed: nothing was moved", "start again when ready")


class TerminalOperator:
    """Asks on standard error and reads answers on standard input; neither ever blocks."""

    def __init__(self) -> None:
        self.typed = b""  # not yet polled
        self.asking = False  # a question is open
        self._closed = False

    def expect(self) -> None:
        """Check before any motion: raises UsageError if the input has ended, as in a script."""
        if not self._read():
            problem = "no terminal for questions: standard input has ended"
            raise UsageError(problem, "start it at a terminal: nothing was moved")

    def say(self, text: str) -> None:
        """Ask; input before the question is discarded."""
        self._read()
        self.typed = b""
        self.asking = text != WITHDRAWN
        self._print(text)

    def poll(self) -> str | None:
        """Return a line once it is complete. A closed terminal counts as Ctrl-C, once."""
        if self._closed:
            return None
        ended = b"\n" not in self.typed and not self._read()
        if ended and b"\n" not in self.typed:
            self._closed = True
            self._print("standard input has ended")
            raise KeyboardInterrupt
        line, newline, rest = self.typed.partition(b"\n")
        if not newline:
            return None
        self.typed, self.asking = rest, False
        return line.decode(errors="replace")

    def _print(self, text: str) -> None:
        with suppress(OSError):  # the terminal was closed
            print(f">>> {text}", file=sys.stderr, flush=True)

    def _read(self) -> bool:
        """Read available input; False at its end. Bounded, so that endless input does not block."""
        for _ in range(READS):
            try:
                if not select.select([sys.stdin], [], [], 0)[0]:
                    break
                some = os.read(sys.stdin.fileno(), TYPED_BYTES)
            except (OSError, TypeError, ValueError):  # a closed terminal, or none
                return False
            if not some:
                return False
            self.typed = (self.typed + some)[-TYPED_BYTES:]
        return True
