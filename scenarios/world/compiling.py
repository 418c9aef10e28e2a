"""When the world is compiled: the first time on a machine, and after each change of its code."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from numba.core import event


class _First(event.Listener):
    """Tells of the first function that is compiled; what lies in numba's cache is not."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell: Callable[[], None] | None = tell

    def on_start(self, event: Any) -> None:
        if self._tell is not None:
            tell, self._tell = self._tell, None
            tell()

    def on_end(self, event: Any) -> None:
        pass


def told_when_compiling(tell: Callable[[], None]) -> AbstractContextManager[None]:
    """Within, ``tell`` is called once, as soon as anything must be compiled; else never."""
    return event.install_listener("numba:compile", _First(tell))
