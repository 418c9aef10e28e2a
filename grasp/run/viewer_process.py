"""ViewerProcess: displays a run in another process, fed through a pipe that never blocks the run.

A display thread in this process would delay the thread that communicates with the gripper. Messages
that the viewer cannot take in time are dropped and counted.
"""

import contextlib
import os
import select
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Self

import msgspec

WAIT_S = 1.0  # longest wait of a message between two runs for its reader
END_S = 5.0


class ViewerProcess:
    """Runs ``module`` and writes one JSON line a message to its standard input, never waiting.

    A line is shorter than 4096 bytes, which a pipe writes atomically: it arrives whole or not at
    all. ``screen``: descriptor for the output; by default the standard output of this process.
    ``inherited``: descriptors that the viewer inherits under the same numbers.
    """

    def __init__(
        self, module: ModuleType, screen: int | None = None, inherited: tuple[int, ...] = ()
    ) -> None:
        assert module.__spec__ is not None  # noqa: S101  (it was imported)
        home = str(Path(__file__).parents[1])
        # -P: a folder `grasp` in the working directory must not shadow this package
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", module.__spec__.name],
            stdin=subprocess.PIPE,
            stdout=screen,
            pass_fds=inherited,
            env={**os.environ, "PYTHONPATH": home},
        )
        assert self._child.stdin is not None  # noqa: S101
        self._stdin = self._child.stdin
        os.set_blocking(self._stdin.fileno(), False)
        self._ended = False
        self.pid = self._child.pid
        self.lost = 0  # number of dropped messages

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def show(self, message: msgspec.Struct) -> bool:
        """Send a message, or count it as lost; returns whether it was sent."""
        sent = False
        if not self._ended:
            try:
                os.write(self._stdin.fileno(), msgspec.json.encode(message) + b"\n")
                sent = True
            except BlockingIOError:
                pass
            except OSError:  # the viewer has ended: the run continues without it
                self._ended = True
        self.lost += not sent
        return sent

    def show_waiting(self, message: msgspec.Struct) -> None:
        """Send a message between two runs: wait a moment for a reader that is behind."""
        if not self._ended:
            select.select([], [self._stdin], [], WAIT_S)
        self.show(message)

    def close(self) -> None:
        """Let the viewer show what it has received, or kill it if that takes too long."""
        self._ended = True
        with contextlib.suppress(OSError):
            self._stdin.close()
        try:
            self._child.wait(END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()


def ignore_signals() -> None:
    """Ignore signals in a viewer process, which ends when its input does."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
