"""Files written whole or not at all, readable by their user alone, or held by one process."""

import errno
import fcntl
import json
import os
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

from drivers.errors import GraspError

PRIVATE_FOLDER, PRIVATE_FILE = 0o700, 0o600  # whatever the umask allows
# errors of a path that can be no file, whatever disk and rights there are
LEADS_NOWHERE = frozenset({
    errno.ENAMETOOLONG, errno.ELOOP, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST,
})  # fmt: skip
MOST_HOLDER_BYTES = 65_536


def write_whole(path: Path, content: bytes, private: bool = False) -> None:
    """Replace a file by its new content, or leave it as it was. Raises OSError."""
    if path.exists() and not path.is_file():  # /dev/stdout
        path.write_bytes(content)
        return
    partial = path.with_name(partial_of(path.name, str(os.getpid())))
    try:
        if private:
            os.close(private_opener(str(partial), os.O_WRONLY | os.O_CREAT))
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:  # of the name that was given
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        partial.unlink(missing_ok=True)


def save_figure(figure: Any, out: Path, dpi: float) -> None:
    """Write a Matplotlib figure in the format of its name, without a date. Raises OSError."""
    drawn, undated = BytesIO(), {"Date": None} if out.suffix == ".svg" else None
    figure.savefig(drawn, format=out.suffix[1:] or None, metadata=undated, dpi=dpi)
    write_whole(out, drawn.getvalue())


def partial_of(name: str, process: str) -> str:
    """A file's name while it is written; or, with `*` for either, a pattern of all."""
    return f".{name}.{process}"


def make_private_folder(path: Path, exist_ok: bool = True) -> None:
    """With missing parents; existing ones stay as they are. Raises OSError."""
    if not path.parent.exists():
        make_private_folder(path.parent)
    path.mkdir(mode=PRIVATE_FOLDER, exist_ok=exist_ok)


def nearest(folder: Path) -> Path:
    """The folder, or its nearest parent that exists."""
    with suppress(OSError):
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
    return folder


def against_writing(folder: Path) -> str:
    """Why no file can be made in a folder; empty where one can."""
    try:
        if not folder.exists():
            return f"there is no folder {folder}"
        if not folder.is_dir():
            return f"{folder} is no folder"
        with TemporaryFile(dir=folder):  # modes alone do not show it: mounts, users
            return ""
    except OSError as error:
        return cannot(error, folder)


def cannot(error: OSError, folder: Path) -> str:
    """The system's error for a file there, in words."""
    return f"cannot be written in {folder.absolute()}: {error.strerror}"


def private_opener(path: str, flags: int) -> int:
    """For ``open``."""
    return os.open(path, flags, PRIVATE_FILE)


class Holder(NamedTuple):
    """Which process holds a file."""

    pid: int
    command: str
    since: str


@contextmanager
def locked(path: Path, mode: int, refusal: Callable[[Holder | None], GraspError]) -> Iterator[None]:
    """Hold the file at ``path``, made with that mode; it is removed afterwards.

    The system releases the lock (flock) when its holder dies, so a file that is left means nothing.
    Raises what ``refusal`` says of the live holder (None: it has not written yet who it is), and
    OSError.
    """
    file = _lock(path, mode, refusal)
    try:
        with suppress(OSError):  # a full disk: without a name the lock holds as well
            command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
            now = f"{datetime.now():%Y-%m-%d %H:%M:%S}"  # noqa: DTZ005
            os.ftruncate(file, 0)
            os.pwrite(file, json.dumps(Holder(os.getpid(), command, now)._asdict()).encode(), 0)
        yield
    finally:
        with suppress(OSError):  # of another user's, in a folder where each removes their own
            path.unlink()
        os.close(file)


def _lock(path: Path, mode: int, refusal: Callable[[Holder | None], GraspError]) -> int:
    """The locked file: the one at the path, not one that its last holder has just removed."""
    while True:
        file = _open_or_make(path, mode)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            text = os.pread(file, MOST_HOLDER_BYTES, 0)
            os.close(file)
            holder = None
            with suppress(ValueError, TypeError):
                holder = Holder(**json.loads(text))
            raise refusal(holder) from None
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file), path.stat()):
                return file
        os.close(file)


def _open_or_make(path: Path, mode: int) -> int:
    """Apart from each other: in /tmp Linux refuses O_CREAT on another user's file."""
    flags = os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC
    while True:
        with suppress(FileNotFoundError):
            return os.open(path, flags)
        with suppress(FileExistsError):
            file = os.open(path, flags | os.O_CREAT | os.O_EXCL, mode)
            os.fchmod(file, mode)  # whatever the umask would take away
            return file
