"""One writer a campaign file: whoever comes second is told who the first is.

The system lets a lock go when its holder dies, however it dies; a file that is left means nothing.
"""

import fcntl
import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from drivers.errors import ConfigError, CouldNotRecord, one_line
from grasp.files import PRIVATE_FILE

_MOST_BYTES = 4_000


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Hold `<path>.lock`. Raises ConfigError that names the holder, CouldNotRecord."""
    beside = path.resolve().with_name(f"{path.resolve().name}.lock")
    try:
        file = _taken(beside, path)
    except OSError as error:
        raise CouldNotRecord(f"{beside}: {error.strerror}", "choose another --out") from None
    try:
        command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
        with suppress(OSError):  # of a full disk: nameless, the lock holds as well
            os.ftruncate(file, 0)
            os.write(file, f"process {os.getpid()}: {command}".encode()[:_MOST_BYTES])
        yield
    finally:
        beside.unlink(missing_ok=True)
        os.close(file)


def _taken(beside: Path, path: Path) -> int:
    """The locked file that stands at ``beside``, not one that its last holder has just removed."""
    while True:
        file = os.open(beside, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, PRIVATE_FILE)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(file), beside.stat()):
                    return file
        except BlockingIOError:
            holder = one_line(os.read(file, _MOST_BYTES).decode(errors="replace"))
            os.close(file)
            raise ConfigError(
                str(path), "--out", f"is being written by {holder or 'another process'}",
                "another --out, or wait until that has ended",
            ) from None  # fmt: skip
        os.close(file)
