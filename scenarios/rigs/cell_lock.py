"""One process drives a cell at a time: a lock for each device that moves, by its address.

The system holds the lock (flock) and lets it go when its holder dies, however it dies: what is left
in the file then means nothing. A live holder is named, with how to end it.
"""

import fcntl
import os
import shlex
import socket
import stat
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path

import msgspec

from drivers.errors import Refused
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig
from scenarios.rigs.permission import arm_address, gripper_address

FOLDERS = (Path("/run/lock"), Path("/tmp"))
_MOST_BYTES = 65_536


class Holder(msgspec.Struct, frozen=True):
    """Who drives a device."""

    pid: int
    command: str
    since: str


@contextmanager
def driving(*devices: str) -> Iterator[None]:
    """Drive these devices, and let nobody else. Raises Refused with the name of whoever does."""
    with ExitStack() as locks:
        for device in devices:
            locks.enter_context(_lock(device))
        yield


def devices_of(config: AnyRigConfig) -> list[str]:
    """What moves on a rig, by its address; raises ConfigError where nobody has said it."""
    gripper = [gripper_of(config)] if isinstance(config, GraspRigConfig) else []
    return [*gripper, f"arm at {_resolved(arm_address(config))}"]


def gripper_of(config: GraspRigConfig) -> str:
    """The gripper, by its address; raises ConfigError where nobody has said it."""
    address = gripper_address(config)
    if config.gripper.link == "rtu":
        return f"gripper at {os.path.realpath(address)}"
    return f"gripper at {_resolved(config.modbus.host)}:{config.modbus.port}"


def _resolved(host: str) -> str:
    """One device has one name here, by whichever it was called."""
    try:
        return socket.gethostbyname(host)
    except OSError:
        return host.lower()


@contextmanager
def _lock(device: str) -> Iterator[None]:
    path = lock_path(device)
    file = _taken(path, device)
    try:
        own = Holder(os.getpid(), _command(), f"{datetime.now():%Y-%m-%d %H:%M:%S}")  # noqa: DTZ005
        os.ftruncate(file, 0)
        os.pwrite(file, msgspec.json.encode(own), 0)
        yield
    finally:
        with suppress(OSError):  # of another user's, in a folder where each removes their own
            path.unlink()
        os.close(file)


def lock_path(device: str) -> Path:
    """The file that is locked by whoever drives a device."""
    folder = next((f for f in FOLDERS if _shared(f)), FOLDERS[-1])
    name = "".join(c if c.isalnum() or c in ".-" else "_" for c in device)
    return folder / f"grasp-{name}.lock"


def _shared(folder: Path) -> bool:
    return folder.is_dir() and bool(folder.stat().st_mode & stat.S_IWOTH)


def _taken(path: Path, device: str) -> int:
    """The locked file. It is the one at the path: not one that its last holder has just removed."""
    while True:
        file = _opened(path)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            text = os.pread(file, _MOST_BYTES, 0)
            os.close(file)
            raise _driven(device, text) from None
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file), path.stat()):
                return file
        os.close(file)


def _opened(path: Path) -> int:
    flags = os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC
    while True:
        with suppress(FileNotFoundError):
            return os.open(path, flags)
        with suppress(FileExistsError):
            file = os.open(path, flags | os.O_CREAT | os.O_EXCL)
            os.fchmod(file, 0o666)  # other users must be able to lock it after us
            return file


def _driven(device: str, text: bytes) -> Refused:
    try:
        holder = msgspec.json.decode(text, type=Holder)
    except (msgspec.DecodeError, UnicodeDecodeError):  # it has just begun and not yet said who
        return Refused(f"the {device} is driven by another process", "wait until that has ended")
    return Refused(
        f"the {device} is driven by process {holder.pid} since {holder.since}: {holder.command}",
        f"wait until it ends, or end it with Ctrl-C where it runs, or with `kill -INT {holder.pid}`"
        ": the arm then stands and the grip is kept",
    )


def _command() -> str:
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
