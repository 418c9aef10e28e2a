"""Runs a program in a pseudo terminal, and types into it."""

import os
import pty
import re
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Self

COLOURS = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\r")
PATIENCE_S = 60.0
# a session leader that opens a terminal controls it: Ctrl-C and hang-ups reach the program
TAKE_TERMINAL = (
    "import os, sys; os.close(os.open(os.ttyname(0), os.O_RDWR)); "
    "os.execv(sys.argv[1], sys.argv[1:])"
)


class Terminal:
    """A program in a terminal; ``type`` sends text, ``wait_for`` reads until a pattern is shown."""

    def __init__(self, command: Sequence[str], environment: dict[str, str], folder: str) -> None:
        self._own, its = pty.openpty()
        self._process = subprocess.Popen(
            [sys.executable, "-c", TAKE_TERMINAL, *command], cwd=folder, start_new_session=True,
            env={**environment, "TERM": "dumb", "COLUMNS": "200"}, stdin=its, stdout=its,
            stderr=its,
        )  # fmt: skip
        os.close(its)
        self.shown = ""
        self._read_to = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._own)

    def type(self, text: str) -> None:
        """Type text; "\\x03" is Ctrl-C."""
        os.write(self._own, text.encode())

    def wait_for(self, pattern: str, patience_s: float = PATIENCE_S) -> re.Match[str]:
        """The first match in the output since the last call. Raises AssertionError, with all
        output, if there is none in time."""
        end_s = time.monotonic() + patience_s
        while (found := re.search(pattern, self.shown[self._read_to :])) is None:
            ended = not self._read(end_s)
            assert not ended, f"{pattern!r} was not shown:\n{self.shown}"
        self._read_to += found.end()
        return found

    def _read(self, end_s: float) -> bool:
        """Read more output; False at its end, or on a time-out."""
        if not select.select([self._own], [], [], max(0.0, end_s - time.monotonic()))[0]:
            return False
        some = b""
        with suppress(OSError):  # the other end is closed
            some = os.read(self._own, 65536)
        self.shown += COLOURS.sub("", some.decode(errors="replace"))
        return bool(some)
