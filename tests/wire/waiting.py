"""Waiting for an event of another process or thread."""

import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 100.0  # timeout of any event, also on a busy machine


def until(condition: Callable[[], Any], what: str = "") -> Any:
    """Wait until the condition is true; fails after PATIENCE_S."""
    deadline = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < deadline, f"timeout: {what}"
        time.sleep(0.005)
    return found
