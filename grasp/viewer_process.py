"""ViewerProcess: draws a run in a process of its own, fed through a pipe that never blocks the run.

Drawing in another thread of this process would keep the interpreter from the thread that talks to
the gripper. Messages that the viewer cannot take in time are lost and counted.
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

TELL_S = 1.0  # that a message between two runs may wait for its reader
END_S = 5.0


class ViewerProcess:
    """Runs ``module`` and writes one JSON line a message to its standard input, never waiting.

    A line is shorter than a pipe writes at once (4096 bytes), so it arrives whole or not at all.
    ``screen``: descriptor that it draws on; by default the standard output of this process.
    ``inherited``: descriptors that it finds under the same numbers.
    """

    def __init__(
        self, module: ModuleType, screen: int | None = None, inherited: tuple[int, ...] = ()
    ) -> None:
        assert module.__spec__ is not None  # noqa: S101  (it was imported)
        home = str(Path(__file__).parents[1])
        # -P: a folder called `grasp` in the working directory must not shadow ours
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
        self._gone = False
        self.pid = self._child.pid
        self.lost = 0  # messages that were not taken

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def show(self, message: msgspec.Struct) -> bool:
        """Send it, or count it as lost; returns whether it was taken."""
        taken = False
        if not self._gone:
            try:
                os.write(self._stdin.fileno(), msgspec.json.encode(message) + b"\n")
                taken = True
            except BlockingIOError:
                pass
            except OSError:  # the viewer has ended: a run goes on without it
                self._gone = True
        self.lost += not taken
        return taken

    def tell(self, message: msgspec.Struct) -> None:
        """As ``show``, but between two runs: waits a moment for a reader that is behind."""
        if not self._gone:
            select.select([], [self._stdin], [], TELL_S)
        self.show(message)

    def close(self) -> None:
        """Let it draw what it has, and end it if that takes long; safe to call twice."""
        self._gone = True
        with contextlib.suppress(OSError):
            self._stdin.close()
        try:
            self._child.wait(END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()


def ignore_signals() -> None:
    """For a viewer: it ends when its input does."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
