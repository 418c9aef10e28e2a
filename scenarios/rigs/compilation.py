"""Reports what numba compiles. It keeps the compiled functions: this happens once on a machine."""

import gc
import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from numba.core import event
from numba.core.dispatcher import Dispatcher

from scenarios.rigs import simulated  # noqa: F401  (with all compiled functions of the world)
from scenarios.world import COMPILING

EVERY_S = 2.0  # shortest time between two lines
PACKAGES = ("drivers", "scenarios")
Report = Callable[[int, int], object]  # functions that are ready, and all


class _Count(event.Listener):
    """Reports how many functions of the simulation are ready."""

    def __init__(self, report: Report) -> None:
        self._all: set[str] = set()
        self._ready: set[str] = set()
        self._report = report

    def on_start(self, _: Any) -> None:
        if self._all:
            return
        found = [each for each in gc.get_objects() if issubclass(type(each), Dispatcher)]
        # functions that are always inlined are compiled as a part of others
        names = {_name(each) for each in found if each.targetoptions.get("inline") != "always"}
        self._all = {name for name in names if name.startswith(PACKAGES)}

    def on_end(self, event: Any) -> None:
        if (name := _name(event.data["dispatcher"])) in self._all:
            self._ready.add(name)
            self._report(len(self._ready), len(self._all))


def count_compilation(report: Report) -> AbstractContextManager[None]:
    """Context in which ``report`` is called after every function that had to be compiled."""
    return event.install_listener("numba:compile", _Count(report))


def tell_of_compilation(say: Callable[[str], object]) -> AbstractContextManager[None]:
    """Context in which ``say`` gets a line of progress when a function had to be compiled, at most
    one every EVERY_S."""
    said_s = -math.inf

    def report(ready: int, of: int) -> None:
        nonlocal said_s
        if (now_s := time.monotonic()) - said_s >= EVERY_S:
            said_s = now_s
            say(f"{COMPILING}: {ready} of {of} functions")

    return count_compilation(report)


def _name(dispatcher: Any) -> str:
    return f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}"
