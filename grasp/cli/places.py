"""Where verbs may write, asked before anything moves or is computed."""

import argparse
from pathlib import Path
from tempfile import TemporaryFile

from drivers.errors import UsageError
from grasp.files import against_writing, cannot, nearest

PICTURES = (".svg", ".png", ".pdf")


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


def must_have_room(path: Path, least: int) -> None:
    """Raises OSError with the name of the file where its disk has not so many bytes left, before
    anything is computed for it."""
    try:
        with TemporaryFile(dir=path.parent) as file:
            file.write(bytes(least))
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def file_to_write(text: str) -> Path:
    """Reads the name of a file, in a folder that is there and can be written."""
    path = Path(text)
    return _writable(path, _against(path, path.parent))


def file_with_folders(text: str) -> Path:
    """As ``file_to_write`` where the folders that lack are made."""
    path = Path(text)
    return _writable(path, _against(path, nearest(path.parent)))


def folder_to_fill(text: str) -> Path:
    """Reads the name of a folder, one that is there or can be made."""
    path = Path(text)
    return _writable(path, _against(None, nearest(path)))


def picture(text: str) -> Path:
    """Reads the name of a picture: one of a kind that can be drawn, before anything is computed."""
    path = Path(text)
    if path.suffix not in PICTURES:
        kinds = f"{', '.join(PICTURES[:-1])} or {PICTURES[-1]}"
        raise argparse.ArgumentTypeError(f"{text!r}: a name that ends in {kinds}")
    return file_to_write(text)


def _writable(path: Path, problem: str) -> Path:
    if problem:
        raise argparse.ArgumentTypeError(f"{str(path)!r}: {problem}")
    return path


def _against(path: Path | None, folder: Path) -> str:
    """What stands against writing a file, or any, in a folder; nothing where it can be done."""
    try:
        if path is not None and path.is_dir():
            return "is a folder"
        if path is not None and path.exists() and not path.is_file():  # /dev/stdout
            return ""
    except OSError as error:
        return cannot(error, folder)
    return against_writing(folder)
