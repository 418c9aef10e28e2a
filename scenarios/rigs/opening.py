"""Opens the rig that a configuration names."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Any

from drivers.errors import ConfigError
from grasp import signals
from grasp.clock import WallClock
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig, PressRigConfig
from scenarios.rigs.permission import (
    HARDWARE,
    MotionPermit,
    check_devices,
    devices_of,
    driving,
    require,
)
from scenarios.rigs.rig import GraspRig, PressRig, Rig, connect
from scenarios.rigs.wired import acknowledgements, wired_devices


def open_rig(
    config: GraspRigConfig, seed: int, paced: bool, permit: MotionPermit | None = None
) -> AbstractContextManager[GraspRig]:
    """The rig with its hand active and open, an object in place; closes what it opened.

    Raises the drivers' errors. On the rig `hardware` nothing is known but what the devices say, and
    it raises UsageError without a permit, ConfigError where a device has no address, Refused where
    another process drives one.
    """
    return _open(config, seed, paced, permit)


def open_press_rig(
    config: PressRigConfig, seed: int, paced: bool, permit: MotionPermit | None = None
) -> AbstractContextManager[PressRig]:
    """Without a gripper: the hand stays as it is, one finger pointing down. As ``open_rig``."""
    return _open(config, seed, paced, permit)


@contextmanager
def _open(
    config: AnyRigConfig, seed: int, paced: bool, permit: MotionPermit | None
) -> Iterator[Rig[Any, Any]]:
    with ExitStack() as stack:
        with signals.immediate():  # opening may take half a minute
            if config.rig == "simulated":
                from scenarios.rigs.simulated import simulated

                rig: Rig[Any, Any] = simulated(config, seed, paced)
            elif config.rig == "emulated":
                from scenarios.rigs.emulated import emulated

                rig = stack.enter_context(emulated(config, seed))
            elif config.rig == HARDWARE:
                rig = stack.enter_context(hardware(config, permit))
            else:
                raise ConfigError("rig", config.rig, "unknown", "simulated, emulated, hardware")
        yield rig


@contextmanager
def hardware(config: AnyRigConfig, permit: MotionPermit | None) -> Iterator[Rig[Any, Any]]:
    """The rig of real devices, which this process alone drives."""
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
