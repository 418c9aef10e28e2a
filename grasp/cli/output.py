"""Standard input, output and error: all three there; and under --json JSON and nothing else on
standard output, whatever a library prints."""

import contextlib
import errno
import io
import json
import math
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any, TextIO, cast

from drivers.errors import UnreadError

GONE = (errno.EPIPE, errno.EIO)  # a pipe without a reader, a terminal that was closed


def open_standard_streams() -> None:
    """Those that whoever started us had closed lead nowhere: else the next file opened, a recording
    say, would get such a number, and whatever is printed."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    for name, number, mode in (("stdin", 0, "r"), ("stdout", 1, "w"), ("stderr", 2, "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, mode, closefd=False))


class _Known:
    """A standard stream of which it is known that what is raised is its own: output raises
    UnreadError then, and what is said beside it is said to nobody."""

    def __init__(self, stream: TextIO, aside: bool) -> None:
        self._stream, self._aside = stream, aside

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        return self._done(lambda: self._stream.write(text)) or 0

    def flush(self) -> None:
        self._done(self._stream.flush)

    def _done(self, action: Callable[[], int | None]) -> int | None:
        try:
            return action()
        except OSError as error:
            if error.errno not in GONE:
                raise
            if not self._aside:
                raise UnreadError(*error.args) from None
            return None


@contextlib.contextmanager
def known_streams() -> Iterator[None]:
    """Within, standard output and error raise nothing that could be taken for a device's."""
    out, err = cast(TextIO, _Known(sys.stdout, False)), cast(TextIO, _Known(sys.stderr, True))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield


def json_line(value: Any) -> str:
    """An answer in one line. A number that is none (a miss is a delay without end) is null, since
    JSON knows no infinity."""
    return json.dumps(_finite(value), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    return [_finite(each) for each in value] if isinstance(value, list | tuple) else value


class _OnlyJson(io.TextIOBase):
    """Lines that hold a JSON object or array go on, all others to standard error."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._line = ""

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._out.fileno()

    def write(self, text: str) -> int:
        *lines, self._line = (self._line + text).split("\n")
        for line in lines:
            print(line, file=self._out if _is_answer(line) else sys.stderr)
        return len(text)

    def flush(self) -> None:
        self._out.flush()


def _is_answer(line: str) -> bool:
    if not line.startswith(("{", "[")):
        return False
    try:
        json.loads(line)
    except (ValueError, RecursionError):
        return False
    return True


@contextlib.contextmanager
def only_json() -> Iterator[None]:
    """Within, what is no JSON goes to standard error: Python's prints, and those of libraries and
    processes that write to the descriptor itself."""
    out = sys.stdout
    with contextlib.ExitStack() as stack:
        if _is_descriptor_1(out):
            out.flush()
            kept = os.dup(1)
            os.dup2(2, 1)
            stack.callback(_put_back, kept)
            kept_out = stack.enter_context(open(kept, "w", encoding=out.encoding, closefd=False))
            out = cast(TextIO, _Known(kept_out, False))
        stack.enter_context(contextlib.redirect_stdout(_OnlyJson(out)))
        yield


def _put_back(kept: int) -> None:
    os.dup2(kept, 1)
    os.close(kept)


def _is_descriptor_1(stream: TextIO) -> bool:
    try:
        return stream.fileno() == 1
    except (OSError, ValueError):
        return False
