"""The hardware rig: real drivers at the lab's own addresses."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from grasp.clock import WallClock
from scenarios.rigs.config import AnyRigConfig
from scenarios.rigs.rig import Rig, connect
from scenarios.rigs.wired import acknowledgements, wired_devices


@contextmanager
def hardware(config: AnyRigConfig) -> Iterator[Rig[Any, Any]]:
    """Nothing is known but what the devices say."""
    clock = WallClock(WallClock().now_ns)
    with wired_devices(config, clock) as (arm, tactile, gripper):
        connect(arm, tactile, gripper, clock)
        arm.set_payload(config.arm.payload_kg)
        yield Rig(
            arm, tactile, gripper, clock, True, None, None,
            acknowledgements=acknowledgements(gripper),
        )  # fmt: skip
