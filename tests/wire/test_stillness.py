"""The judge of stalls sees one, and forgets it."""

import os
import signal
import time

from tests.wire.stillness import LIMIT_S, StallMeter


def test_a_stall_is_seen_once_it_is_over_and_not_later() -> None:
    meter = StallMeter()
    try:
        start_s = time.monotonic()
        os.kill(meter._process.pid, signal.SIGSTOP)
        time.sleep(4 * LIMIT_S)
        os.kill(meter._process.pid, signal.SIGCONT)
        deadline_s = start_s + 20.0
        while not meter.worst_since_s(start_s) and time.monotonic() < deadline_s:
            time.sleep(0.01)
        assert meter.worst_since_s(start_s) >= 3 * LIMIT_S
        assert meter.worst_since_s(time.monotonic() + 1.0) == 0.0
    finally:
        meter.close()
