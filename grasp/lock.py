"""A file that one process holds at a time, and in which it says who it is.

The system holds the lock (flock) and lets it go when its holder dies, however it dies: what is left
in the file then means nothing.
"""

import fcntl
import os
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

import msgspec

from drivers.errors import GraspError

_MOST_BYTES = 65_536


class Holder(msgspec.Struct, frozen=True):
    """Which process holds a file."""

    pid: int
    command: str
    since: str


@contextmanager
def locked(path: Path, mode: int, refusal: Callable[[Holder | None], GraspError]) -> Iterator[None]:
    """Hold the file at ``path``, made with that mode; it is gone afterwards.

    Raises what ``refusal`` says of the live holder (None: it has not said yet who it is), and
    OSError.
    """
    file = _taken(path, mode, refusal)
    try:
        with suppress(OSError):  # of a full disk: nameless, the lock holds as well
            os.ftruncate(file, 0)
            os.pwrite(file, msgspec.json.encode(_this_process()), 0)
        yield
    finally:
        with suppress(OSError):  # of another user's, in a folder where each removes their own
            path.unlink()
        os.close(file)


def _taken(path: Path, mode: int, refusal: Callable[[Holder | None], GraspError]) -> int:
    """The locked file. It is the one at the path: not one that its last holder has just removed."""
    while True:
        file = _opened(path, mode)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            text = os.pread(file, _MOST_BYTES, 0)
            os.close(file)
            raise refusal(_holder(text)) from None
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file), path.stat()):
                return file
        os.close(file)


def _opened(path: Path, mode: int) -> int:
    flags = os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC
    while True:
        with suppress(FileNotFoundError):
            return os.open(path, flags)
        with suppress(FileExistsError):
            file = os.open(path, flags | os.O_CREAT | os.O_EXCL, mode)
            os.fchmod(file, mode)  # whatever the umask would take away
            return file


def _holder(text: bytes) -> Holder | None:
    try:
        return msgspec.json.decode(text, type=Holder)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None


def _this_process() -> Holder:
    command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
    return Holder(os.getpid(), command, f"{datetime.now():%Y-%m-%d %H:%M:%S}")  # noqa: DTZ005
