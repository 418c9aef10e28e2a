"""Reports what numba compiles. It keeps the compiled functions: this happens once on a machine."""

import gc
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from numba.core import event
from numba.core.dispatcher import Dispatcher

from scenarios.rigs import simulated  # noqa: F401  (with all compiled functions of the world)

COMPILING = "compiling the simulation, about a minute, only once"
PACKAGES = ("drivers", "scenarios")
Report = Callable[[int, int], object]  # functions that are ready, and all


class _FirstCompilation(event.Listener):
    """Calls a function at the first compilation; functions in numba's cache are not compiled."""

    def __init__(self, callback: Callable[[], None]) -> None:
        self._callback: Callable[[], None] | None = callback

    def on_start(self, _: Any) -> None:
        if self._callback is not None:
            callback, self._callback = self._callback, None
            callback()

    def on_end(self, _: Any) -> None:
        pass


def on_first_compilation(callback: Callable[[], None]) -> AbstractContextManager[None]:
    """Context in which ``callback`` is called once, when the first function must be compiled."""
    return event.install_listener("numba:compile", _FirstCompilation(callback))


class _Count(event.Listener):
    """Reports how many functions of the simulation are ready."""

    def __init__(self, report: Report) -> None:
        found = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
        # functions that are always inlined are compiled as a part of others
        names = {_name(each) for each in found if each.targetoptions.get("inline") != "always"}
        self._all = {name for name in names if name.startswith(PACKAGES)}
        self._ready: set[str] = set()
        self._report = report

    def on_start(self, _: Any) -> None:
        pass

    def on_end(self, event: Any) -> None:
        if (name := _name(event.data["dispatcher"])) in self._all:
            self._ready.add(name)
            self._report(len(self._ready), len(self._all))


def count_compilation(report: Report) -> AbstractContextManager[None]:
    """Context in which ``report`` is called after every function that had to be compiled."""
    return event.install_listener("numba:compile", _Count(report))


def _name(dispatcher: Any) -> str:
    return f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}"
