"""Real drivers on real wires, at the addresses of the configuration."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.link.modbus import ModbusTransport
from drivers.robotiq.link.thread import ThreadedGripper
from drivers.robotiq.link.timing import TimedTransport
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.emulator.bus import backend
from drivers.takktile.link.thread import ReadingThread
from drivers.takktile.link.usb import UsbLink
from drivers.ur.driver import ArmDriver
from drivers.ur.link.client import UrLink
from grasp.clock import WallClock
from grasp.loop import Devices
from scenarios.rigs.config import GraspRigConfig


@contextmanager
def wired_devices(
    config: GraspRigConfig, calibration: GripperCalibration, clock: WallClock
) -> Iterator[Devices]:
    """Drivers on real wires, at the addresses of the configuration. Raises what opening raises."""
    now: Callable[[], int] = lambda: clock.now_ns  # noqa: E731
    modbus = ModbusTransport(config.modbus, config.gripper.link)
    timed = TimedTransport(modbus, now)
    core = RobotiqDriver(timed, config.gripper, calibration)
    bus = backend(config.usb.url) if config.usb.url else None
    find = partial(UsbLink.find, backend=bus, clock=now)
    with (
        ThreadedGripper(
            core, 1 / config.gripper.refresh_hz, timed=timed,
            write_interval_s=config.gripper.write_interval_s, close=modbus.close, clock=now,
        ) as gripper,
        TakkTileDriver(ReadingThread(find, config.tactile, now), config.tactile) as tactile,
        UrLink(config.ur) as link,
    ):  # fmt: skip
        yield Devices(gripper=gripper, arm=ArmDriver(link, config.arm), tactile=tactile)


def acknowledgements(devices: Devices) -> Callable[[], Sequence[tuple[int, int]]]:
    """Pairs of times since now, ns: of a verb, and of the reply to its write."""
    gripper = devices.gripper
    assert isinstance(gripper, ThreadedGripper)  # noqa: S101
    before = len(gripper.acknowledgements_ns)
    return lambda: gripper.acknowledgements_ns[before:]
