"""Programs given to a controller: their compilation."""

import threading

from drivers.ur.emulator.urscript.compile import compile_program
from drivers.ur.emulator.urscript.parse import ScriptError
from drivers.ur.emulator.urscript.run import Builtin, Compiled

_MOST_WAITING = 8


class Compilation:
    """Compiles the latest text in its own thread, so that control cycles continue. One text at a
    time: a replaced compilation ends before the next begins."""

    def __init__(self, builtins: dict[str, Builtin]) -> None:
        self._builtins = builtins
        self._text: str | None = None
        self._thread: threading.Thread | None = None
        self._made: tuple[str, Compiled | BaseException] | None = None

    def begin(self, text: str) -> None:
        """In place of another; nothing is done before the next ``take``."""
        self._text = text

    def take(self, wait: bool) -> Compiled | ScriptError | None:
        """What has become of the text, once that is known, which can be waited for."""
        if self._text is None:
            return None
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, args=(self._text,), daemon=True)
            self._thread.start()
        if wait:
            self._thread.join()
        if self._thread.is_alive() or self._made is None:
            return None
        text, made = self._made
        self._thread = self._made = None
        if text != self._text:
            return self.take(wait)
        self._text = None
        if isinstance(made, Compiled | ScriptError):
            return made
        raise made

    def _work(self, text: str) -> None:
        try:
            self._made = text, compile_program(text, self._builtins)
        except BaseException as error:  # `take` passes it to its caller
            self._made = text, error

    def cancel(self) -> None:
        self._text = None

    def close(self) -> None:
        self.cancel()
        if self._thread is not None:
            self._thread.join()
