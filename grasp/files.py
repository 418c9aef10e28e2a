"""Files that are whole or not there, whatever the disk does; and those that are their user's alone,
whatever the umask would let through: runs, recordings, campaigns, data sets."""

import errno
import os
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

PRIVATE_FOLDER, PRIVATE_FILE = 0o700, 0o600
NO_NAMES = frozenset({errno.ENAMETOOLONG, errno.ELOOP})  # whatever disk and rights there are
TOO_MANY = (errno.EMFILE, errno.ENFILE)  # open at once
LEADS_NOWHERE = NO_NAMES | {errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST}


def write_whole(path: Path, content: bytes, private: bool = False) -> None:
    """Write a file, all of it or nothing; what stood there stays until then. Raises OSError."""
    if path.exists() and not path.is_file():  # /dev/stdout
        path.write_bytes(content)
        return
    partial = path.with_name(partial_of(path.name, str(os.getpid())))
    try:
        if private:
            make_private_file(partial)
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:  # of the name that was given
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        partial.unlink(missing_ok=True)


def save_figure(figure: Any, out: Path, dpi: float) -> None:
    """One of Matplotlib's, whole or not at all, in the format of its name, without a date. Raises
    OSError."""
    drawn, undated = BytesIO(), {"Date": None} if out.suffix == ".svg" else None
    figure.savefig(drawn, format=out.suffix[1:] or None, metadata=undated, dpi=dpi)
    write_whole(out, drawn.getvalue())


def partial_of(name: str, process: str) -> str:
    """What a file is called while it is written; or, with `*` for either, a pattern of all."""
    return f".{name}.{process}"


def make_private_folder(path: Path, exist_ok: bool = True) -> None:
    """With the parents that lack; those that were there stay as they are. Raises OSError."""
    if not path.parent.exists():
        make_private_folder(path.parent)
    path.mkdir(mode=PRIVATE_FOLDER, exist_ok=exist_ok)


def make_private_file(path: Path) -> None:
    """An empty one, or that which is there. Raises OSError."""
    os.close(private_opener(str(path), os.O_WRONLY | os.O_CREAT))


def nearest(folder: Path) -> Path:
    """It or what of the way to it is there."""
    with suppress(OSError):
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
    return folder


def against_writing(folder: Path) -> str:
    """What stands against making a file in a folder; nothing where it can be done."""
    try:
        if not folder.exists():
            return f"there is no folder {folder}"
        if not folder.is_dir():
            return f"{folder} is no folder"
        with TemporaryFile(dir=folder):  # modes alone do not tell: mounts, users
            return ""
    except OSError as error:
        return cannot(error, folder)


def cannot(error: OSError, folder: Path) -> str:
    """What a system said to a file there, in words."""
    return f"cannot be written in {folder.absolute()}: {error.strerror}"


def private_opener(path: str, flags: int) -> int:
    """For ``open``."""
    return os.open(path, flags, PRIVATE_FILE)
