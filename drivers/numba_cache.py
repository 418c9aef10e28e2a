"""numba's `njit` for functions whose machine code is kept in files."""

import sys
from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache


class _Cache(FunctionCache):
    """A cache that compiles a function again where its file was damaged, as by a power loss."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception:  # a pickle that was cut short raises many kinds
            self.flush()  # type: ignore[no-untyped-call]
            name = f"{self._py_func.__module__}.{self._py_func.__name__}"
            sys.stderr.write(f"grasp: the compiled {name} was damaged: compiling it again\n")
            return None


def compiled(*signatures: str, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """As ``njit`` with ``cache=True``: compiled for the signatures now, or without one when it is
    called."""

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = njit(**options)(function)
        cache = _Cache(function)  # type: ignore[no-untyped-call]
        dispatcher._cache = cache  # noqa: SLF001  (njit makes no other)
        for signature in signatures:
            dispatcher.compile(signature)
        if signatures:
            dispatcher.disable_compile()
        return dispatcher

    return decorate
