"""Commands of `grasp` in processes of their own, for the ROS 2 node."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

import msgspec

from grasp.cli.output import JsonObject
from grasp.control.fault import INTERNAL, INTERRUPTED
from scenarios.report.step_feed import Begin, Step

COMMAND = f"{__package__}.entry"
LINE = msgspec.json.Decoder(Begin | Step)


class Child:
    """A command with `--json`, in a process of its own, without a terminal.

    ``feeds``: the command has the option `--feed`, and ``lines`` yields what it writes.
    """

    def __init__(self, words: Sequence[str], feeds: bool = False) -> None:
        home, path = str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH")
        self._out = TemporaryFile()  # noqa: SIM115  (a pipe could fill up and stop the command)
        self._lines, inherited = None, -1
        self._stopped = False
        if feeds:
            reads, inherited = os.pipe()
            self._lines = os.fdopen(reads, "rb")
        try:
            # -P: a folder `grasp` in the working directory must not shadow this package. A new
            # session: Ctrl-C in the node's terminal reaches the command through the node alone.
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", COMMAND, *words,
                 *(["--feed", str(inherited)] if feeds else [])],
                stdin=subprocess.DEVNULL, stdout=self._out, start_new_session=True,
                pass_fds=(inherited,) if feeds else (),
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (home, path)))},
            )  # fmt: skip
        finally:
            if feeds:
                os.close(inherited)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def stop(self) -> None:
        """Stop the command as one Ctrl-C does, however often this is called. SIGTERM, because what
        a script starts in the background ignores SIGINT."""
        if not self._stopped:
            self._stopped = True
            self._process.send_signal(signal.SIGTERM)

    def lines(self) -> Iterator[Begin | Step]:
        """What the command feeds, until it ends; a line that cannot be read is left out."""
        for line in self._lines or ():
            with suppress(msgspec.MsgspecError):
                yield LINE.decode(line)

    def result(self) -> JsonObject:
        """Wait for the end, and return what the command printed; an object with `error` if that is
        no JSON."""
        code = self._process.wait()
        if self._lines is not None:
            self._lines.close()
        with self._out:
            self._out.seek(0)
            try:
                return msgspec.json.decode(self._out.read(), type=JsonObject)
            except msgspec.DecodeError:
                message = f"the process ended with exit code {code}"
                kind = INTERRUPTED if self._stopped else INTERNAL
                return {"error": {"kind": kind, "message": message, "remedy": ""}}
