"""Prints results and progress: lines for a person, or under --json only JSON on standard output,
also if a library prints."""

import contextlib
import errno
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TextIO, cast

from drivers.errors import OutputClosedError
from grasp.cli.options import Json

if TYPE_CHECKING:
    import msgspec

CLOSED = (errno.EPIPE, errno.EIO)  # a pipe without a reader, a closed terminal
JsonObject = dict[str, Any]
PROGRESS_LINES = 10  # without a terminal: a line for each tenth
_results: TextIO | None = None  # standard output while --json redirects all else


def json_line(value: object) -> str:
    """Encode a value as JSON in one line; infinite and undefined numbers become null."""
    import msgspec

    return msgspec.json.encode(value, enc_hook=_builtin).decode()


def _builtin(value: Any) -> object:
    """Convert a path or a NumPy number, which msgspec does not support."""
    return str(value) if isinstance(value, os.PathLike) else value.item()


def standard_output() -> TextIO:
    """The stream for results."""
    return _results or sys.stdout


def print_json(value: object) -> None:
    """Print a result in one line."""
    print(json_line(value), file=standard_output(), flush=True)


def show(args: Json, value: object, text: str | Callable[[], str], code: int = 0) -> int:
    """Print a result: ``value`` under --json, else ``text``; returns ``code``."""
    if args.json:
        print_json(value)
    elif text := text if isinstance(text, str) else text():
        print(text)
    return code


def listing(result: "msgspec.Struct | JsonObject") -> str:
    """Fields of a result, one line each, with the 95 % interval if ``intervals`` has one."""
    import msgspec

    fields = msgspec.structs.asdict(result) if isinstance(result, msgspec.Struct) else dict(result)
    intervals = fields.pop("intervals", {})
    lines = []
    for name, value in fields.items():
        if value is not None:
            low_high = f" [{_text(intervals[name])}]" if name in intervals else ""
            lines.append(f"  {name:<29} {_text(msgspec.to_builtins(value))}{low_high}")
    return "\n".join(lines)


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(each)}" for name, each in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_text(each) for each in value)
    return str(value)


def print_status(text: str) -> None:
    """Print a line on standard error about the current work."""
    print(text, file=sys.stderr, flush=True)


@contextlib.contextmanager
def progress(
    doing: str, hidden: bool = False, every_s: float = math.inf
) -> Iterator[Callable[..., None]]:
    """Show a progress bar with the time left on standard error; without a terminal a line for each
    tenth and after ``every_s``. Yields a function of done, total and an optional text."""
    from rich.console import Console
    from rich.progress import Progress

    if not hidden and not sys.stderr.isatty():
        yield _progress_lines(doing, every_s)
        return
    with Progress(console=Console(stderr=True), transient=True, disable=hidden) as bar:
        task = bar.add_task(doing, total=None)
        yield lambda done, total, text=doing: bar.update(
            task, completed=done, total=total, description=text
        )


def _progress_lines(doing: str, every_s: float) -> Callable[..., None]:
    start_s = shown_s = time.monotonic()
    shown = 0

    def show(done: int, total: int, text: str = doing) -> None:
        nonlocal shown, shown_s
        now_s, tenth = time.monotonic(), PROGRESS_LINES * done // max(1, total)
        if done < 1 or (tenth <= shown and now_s - shown_s < every_s):
            return
        shown, shown_s = tenth, now_s
        left_s = (now_s - start_s) * (total - done) / done
        print_status(f"{text}: {done} of {total}, {left_s:.0f} s left")

    return show


def open_standard_streams() -> None:
    """Open closed standard streams on /dev/null. Otherwise a recording could get such a descriptor
    and receive printed text."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    for name, number, mode in (("stdin", 0, "r"), ("stdout", 1, "w"), ("stderr", 2, "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, mode, closefd=False))


class _Stream:
    """Stream whose missing reader is not mistaken for an error of a device: standard output then
    raises OutputClosedError, and standard error raises nothing."""

    def __init__(self, stream: TextIO, silent: bool) -> None:
        self._stream, self._silent = stream, silent

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        return self._attempt(lambda: self._stream.write(text)) or 0

    def flush(self) -> None:
        self._attempt(self._stream.flush)

    def _attempt(self, action: Callable[[], int | None]) -> int | None:
        try:
            return action()
        except OSError as error:
            if error.errno not in CLOSED:
                raise
            if not self._silent:
                raise OutputClosedError(*error.args) from None
            return None


@contextlib.contextmanager
def checked_streams() -> Iterator[None]:
    """Within, standard output and error are ``_Stream``."""
    out, err = cast(TextIO, _Stream(sys.stdout, False)), cast(TextIO, _Stream(sys.stderr, True))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield


@contextlib.contextmanager
def only_json() -> Iterator[None]:
    """Within, only ``print_json`` writes to standard output. All else goes to standard error, also
    what libraries and processes write to the descriptor."""
    global _results  # noqa: PLW0603  (there is one standard output)
    out = sys.stdout
    with contextlib.ExitStack() as stack:
        if _is_descriptor_1(out):
            out.flush()
            kept = os.dup(1)
            os.dup2(2, 1)
            stack.callback(os.close, kept)
            stack.callback(os.dup2, kept, 1)
            file = stack.enter_context(open(kept, "w", encoding=out.encoding, closefd=False))
            out = cast(TextIO, _Stream(file, False))
        _results = out
        try:
            with contextlib.redirect_stdout(sys.stderr):
                yield
        finally:
            _results = None


def _is_descriptor_1(stream: TextIO) -> bool:
    try:
        return stream.fileno() == 1
    except (OSError, ValueError):
        return False
