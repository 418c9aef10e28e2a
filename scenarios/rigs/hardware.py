"""The hardware rig: real drivers at the lab's own addresses."""

from collections.abc import Iterator
from contextlib import contextmanager

from grasp.clock import WallClock
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.rig import Rig, calibration, connect
from scenarios.rigs.wired import acknowledgements, wired_devices


@contextmanager
def hardware(config: GraspRigConfig) -> Iterator[Rig]:
    """Nothing is known but what the devices say."""
    clock = WallClock(WallClock().now_ns)
    with wired_devices(config, calibration(config), clock) as devices:
        connect(devices, clock)
        devices.arm.set_payload(config.arm.payload_kg)
        yield Rig(devices, clock, None, None, None, acknowledgements(devices))
