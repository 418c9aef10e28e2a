"""numba's `njit` with machine code in files; a damaged file, as after a power loss, is replaced."""

import sys
from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache


class _Cache(FunctionCache):
    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception:  # a pickle that was cut short raises many kinds
            self.flush()  # type: ignore[no-untyped-call]
            sys.stderr.write(f"grasp: {self._py_func.__name__}: damaged file, compiled again\n")
            return None


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """As ``njit`` with ``cache=True``."""

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = njit(**options)(function)
        dispatcher._cache = _Cache(function)  # type: ignore[no-untyped-call]  # noqa: SLF001
        return dispatcher

    return decorate
