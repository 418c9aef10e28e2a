"""Atomic writing of files, private files and folders, and lock files."""

import errno
import fcntl
import hashlib
import json
import os
import shlex
import shutil
import socket
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryFile, gettempdir
from typing import Any, NamedTuple

from drivers.errors import GraspError, OutputClosedError

PRIVATE_FOLDER, PRIVATE_FILE = 0o700, 0o600  # modes, independent of the umask
# errors of a path that cannot be a file, independent of disk and permissions
PATH_ERRORS = frozenset({
    errno.ENAMETOOLONG, errno.ELOOP, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST,
})  # fmt: skip
DESCRIPTORS = (Path("/dev"), Path("/dev/fd"), Path("/proc/self/fd"))  # folders of open descriptors
CACHE_VARIABLES = ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "MPLCONFIGDIR")
MOST_HOLDER_BYTES = 65_536
PROBE_BYTES = 65_536  # about one second of a recording; a full disk accepts empty files


def is_stream(path: Path) -> bool:
    """Whether a path is a device, a pipe or an open descriptor such as /dev/stdout."""
    return path.exists() and (not path.is_file() or path.parent in DESCRIPTORS)


def write_whole(path: Path, content: bytes, private: bool = False) -> None:
    """Replace a file's content completely or not at all; append to a stream. Raises OSError."""
    if is_stream(path):
        try:
            with path.open("ab") as stream:
                stream.write(content)
        except BrokenPipeError as error:
            raise OutputClosedError(*error.args) from None
        return
    partial = path.with_name(partial_name(path.name, str(os.getpid())))
    try:
        if private:
            os.close(private_opener(str(partial), os.O_WRONLY | os.O_CREAT))
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:  # report the name that was given
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A new private folder to fill; it appears at ``path`` when it is complete, and is removed
    after an exception. Raises OSError."""
    partial = path.with_name(partial_name(path.name, str(os.getpid())))
    try:
        make_private_folder(partial / path.name, exist_ok=False)
        yield partial / path.name
        (partial / path.name).rename(path)
    except OSError as error:  # report the name that was given
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def save_figure(figure: Any, out: Path, dpi: float) -> None:
    """Write a Matplotlib figure in the format of its file name, without a date. Raises OSError."""
    content, undated = BytesIO(), {"Date": None} if out.suffix == ".svg" else None
    figure.savefig(content, format=out.suffix[1:] or None, metadata=undated, dpi=dpi)
    write_whole(out, content.getvalue())


def partial_name(name: str, process: str) -> str:
    """Name of a file while it is being written; with `*` for either argument, a pattern."""
    return f".{name}.{process}"


def make_private_folder(path: Path, exist_ok: bool = True) -> None:
    """Make a private folder and its missing parents; existing parents keep their modes. Raises
    OSError."""
    if not path.parent.exists():
        make_private_folder(path.parent)
    path.mkdir(mode=PRIVATE_FOLDER, exist_ok=exist_ok)


def use_writable_cache() -> None:
    """Let libraries keep their files where they can: omit folders in the environment that cannot be
    written, and replace a user's cache folder like that by one of the temporary directory. Numba
    refuses to compile without such a folder. To call before the import of compiled code."""
    for name in CACHE_VARIABLES:
        folder = Path(os.path.expanduser(os.environ.pop(name, "")))
        if folder.is_absolute() and not why_not_writable(nearest_folder(folder)):
            os.environ[name] = str(folder)
    usual = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    if usual.is_absolute() and not why_not_writable(nearest_folder(usual)):
        return
    ours = Path(gettempdir()).absolute() / f"grasp-cache-{os.getuid()}"
    with suppress(OSError):
        make_private_folder(ours)
        found = ours.lstat()  # code is loaded from there: nobody else may write it
        if (
            stat.S_ISDIR(found.st_mode)
            and found.st_uid == os.getuid()
            and not found.st_mode & 0o022
        ):
            os.environ["XDG_CACHE_HOME"] = str(ours)


def nearest_folder(folder: Path) -> Path:
    """The folder, or its nearest existing parent."""
    with suppress(OSError):
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
    return folder


def why_not_writable(folder: Path) -> str:
    """Why no file can be written in a folder; empty if one can."""
    try:
        if not folder.exists():
            return f"there is no folder {folder}"
        if not folder.is_dir():
            return f"{folder} is no folder"
        with TemporaryFile(dir=folder) as file:  # modes are not enough: mounts and users matter too
            file.write(bytes(PROBE_BYTES))
        return ""
    except OSError as error:
        return write_error(error, folder)


def write_error(error: OSError, folder: Path) -> str:
    """Message for the system's error at a file in that folder."""
    return f"cannot be written in {folder.absolute()}: {error.strerror}"


def private_opener(path: str, flags: int) -> int:
    """Opener for ``open`` that creates private files."""
    return os.open(path, flags, PRIVATE_FILE)


class Holder(NamedTuple):
    """The process that holds a lock file."""

    pid: int
    command: str
    since: str


@contextmanager
def locked(path: Path, mode: int, refusal: Callable[[Holder | None], GraspError]) -> Iterator[None]:
    """Hold the lock file ``path``, created with ``mode`` and removed afterwards.

    The system releases the lock (flock) when its holder ends, so a remaining file means nothing.
    Somebody may remove the file meanwhile, so the holder also has the path's name as a socket.
    If another process holds it, raises the error that ``refusal`` makes of the holder (None: not
    written yet). Raises OSError too.
    """
    file, name = _lock(path, mode, refusal)
    try:
        with suppress(OSError):  # e.g. a full disk: the lock holds without the name too
            command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
            now = f"{datetime.now():%Y-%m-%d %H:%M:%S}"  # noqa: DTZ005
            os.ftruncate(file, 0)
            os.pwrite(file, json.dumps(Holder(os.getpid(), command, now)._asdict()).encode(), 0)
        yield
    finally:
        with suppress(OSError):  # the file of another user, in a sticky folder
            path.unlink()
        os.close(file)
        name.close()


def _lock(
    path: Path, mode: int, refusal: Callable[[Holder | None], GraspError]
) -> tuple[int, socket.socket]:
    """Lock the file at the path, not one that its last holder has just removed, and its name."""
    name = socket.socket(socket.AF_UNIX)
    named = f"\0grasp-{hashlib.sha256(os.fsencode(path.resolve())).hexdigest()}"
    while True:
        file = _open_or_make(path, mode)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(file), path.stat()):
                name.bind(named)
                return file, name
        except FileNotFoundError:
            pass
        except OSError as error:
            text = os.pread(file, MOST_HOLDER_BYTES, 0)
            os.close(file)
            name.close()
            if error.errno not in (errno.EWOULDBLOCK, errno.EADDRINUSE):
                raise
            holder = None
            with suppress(ValueError, TypeError):
                holder = Holder(**json.loads(text))
            raise refusal(holder) from None
        os.close(file)


def _open_or_make(path: Path, mode: int) -> int:
    """Open or create in separate calls: in /tmp, Linux refuses O_CREAT on another user's file."""
    flags = os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC
    while True:
        with suppress(FileNotFoundError):
            return os.open(path, flags)
        with suppress(FileExistsError):
            file = os.open(path, flags | os.O_CREAT | os.O_EXCL, mode)
            os.fchmod(file, mode)  # independent of the umask
            return file
