"""Opens the rig that a configuration names: with a hand around an object, or one finger alone."""

import os
import resource
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError, UsageError
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

NEEDED = 64  # 30 are enough for a lift on the emulated rig, 24 are not; twice that
MORE = "let this program open more at once: ulimit -n 1024"
HERE = Path("/dev/fd")


def make_room() -> None:
    """Raise this process's own limit as far as the system lets it, where it is too low. Raises
    UsageError: without room a device's link would be told as lost, and the cell as not there."""
    limit, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    open_now = len(os.listdir(HERE)) if HERE.is_dir() else 0
    wanted = open_now + NEEDED
    if limit == resource.RLIM_INFINITY or limit >= wanted:
        return
    if most == resource.RLIM_INFINITY or most >= wanted:
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))
            return
    raise UsageError(f"too few open files allowed: {limit}, and a rig needs {wanted}", MORE)


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


@contextmanager
def open_rig(
    config: GraspRigConfig, seed: int, paced: bool, permit: MotionPermit | None = None
) -> Iterator[GraspRig]:
    """The hand is active and open, an object in place. Raises the drivers' errors, and what
    ``hardware`` raises without a permit; closes what it opened."""
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
    make_room()
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
