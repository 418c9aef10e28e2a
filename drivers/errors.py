"""Error classes of the whole project, each named for the remedy.

Malformed data from a device are never raised: drivers count them in their statistics.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

MAX_SHOWN_CHARS = 400  # of foreign text in a message


def one_line(text: object, most: int = MAX_SHOWN_CHARS) -> str:
    """Foreign text for one line of a terminal, truncated, with unprintable characters escaped."""
    shown = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(text)[: most + 1])
    return shown if len(shown) <= most else f"{shown[:most]}..."


def exception_text(error: BaseException) -> str:
    """Text of an exception, encodable in UTF-8, even where its ``__str__`` raises."""
    with suppress(BaseException):  # a plug-in's __str__ may even exit
        return str(error).encode(errors="backslashreplace").decode()
    return "its text raises too"


def describe_exception(error: BaseException) -> str:
    """Type and text of an exception, in one line."""
    return one_line(f"{type(error).__name__}: {exception_text(error)}")


@contextmanager
def counted(hidden: Counter[str], kind: type[BaseException] = Exception) -> Iterator[None]:
    """Ignore an exception of the block, as a run must go on, and count it in ``hidden``."""
    try:
        yield
    except kind as error:
        hidden[describe_exception(error)] += 1


@contextmanager
def on_failure(undo: Callable[[], object]) -> Iterator[None]:
    """Call ``undo`` when the block raises, also on Ctrl-C, and raise the exception again."""
    try:
        yield
    except BaseException:
        undo()
        raise


class GraspError(Exception):
    """Base of every expected error: one line that says what happened, one that says what to do.

    ``kind`` is the stable, machine-readable name used in ``--json`` output.
    """

    kind = "error"

    def __init__(self, message: str, remedy: str) -> None:
        super().__init__(message, remedy)  # all arguments, so that it can be pickled
        self.message = message
        self.remedy = remedy
        self.add_note(f"remedy: {remedy}")  # in tracebacks, as of a library call

    def __str__(self) -> str:
        return self.message


class LinkLost(GraspError):
    """The device does not answer: check cable, power and address, then connect again."""

    kind = "link_lost"


class DeviceFault(GraspError):
    """The device reports a fault: clear it as the remedy says."""

    kind = "device_fault"


class Refused(GraspError):
    """The command was not sent, because it would exceed a limit or is invalid in this state."""

    kind = "refused"


class Stale(GraspError):
    """The data are too old to act on."""

    kind = "stale"


class UsageError(GraspError):
    """The options contradict each other, are invalid, or need a package that is not installed."""

    kind = "usage"

    def __init__(self, message: str, remedy: str) -> None:
        super().__init__(one_line(message), remedy)
        self.args = (message, remedy)


class CouldNotRecord(GraspError):
    """A result could not be written: free disk space or choose another folder, then run again."""

    kind = "could_not_record"


class BadFile(GraspError):
    """A recording, data set, network, checkpoint or campaign cannot be used: give another file.

    It is missing, damaged, of another kind or of another version. ``line`` counts from 1; None
    where the file as a whole is meant.
    """

    kind = "bad_file"

    def __init__(
        self, file: Path | str, problem: str, remedy: str, line: int | None = None
    ) -> None:
        where = f"{file}" if line is None else f"{file}, line {line}"
        super().__init__(f"{one_line(where)}: {one_line(problem)}", remedy)
        self.args = (str(file), problem, remedy, line)
        self.file = str(file)
        self.problem = problem
        self.line = line


class ConfigError(GraspError):
    """A setting is unknown, malformed or out of range: names file, key and what is allowed."""

    kind = "config"

    def __init__(self, file: str, key: str, problem: str, allowed: str) -> None:
        where = (file,) if key == "-" else (file, key)  # "-": the file as a whole
        said = ": ".join(one_line(part) for part in (*where, problem))
        super().__init__(said, f"allowed: {allowed}")
        self.args = (file, key, problem, allowed)
        self.file = file
        self.key = key
        self.allowed = allowed


class OutputClosedError(OSError):
    """The reader of standard output has closed it.

    A class of its own, to distinguish it from a device's broken pipe. Not a BrokenPipeError, at
    which rich ends the process.
    """
