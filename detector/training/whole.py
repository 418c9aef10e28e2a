"""What a training writes is whole or not there, and an error of the system names it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yields what to write in its place: it takes the name at the end, and is removed where that
    fails. Raises OSError with the name that was asked for: a full disk says none of its own."""
    partial = path.with_name(f".{path.name}")
    try:
        yield partial
        partial.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        partial.unlink(missing_ok=True)
