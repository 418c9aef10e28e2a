"""Notices when the machine itself stands still: every process waits, and no device could answer."""

import os
import subprocess
import sys
import tempfile
import time

LIMIT_S = 0.05  # as for a cell (rigs.emulated_cell): shorter waits are part of an ordinary machine
METER = """
import os, sys, time
parent, limit_s = int(sys.argv[1]), float(sys.argv[2])
last = time.monotonic()
print(last, 0.0, flush=True)
while os.getppid() == parent:
    time.sleep(0.005)
    now = time.monotonic()
    if now - last > limit_s:
        print(now, now - last, flush=True)
    last = now
"""


class StallMeter:
    """A process that does nothing but look at the clock; `close` it."""

    def __init__(self) -> None:
        self._seen = tempfile.TemporaryFile()  # noqa: SIM115  (closed in `close`)
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", METER, str(os.getpid()), str(LIMIT_S)],
            stdout=self._seen, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        while not self._lines():  # it looks already
            time.sleep(0.005)

    def _lines(self) -> list[str]:
        """Whole lines; read without moving the place at which the process writes."""
        seen = os.pread(self._seen.fileno(), os.fstat(self._seen.fileno()).st_size, 0).decode()
        return seen.splitlines()[: seen.count("\n")]

    def worst_since_s(self, start_s: float) -> float:
        """Longest stall that ended after ``start_s`` (`time.monotonic`), 0.0 for none."""
        stalls = (map(float, line.split()) for line in self._lines())
        return max((length for end, length in stalls if end >= start_s), default=0.0)

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._seen.close()
