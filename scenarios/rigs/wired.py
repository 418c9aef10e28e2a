"""Single devices at the addresses of the configuration, ours or those of other packages."""

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
from grasp.clock import WallClock
from scenarios.rigs.config import (
    AnyRigConfig,
    GraspRigConfig,
    OwnDeviceSettings,
    offered_devices,
)
from scenarios.rigs.rig import calibration

ANY_BOARD = "any"  # of `usb.serial`
# of an emulated board, whose process may have to wait for its turn on a busy machine
EMULATED_READ_MS, EMULATED_CONTROL_MS = 1_000, 10_000
DeviceT = TypeVar("DeviceT")
Now = Callable[[], int]


@contextmanager
def wired_devices(
    config: AnyRigConfig, clock: WallClock
) -> Iterator[tuple[Arm, TactileSensor, Gripper | None]]:
    """Drivers at the addresses of the configuration. Raises what opening raises."""
    now: Now = lambda: clock.now_ns  # noqa: E731
    with ExitStack() as stack:
        gripper = None
        if isinstance(config, GraspRigConfig):
            gripper = stack.enter_context(_letting_go(open_gripper(config, now)))
        own = config.devices.fingertips
        tips = own_device(config.devices, "fingertips", now) if own else open_board(config, now)
        tactile: TactileSensor = stack.enter_context(_letting_go(tips))
        yield stack.enter_context(open_arm(config, now)), tactile, gripper


def open_gripper(config: GraspRigConfig, now: Now) -> AbstractContextManager[Gripper]:
    """The gripper that the settings name, connected once it is entered."""
    if config.devices.gripper:
        return own_device(config.devices, "gripper", now)
    return wired_gripper(config, now)


def wired_gripper(config: GraspRigConfig, now: Now) -> ThreadedGripper:
    """The Robotiq gripper on its wire; enter it to start the exchange."""
    modbus = ModbusTransport(config.modbus, config.gripper.link)
    return ThreadedGripper(
        RobotiqDriver(modbus, config.gripper, calibration(config), clock=now),
        1 / config.gripper.refresh_hz,
        write_interval_s=config.gripper.write_interval_s, close=modbus.close, clock=now,
    )  # fmt: skip


def open_board(config: AnyRigConfig, now: Now) -> TakkTileDriver:
    """The TakkTile board that the settings name, read by a thread once it is entered."""
    return TakkTileDriver(
        ReadingThread(board_finder(config, now), config.tactile, now), config.tactile
    )


def board_finder(config: AnyRigConfig, now: Now) -> Callable[[str | None], UsbLink]:
    """Finds the fingertip board: that with the serial number asked for, else the one that the
    settings name, else any."""
    named = "" if config.usb.serial == ANY_BOARD else config.usb.serial
    if not config.usb.url:
        return lambda serial: UsbLink.find(serial or named or None, clock=now)
    bus = backend(config.usb.url)
    return lambda serial: UsbLink.find(
        serial or named or None, bus, now, EMULATED_READ_MS, EMULATED_CONTROL_MS
    )


@contextmanager
def open_arm(config: AnyRigConfig, now: Now) -> Iterator[Arm]:
    """The arm that the settings name, its program running."""
    if config.devices.arm:
        with own_device(config.devices, "arm", now) as arm:
            yield arm
        return
    with UrLink(config.ur) as link:
        yield ArmDriver(link, config.arm)


@contextmanager
def own_device(devices: OwnDeviceSettings, device: str, now: Now) -> Iterator[Any]:
    """A device of another package, connected. Raises ConfigError for an unknown name, and
    UsageError for what its package raises that is no error of ours. What closing it raises is
    logged."""
    devices.check_offered()
    name = devices.chosen[device]
    try:
        opened = offered_devices(device)[name].load()(devices.settings(device), now)
        entered = opened.__enter__()
    except (GraspError, KeyboardInterrupt):
        raise
    except BaseException as error:  # its sys.exit(), or a task that was cancelled
        raise UsageError(
            f"{device} {name!r} of another package cannot be opened: {describe_exception(error)}",
            "ask its maintainers; docs/extending.md says what is expected of it",
        ) from error
    try:
        yield entered
    finally:
        try:
            opened.__exit__(None, None, None)
        except BaseException as error:
            logging.getLogger(__name__).warning(
                "%s %r does not let go: %s", device, name, describe_exception(error)
            )
            if isinstance(error, KeyboardInterrupt):
                raise


@contextmanager
def _letting_go(device: AbstractContextManager[DeviceT]) -> Iterator[DeviceT]:
    """A device that does not let go in time costs no result: the next that opens it finds out."""
    entered = device.__enter__()
    try:
        yield entered
    finally:
        with suppress(GraspError):
            device.__exit__(None, None, None)


def acknowledgements(gripper: Gripper | None) -> Callable[[], Sequence[tuple[int, int]]]:
    """Pairs of times since now, ns: of a verb, and of the reply to its write; none of a gripper
    that keeps none."""
    if not isinstance(gripper, ThreadedGripper):
        return tuple
    before = len(gripper.acknowledgements_ns)
    return lambda: gripper.acknowledgements_ns[before:]
