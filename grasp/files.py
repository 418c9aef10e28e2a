"""Files that are whole or not there, whatever the disk does."""

import os
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, all of it or nothing; what stood there stays until then. Raises OSError."""
    if path.exists() and not path.is_file():  # /dev/stdout
        path.write_bytes(content)
        return
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
