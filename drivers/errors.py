"""The few errors of the whole project, each named for what the caller can do about it.

Wire garbage is never raised: drivers count it and report it in their statistics.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

MOST_SHOWN = 400  # characters of what somebody else wrote, in a message of ours


def one_line(text: object, most: int = MOST_SHOWN) -> str:
    """Foreign text fit for one line of a terminal: escaped where it cannot be printed, and cut."""
    shown = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(text)[: most + 1])
    return shown if len(shown) <= most else f"{shown[:most]}..."


def text_of(error: BaseException) -> str:
    """What an exception says, fit for a file in UTF-8; its own text may raise as well."""
    with suppress(BaseException):  # somebody's text may even exit
        return str(error).encode(errors="backslashreplace").decode()
    return "its text raises too"


def in_words(error: BaseException) -> str:
    """What somebody's code raised, in one line."""
    return one_line(f"{type(error).__name__}: {text_of(error)}")


@contextmanager
def on_failure(undo: Callable[[], object]) -> Iterator[None]:
    """Whatever is raised inside, Ctrl-C among it, runs ``undo`` and goes on."""
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
        super().__init__(message, remedy)  # all arguments, so that it survives another process
        self.message = message
        self.remedy = remedy

    def __str__(self) -> str:
        return self.message


class LinkLost(GraspError):
    """The device does not answer: check cable, power and address, then connect again."""

    kind = "link_lost"


class DeviceFault(GraspError):
    """The device answers and reports a fault of its own: clear it as the remedy says."""

    kind = "device_fault"


class Refused(GraspError):
    """The command was not sent, because it would break a limit or make no sense now."""

    kind = "refused"


class Stale(GraspError):
    """Data are too old to act on: the state that they describe may be gone."""

    kind = "stale"


class UsageError(GraspError):
    """What was asked for does not fit together or is not installed: ask otherwise."""

    kind = "usage"

    def __init__(self, message: str, remedy: str) -> None:
        super().__init__(one_line(message), remedy)
        self.args = (message, remedy)


class CouldNotRecord(GraspError):
    """A result could not be written: free the disk or choose another place, then run again."""

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


class UnreadError(OSError):
    """Nobody reads standard output any more. Not to be taken for a device's broken pipe; and no
    BrokenPipeError, at which rich ends the process."""
