"""One process drives a cell at a time: a lock for each device that moves, by its address. A live
holder is named, with how to end it."""

import os
import socket
import stat
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from drivers.errors import Refused
from grasp.lock import Holder, locked
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig
from scenarios.rigs.permission import arm_address, gripper_address

FOLDERS = (Path("/run/lock"), Path("/tmp"))
MODE = 0o666  # other users must be able to lock it after us


@contextmanager
def driving(*devices: str) -> Iterator[None]:
    """Drive these devices, and let nobody else. Raises Refused with the name of whoever does."""
    with ExitStack() as locks:
        for device in devices:
            locks.enter_context(locked(lock_path(device), MODE, partial(_driven, device)))
        yield


def devices_of(config: AnyRigConfig) -> list[str]:
    """What moves on a rig, by its address; raises ConfigError where nobody has said it."""
    gripper = [gripper_of(config)] if isinstance(config, GraspRigConfig) else []
    return [*gripper, arm_of(config)]


def arm_of(config: AnyRigConfig) -> str:
    """The arm, by its address; raises ConfigError where nobody has said it."""
    address = arm_address(config)
    return f"arm {address}" if config.devices.arm else f"arm at {_resolved(address)}"


def gripper_of(config: GraspRigConfig) -> str:
    """The gripper, by its address; raises ConfigError where nobody has said it."""
    address = gripper_address(config)
    if config.devices.gripper:
        return f"gripper {address}"
    if config.gripper.link == "rtu":
        return f"gripper at {os.path.realpath(address)}"
    return f"gripper at {_resolved(config.modbus.host)}:{config.modbus.port}"


def _resolved(host: str) -> str:
    """One device has one name here, by whichever it was called."""
    try:
        return socket.gethostbyname(host)
    except OSError:
        return host.lower()


def lock_path(device: str) -> Path:
    """The file that is locked by whoever drives a device."""
    folder = next((f for f in FOLDERS if _shared(f)), FOLDERS[-1])
    name = "".join(c if c.isalnum() or c in ".-" else "_" for c in device)
    return folder / f"grasp-{name}.lock"


def _shared(folder: Path) -> bool:
    return folder.is_dir() and bool(folder.stat().st_mode & stat.S_IWOTH)


def _driven(device: str, holder: Holder | None) -> Refused:
    if holder is None:
        return Refused(f"the {device} is driven by another process", "wait until that has ended")
    return Refused(
        f"the {device} is driven by process {holder.pid} since {holder.since}: {holder.command}",
        f"wait until it ends, or end it with Ctrl-C where it runs, or with `kill {holder.pid}`"
        ": the arm then stands and the grip is kept",
    )
