"""Where verbs may write, asked before anything moves or is computed."""

import argparse
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

from drivers.errors import UsageError


def own_or_new(path: Path, begins: str) -> None:
    """Whether a file may be written, asked before what it will hold is computed.

    Raises UsageError where something stands there that does not begin as this verb's own files do,
    or nothing can be written.
    """
    if path.is_file() and not path.read_bytes().startswith(begins.encode()):
        raise UsageError(f"{path} is there already", "name another file")
    must_be_writable(path)


def must_be_writable(path: Path) -> None:
    """Raises UsageError where no file can be written, before anything moves or is computed."""
    if problem := _against(path, path.parent):
        raise UsageError(f"{path}: {problem}", "name another file")


def file_to_write(text: str) -> Path:
    """Reads the name of a file, in a folder that is there and can be written."""
    path = Path(text)
    return _writable(path, _against(path, path.parent))


def file_with_folders(text: str) -> Path:
    """As ``file_to_write`` where the folders that lack are made."""
    path = Path(text)
    return _writable(path, _against(path, _nearest(path.parent)))


def folder_to_fill(text: str) -> Path:
    """Reads the name of a folder, one that is there or can be made."""
    path = Path(text)
    return _writable(path, _against(None, _nearest(path)))


def _writable(path: Path, problem: str) -> Path:
    if problem:
        raise argparse.ArgumentTypeError(f"{str(path)!r}: {problem}")
    return path


def _nearest(folder: Path) -> Path:
    """It or what of the way to it is there."""
    with suppress(OSError):
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
    return folder


def _against(path: Path | None, folder: Path) -> str:
    """What stands against writing a file, or any, in a folder; nothing where it can be done."""
    try:
        if path is not None and path.is_dir():
            return "is a folder"
        if path is not None and path.exists() and not path.is_file():  # /dev/stdout
            return ""
        if not folder.exists():
            return f"there is no folder {folder}"
        if not folder.is_dir():
            return f"{folder} is no folder"
        with TemporaryFile(dir=folder):  # modes alone do not tell: mounts, users
            return ""
    except OSError as error:
        return f"cannot be written: {error.strerror}"
