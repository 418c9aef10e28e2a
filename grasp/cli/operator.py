"""The person at a terminal who strikes objects and reads tape marks; asking never blocks."""

import os
import select
import sys


class TerminalOperator:
    """Asks on standard error and listens on standard input, neither of which ever blocks."""

    def __init__(self) -> None:
        self._typed = b""

    def say(self, text: str) -> None:
        """Ask; what was typed before the question is no answer to it."""
        self._read()
        self._typed = b""
        print(f">>> {text}", file=sys.stderr, flush=True)

    def poll(self) -> str | None:
        """A line, once it is there. A terminal that closed counts as Ctrl-C: nobody is left."""
        ended = b"\n" not in self._typed and not self._read()
        if ended and b"\n" not in self._typed:
            print(">>> standard input has ended", file=sys.stderr, flush=True)
            raise KeyboardInterrupt
        line, newline, rest = self._typed.partition(b"\n")
        if not newline:
            return None
        self._typed = rest
        return line.decode(errors="replace")

    def _read(self) -> bool:
        """Take what is there; False at the end of the input."""
        while select.select([sys.stdin], [], [], 0)[0]:
            some = os.read(sys.stdin.fileno(), 4096)
            if not some:
                return False
            self._typed += some
        return True
