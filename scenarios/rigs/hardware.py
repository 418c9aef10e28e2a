"""The hardware rig: real drivers at the lab's own addresses."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from grasp.clock import WallClock
from scenarios.rigs.cell_lock import devices_of, driving
from scenarios.rigs.config import AnyRigConfig
from scenarios.rigs.permission import MotionPermit, check_devices, require
from scenarios.rigs.rig import Rig, connect
from scenarios.rigs.wired import acknowledgements, wired_devices


@contextmanager
def hardware(config: AnyRigConfig, permit: MotionPermit | None) -> Iterator[Rig[Any, Any]]:
    """Nothing is known but what the devices say.

    Raises UsageError without a permit, ConfigError where a device has no address, Refused where
    another process drives one.
    """
    way_out = require(permit).let_go
    check_devices(config)
    clock = WallClock(WallClock().now_ns)
    with (
        driving(*devices_of(config)),
        wired_devices(config, clock) as (arm, tactile, gripper),
    ):
        connect(arm, tactile, gripper, clock, real=True)
        arm.set_payload(config.arm.payload_kg)
        yield Rig(
            arm, tactile, gripper, clock, True, None, None,
            acknowledgements=acknowledgements(gripper), way_out=way_out,
        )  # fmt: skip
