"""Room for the files and sockets that a rig has open at once, before it opens the first."""

import os
import resource
from contextlib import suppress
from pathlib import Path

from drivers.errors import UsageError

NEEDED = 64  # 30 are enough for a lift on the emulated rig, 24 are not; twice that
MORE = "let this program open more at once: ulimit -n 1024"
HERE = Path("/dev/fd")


def require() -> None:
    """Raise this process's own limit as far as the system lets it, where it is too low. Raises
    UsageError: without room a device's link would be told as lost, and the cell as not there."""
    limit, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    open_now = len(os.listdir(HERE)) if HERE.is_dir() else 0
    wanted = open_now + NEEDED
    if limit == resource.RLIM_INFINITY or limit >= wanted:
        return
    if most == resource.RLIM_INFINITY or most >= wanted:
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))
            return
    raise UsageError(f"too few open files allowed: {limit}, and a rig needs {wanted}", MORE)
