"""Opens the rig that a configuration names."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Any

from drivers.errors import ConfigError
from grasp.run import signals
from grasp.run.clock import WallClock
from scenarios.rigs.config import HARDWARE, AnyRigConfig, GraspRigConfig, PressRigConfig
from scenarios.rigs.permission import (
    MotionPermit,
    check_devices,
    devices_of,
    driving,
    require,
)
from scenarios.rigs.rig import GraspRig, PressRig, Rig, connect


def open_rig(
    config: GraspRigConfig, seed: int, paced: bool, permit: MotionPermit | None = None
) -> AbstractContextManager[GraspRig]:
    """The rig with its hand active and open and an object in place; closes it at the end.

    Raises the drivers' errors. The rig `hardware` has no ground truth; it raises UsageError without
    a permit, ConfigError for a device without an address, Refused if another process drives one.
    """
    return _open(config, seed, paced, permit)


def open_press_rig(
    config: PressRigConfig, seed: int, paced: bool, permit: MotionPermit | None = None
) -> AbstractContextManager[PressRig]:
    """The rig without a gripper; one finger of the hand points down. Errors as of ``open_rig``."""
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
                raise ConfigError("rig", config.rig, "unknown rig", "simulated, emulated, hardware")
        yield rig


@contextmanager
def hardware(config: AnyRigConfig, permit: MotionPermit | None) -> Iterator[Rig[Any, Any]]:
    """The rig of real devices, locked for this process."""
    from scenarios.rigs.wired import acknowledgements, wired_devices

    release_hint = require(permit).release_hint
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
            acknowledgements=acknowledgements(gripper), release_hint=release_hint,
        )  # fmt: skip
