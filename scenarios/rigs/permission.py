"""Who may open the rig `hardware`: a verb made for a lab, told so on its command line.

Such verbs (`grasp run`, `release`, `gripper`, `arm`, `calibrate`) alone ask for a permit and hand
it down; without one nothing that moves real devices can be opened, whatever settings say.
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
from scenarios.rigs.calibration import Files, own_files_of
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig
from scenarios.rigs.rig import calibration

HARDWARE = "hardware"
FOLDERS = (Path("/run/lock"), Path("/tmp"))
MODE = 0o666  # other users must be able to lock it after us
# sections that say which devices are meant: a command that opens the hand must repeat them
DEVICE_SECTIONS = ("gripper", "calibration", "modbus", "usb", "ur")


class MotionPermit(msgspec.Struct, frozen=True):
    """Leave to move real devices, with the whole command that opens their hand."""

    release: str

    @property
    def let_go(self) -> str:
        """What to do about a hand that was left closed."""
        return f"to let go, support the object and run `{self.release}`"


def permit(
    config: AnyRigConfig, confirmed: bool, files: Files, assignments: Sequence[str], rig: str = ""
) -> MotionPermit | None:
    """For the rig of a verb's settings; None where there is no real device to move.

    ``files``, ``assignments`` and ``rig`` (a name or a path; empty: the settings') are what the
    command line said. Raises UsageError without a confirmation.
    """
    if config.rig != HARDWARE:
        return None
    if not confirmed:
        remedy = "clear the cell, have the emergency stop at hand, then add --confirm-motion"
        raise UsageError("the hardware rig moves real devices", remedy)
    words = ["grasp", "release", "--rig", rig or config.rig, "--confirm-motion"]
    for file in own_files_of(files):
        words += ["--config", str(file)]
    for text in assignments:
        if text.strip().split(".")[0] in DEVICE_SECTIONS:
            words += ["--set", text]
    return MotionPermit(shlex.join(words))


def require(permit: MotionPermit | None) -> MotionPermit:
    """The permit; raises UsageError for whoever would move real devices without one."""
    if not isinstance(permit, MotionPermit):
        remedy = "only verbs made for a lab do, as `grasp run`, with --confirm-motion"
        raise UsageError("this may not open the rig hardware", remedy)
    return permit


# Addresses of real devices: they have no default


def check_devices(config: AnyRigConfig) -> None:
    """Raises ConfigError where an address or the calibration of real devices was left out."""
    if config.rig != HARDWARE:
        return
    config.devices.check_offered()
    if isinstance(config, GraspRigConfig):
        calibration(config)
        gripper_address(config)
    arm_address(config)
    board_address(config)


def gripper_address(config: GraspRigConfig) -> str:
    """Where the gripper is; raises ConfigError where nobody has said it."""
    if config.devices.gripper:
        return config.devices.called("gripper")
    if config.gripper.link == "rtu":
        return _given("modbus.serial_port", config.modbus.serial_port, "/dev/ttyUSB0, or another")
    host = _given("modbus.host", config.modbus.host, "the gripper's address, as 192.168.1.11")
    return f"{host}:{config.modbus.port}"


def arm_address(config: AnyRigConfig) -> str:
    """Where the arm's controller is; raises ConfigError where nobody has said it."""
    if config.devices.arm:
        return config.devices.called("arm")
    return _given("ur.host", config.ur.host, "the address of the arm's controller")


def board_address(config: AnyRigConfig) -> str:
    """Which fingertip board; raises ConfigError where nobody has said it."""
    if config.devices.fingertips:
        return config.devices.called("fingertips")
    return config.usb.url or _given(
        "usb.serial", config.usb.serial,
        "the board's serial number, which `grasp doctor` shows, or any for the first one found",
    )  # fmt: skip


def _given(key: str, value: str, allowed: str) -> str:
    if value:
        return value
    section, _, name = key.partition(".")
    raise ConfigError(
        section, name, "real devices have no default: say which one is meant",
        f"{allowed}; in a file for --config, or --set {key}=...",
    )  # fmt: skip


# One process drives a device at a time


def devices_of(config: AnyRigConfig) -> list[str]:
    """What moves on a rig, by its address; raises ConfigError where nobody has said it."""
    gripper = [gripper_of(config)] if isinstance(config, GraspRigConfig) else []
    return [*gripper, arm_of(config)]


def arm_of(config: AnyRigConfig) -> str:
    """The arm, by its address."""
    address = arm_address(config)
    return f"arm {address}" if config.devices.arm else f"arm at {_resolved(address)}"


def gripper_of(config: GraspRigConfig) -> str:
    """The gripper, by its address."""
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


@contextmanager
def driving(*devices: str) -> Iterator[None]:
    """Drive these devices exclusively. Raises Refused, naming the process that drives one."""
    with ExitStack() as locks:
        for device in devices:
            locks.enter_context(locked(lock_path(device), MODE, partial(_driven, device)))
        yield


def lock_path(device: str) -> Path:
    """The file that the process that drives a device locks."""
    shared = (f for f in FOLDERS if f.is_dir() and f.stat().st_mode & stat.S_IWOTH)
    name = "".join(c if c.isalnum() or c in ".-" else "_" for c in device)
    return next(shared, FOLDERS[-1]) / f"grasp-{name}.lock"


def _driven(device: str, holder: Holder | None) -> Refused:
    if holder is None:
        return Refused(f"the {device} is driven by another process", "wait until that has ended")
    return Refused(
        f"the {device} is driven by process {holder.pid} since {holder.since}: {holder.command}",
        f"wait until it ends, or end it with Ctrl-C where it runs, or with `kill {holder.pid}`"
        ": the arm then stands and the grip is kept",
    )
