"""Devices at the addresses of the configuration, including those of other packages."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from typing import Any, TypeVar

from drivers.errors import GraspError, UsageError, describe_exception
from drivers.interfaces import Arm, Gripper, TactileSensor
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.link import ThreadedGripper
from drivers.robotiq.modbus import ModbusTransport
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.emulator.bus import backend
from drivers.takktile.link import ReadingThread, UsbLink
from drivers.ur.driver import ArmDriver
from drivers.ur.link.client import UrLink
from grasp.run.clock import WallClock
from scenarios.rigs.calibration import calibration
from scenarios.rigs.config import (
    AnyRigConfig,
    GraspRigConfig,
    PluginDeviceSettings,
    plugin_devices,
)

ANY_BOARD = "any"  # of `usb.serial`
# timeouts of an emulated board, whose process may be slow on a busy machine
EMULATED_READ_MS, EMULATED_CONTROL_MS = 1_000, 10_000
DeviceT = TypeVar("DeviceT")
Now = Callable[[], int]


@contextmanager
def wired_devices(
    config: AnyRigConfig, clock: WallClock
) -> Iterator[tuple[Arm, TactileSensor, Gripper | None]]:
    """Drivers of all devices at the addresses of the configuration. Raises their errors."""
    now: Now = lambda: clock.now_ns  # noqa: E731
    arm = open_arm(config, now)
    with ExitStack() as stack:
        gripper = None
        if isinstance(config, GraspRigConfig):
            gripper = stack.enter_context(_closing_leniently(open_gripper(config, now)))
        plugin = config.devices.fingertips
        tips = (
            plugin_device(config.devices, "fingertips", now) if plugin else open_board(config, now)
        )
        tactile: TactileSensor = stack.enter_context(_closing_leniently(tips))
        yield stack.enter_context(arm), tactile, gripper


def open_gripper(config: GraspRigConfig, now: Now) -> AbstractContextManager[Gripper]:
    """The gripper of the settings; entering it connects."""
    if config.devices.gripper:
        return plugin_device(config.devices, "gripper", now)
    return wired_gripper(config, now)


def wired_gripper(config: GraspRigConfig, now: Now) -> ThreadedGripper:
    """The Robotiq gripper on Modbus; entering it starts the exchange."""
    modbus = ModbusTransport(config.modbus, config.gripper.link)
    return ThreadedGripper(
        RobotiqDriver(modbus, config.gripper, calibration(config), clock=now),
        1 / config.gripper.refresh_hz,
        write_interval_s=config.gripper.write_interval_s, close=modbus.close, clock=now,
    )  # fmt: skip


def open_board(config: AnyRigConfig, now: Now) -> TakkTileDriver:
    """The TakkTile board of the settings; entering it starts its reading thread."""
    return TakkTileDriver(
        ReadingThread(board_finder(config, now), config.tactile, now), config.tactile
    )


def board_finder(config: AnyRigConfig, now: Now) -> Callable[[str | None], UsbLink]:
    """Function that finds the fingertip board: with the given serial number, else with that of the
    settings, else any."""
    named = "" if config.usb.serial == ANY_BOARD else config.usb.serial
    if not config.usb.url:
        return lambda serial: UsbLink.find(serial or named or None, clock=now)
    bus = backend(config.usb.url)
    return lambda serial: UsbLink.find(
        serial or named or None, bus, now, EMULATED_READ_MS, EMULATED_CONTROL_MS
    )


def open_arm(config: AnyRigConfig, now: Now) -> AbstractContextManager[Arm]:
    """The arm of the settings; entering it starts its program. Raises UsageError for a UR arm
    without ur_rtde."""
    if config.devices.arm:
        return plugin_device(config.devices, "arm", now)
    return _ur_arm(config, UrLink(config.ur))


@contextmanager
def _ur_arm(config: AnyRigConfig, link: UrLink) -> Iterator[Arm]:
    with link:
        yield ArmDriver(link, config.arm)


@contextmanager
def plugin_device(devices: PluginDeviceSettings, device: str, now: Now) -> Iterator[Any]:
    """A connected device of another package. Raises ConfigError for an unknown name, GraspErrors of
    the package, and UsageError for its other exceptions. Exceptions at closing are logged."""
    devices.check_installed()
    name = devices.chosen[device]
    try:
        opened = plugin_devices(device)[name].load()(devices.settings(device), now)
        entered = opened.__enter__()
    except (GraspError, KeyboardInterrupt):
        raise
    except BaseException as error:  # its sys.exit(), or a task that was cancelled
        raise UsageError(
            f"{device} {name!r} of another package cannot be opened: {describe_exception(error)}",
            "ask its maintainers; docs/extending.md has the requirements",
        ) from error
    try:
        yield entered
    finally:
        try:
            opened.__exit__(None, None, None)
        except BaseException as error:
            logging.getLogger(__name__).warning(
                "%s %r cannot be closed: %s", device, name, describe_exception(error)
            )
            if isinstance(error, KeyboardInterrupt):
                raise


@contextmanager
def _closing_leniently(device: AbstractContextManager[DeviceT]) -> Iterator[DeviceT]:
    """Context of a device whose errors at closing are ignored, so that they cost no result."""
    entered = device.__enter__()
    try:
        yield entered
    finally:
        with suppress(GraspError):
            device.__exit__(None, None, None)


def acknowledgements(gripper: Gripper | None) -> Callable[[], Sequence[tuple[int, int]]]:
    """Function that returns pairs of times from now on, ns: command, reply to its write. Empty for
    grippers that record none."""
    if not isinstance(gripper, ThreadedGripper):
        return tuple
    before = len(gripper.acknowledgements_ns)
    return lambda: gripper.acknowledgements_ns[before:]
