"""Permission to move real devices, their addresses and their locks.

Only lab commands (`grasp run`, `release`, `gripper`, `arm`, `calibrate`) with --confirm-motion
create a permit. Without one no function opens a device that can move.
"""

import os
import shlex
import socket
import stat
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import msgspec

from drivers.errors import ConfigError, Refused, UsageError
from grasp.files import Holder, locked
from scenarios.rigs.calibration import Files, calibration, config_files
from scenarios.rigs.config import HARDWARE, AnyRigConfig, GraspRigConfig

FOLDERS = (Path("/run/lock"), Path("/tmp"))
MODE = 0o666  # other users must be able to lock it later
# sections that identify the devices: a command that opens the hand must repeat them
DEVICE_SECTIONS = ("gripper", "calibration", "modbus", "usb", "ur")


class MotionPermit(msgspec.Struct, frozen=True):
    """Permission to move real devices, with the command line that opens their hand."""

    release: str

    @property
    def release_hint(self) -> str:
        """Instruction for a hand that was left closed."""
        return f"to let go, support the object and run `{self.release}`"


def permit(
    config: AnyRigConfig, confirmed: bool, files: Files, assignments: Sequence[str], rig: str = ""
) -> MotionPermit | None:
    """Permit for the rig of a command's settings; None for a rig without real devices.

    ``files``, ``assignments`` and ``rig`` (a name or a path; empty: the settings') come from the
    command line. Raises UsageError without a confirmation.
    """
    if config.rig != HARDWARE:
        return None
    if not confirmed:
        remedy = "clear the cell, have the emergency stop at hand, then add --confirm-motion"
        raise UsageError("the hardware rig moves real devices", remedy)
    words = ["grasp", "release", "--rig", rig or config.rig, "--confirm-motion"]
    for file in config_files(files):
        words += ["--config", str(file)]
    for text in assignments:
        if text.strip().split(".")[0] in DEVICE_SECTIONS:
            words += ["--set", text]
    return MotionPermit(shlex.join(words))


def require(permit: MotionPermit | None) -> MotionPermit:
    """The permit; raises UsageError without one."""
    if not isinstance(permit, MotionPermit):
        remedy = "use a lab command such as `grasp run` with --confirm-motion"
        raise UsageError("this may not open the rig hardware", remedy)
    return permit


# Addresses of real devices, without defaults


def check_devices(config: AnyRigConfig) -> None:
    """Raises ConfigError if an address or the calibration of real devices is missing."""
    if config.rig != HARDWARE:
        return
    config.devices.check_installed()
    if isinstance(config, GraspRigConfig):
        gripper_address(config)
    arm_address(config)
    board_address(config)
    if isinstance(config, GraspRigConfig):
        calibration(config)


def gripper_address(config: GraspRigConfig) -> str:
    """Address of the gripper; raises ConfigError if it is not set."""
    if config.devices.gripper:
        return config.devices.label("gripper")
    modbus = config.modbus
    if config.gripper.link == "rtu":
        return _required("modbus.serial_port", modbus.serial_port, "a path such as /dev/ttyUSB0")
    allowed = "the gripper's address, such as 192.168.1.11"
    host = _required("modbus.host", modbus.host, allowed, " --set modbus.port=...")
    return f"{host}:{modbus.port}"


def arm_address(config: AnyRigConfig) -> str:
    """Address of the arm's controller; raises ConfigError if it is not set."""
    if config.devices.arm:
        return config.devices.label("arm")
    return _required("ur.host", config.ur.host, "the address of the arm's controller")


def board_address(config: AnyRigConfig) -> str:
    """URL or serial number of the fingertip board; raises ConfigError if it is not set."""
    if config.devices.fingertips:
        return config.devices.label("fingertips")
    return config.usb.url or _required(
        "usb.serial", config.usb.serial,
        "the board's serial number, which `grasp doctor` shows, or any for the first one found",
    )  # fmt: skip


def _required(key: str, value: str, allowed: str, more: str = "") -> str:
    if value:
        return value
    section, _, name = key.partition(".")
    raise ConfigError(
        section, name, "not set; real devices have no default",
        f"{allowed}; in a file for --config, or --set {key}=...{more}",
    )  # fmt: skip


# One process drives a device at a time


def devices_of(config: AnyRigConfig) -> list[str]:
    """Lock names of the rig's moving devices; raises ConfigError for a missing address."""
    gripper = [gripper_of(config)] if isinstance(config, GraspRigConfig) else []
    return [*gripper, arm_of(config)]


def arm_of(config: AnyRigConfig) -> str:
    """Lock name of the arm."""
    address = arm_address(config)
    return f"arm {address}" if config.devices.arm else f"arm at {_resolved(address)}"


def gripper_of(config: GraspRigConfig) -> str:
    """Lock name of the gripper."""
    address = gripper_address(config)
    if config.devices.gripper:
        return f"gripper {address}"
    if config.gripper.link == "rtu":
        return f"gripper at {os.path.realpath(address)}"
    return f"gripper at {_resolved(config.modbus.host)}:{config.modbus.port}"


def _resolved(host: str) -> str:
    """Numeric address of a host, so that one device has one lock name."""
    try:
        return socket.gethostbyname(host)
    except OSError:
        return host.lower()


@contextmanager
def driving(*devices: str) -> Iterator[None]:
    """Lock these devices for this process. Raises Refused, naming the process that holds one."""
    with ExitStack() as locks:
        for device in devices:
            locks.enter_context(locked(lock_path(device), MODE, partial(_driven_error, device)))
        yield


def lock_path(device: str) -> Path:
    """Lock file of a device."""
    shared = (f for f in FOLDERS if f.is_dir() and f.stat().st_mode & stat.S_IWOTH)
    name = "".join(c if c.isalnum() or c in ".-" else "_" for c in device)
    return next(shared, FOLDERS[-1]) / f"grasp-{name}.lock"


def _driven_error(device: str, holder: Holder | None) -> Refused:
    if holder is None:
        return Refused(f"the {device} is driven by another process", "wait until it ends")
    return Refused(
        f"the {device} is driven by process {holder.pid} since {holder.since}: {holder.command}",
        f"wait until it ends, or end it with Ctrl-C in its terminal, or with `kill {holder.pid}`"
        ": the arm then stops and the hand keeps its grip",
    )
