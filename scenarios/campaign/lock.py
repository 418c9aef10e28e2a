"""One writer a campaign file: whoever comes second is told who the first is."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from drivers.errors import ConfigError, CouldNotRecord, one_line
from grasp.files import PRIVATE_FILE, Holder, locked


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Hold `<path>.lock`. Raises ConfigError that names the holder, CouldNotRecord."""
    beside = path.resolve().with_name(f"{path.resolve().name}.lock")
    with ExitStack() as lock:
        try:
            lock.enter_context(locked(beside, PRIVATE_FILE, partial(_written, path)))
        except OSError as error:
            raise CouldNotRecord(f"{beside}: {error.strerror}", "choose another --out") from None
        yield


def _written(path: Path, holder: Holder | None) -> ConfigError:
    by = f"process {holder.pid}: {one_line(holder.command)}" if holder else "another process"
    return ConfigError(
        str(path), "--out", f"is being written by {by}",
        "another --out, or wait until that has ended",
    )  # fmt: skip
