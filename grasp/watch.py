"""Who looks on: a process of its own that draws what it is handed, behind a queue that may spill.

A picture drawn in this process, though in another thread, keeps the interpreter from the thread
that talks to the gripper. So whoever draws does it elsewhere; what an onlooker cannot take in time
is lost and counted, and a run never waits for one.
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

NOTE_S = 1.0  # that a line between two runs may wait for its reader
END_S = 5.0


class Onlooker:
    """Runs ``module`` and writes one JSON line a message to its standard input, never waiting.

    A line is shorter than a pipe writes at once (4096 bytes), so it arrives whole or not at all.
    ``screen``: descriptor that it draws on; by default the standard output of this process.
    """

    def __init__(
        self, module: ModuleType, screen: int | None = None, inherited: tuple[int, ...] = ()
    ) -> None:
        """``inherited``: descriptors that it finds under the same numbers."""
        assert module.__spec__ is not None  # noqa: S101  (it was imported)
        home = str(Path(__file__).parents[1])
        # -P: a folder called `grasp` where the user happens to stand must not shadow ours
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", module.__spec__.name],
            stdin=subprocess.PIPE,
            stdout=screen,
            pass_fds=inherited,
            env={**os.environ, "PYTHONPATH": home},
        )
        assert self._child.stdin is not None  # noqa: S101
        self._pipe = self._child.stdin.fileno()
        os.set_blocking(self._pipe, False)
        self._encode = msgspec.json.Encoder().encode
        self._gone = False
        self.lost = 0  # messages that were not taken

    @property
    def pid(self) -> int:
        return self._child.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def show(self, message: msgspec.Struct) -> bool:
        """Hand it over, or count it as lost; tells whether it was taken."""
        taken = False
        if not self._gone:
            try:
                os.write(self._pipe, self._encode(message) + b"\n")
                taken = True
            except BlockingIOError:
                pass
            except OSError:  # the onlooker has ended: a run goes on unseen
                self._gone = True
        self.lost += not taken
        return taken

    def tell(self, message: msgspec.Struct) -> None:
        """As ``show``, but between two runs: waits a moment for a reader that is behind."""
        if not self._gone:
            select.select([], [self._pipe], [], NOTE_S)
        self.show(message)

    def close(self) -> None:
        """Let it draw what it has, and end it if that takes long; safe to call twice."""
        if self._child.stdin is None or self._child.stdin.closed:
            return
        with contextlib.suppress(OSError):
            self._child.stdin.close()
        try:
            self._child.wait(END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()


def leave_signals_to_the_run() -> None:
    """For an onlooker: it ends when its input does."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
