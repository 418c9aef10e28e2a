"""Opens the rig that a configuration names, and single devices at their addresses."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
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


@contextmanager
def open_rig(
    config: GraspRigConfig, seed: int, paced: bool, permit: MotionPermit | None = None
) -> Iterator[GraspRig]:
    """The hand is active and open, an object in place; closes what it opened.

    Raises the drivers' errors. On the rig `hardware` nothing is known but what the devices say, and
    it raises UsageError without a permit, ConfigError where a device has no address, Refused where
    another process drives one.
    """
    with _open(config, seed, paced, permit) as rig:
        yield rig


@contextmanager
def open_press_rig(
    config: PressRigConfig, seed: int, paced: bool, permit: MotionPermit | None = None
) -> Iterator[PressRig]:
    """Without a gripper: the hand stays as it is, one finger pointing down. As ``open_rig``."""
    with _open(config, seed, paced, permit) as rig:
        yield rig


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
