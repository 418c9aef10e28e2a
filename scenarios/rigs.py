"""Opens a rig: the three devices, their clock, and, where there is a simulation, its truth."""

from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
import numpy as np

from drivers.errors import ConfigError, DeviceFault
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.model import ModelTransport
from drivers.robotiq.protocol import CALIBRATIONS, GripperCalibration
from drivers.takktile.driver import ModelLink, TakkTileDriver
from drivers.ur.driver import ArmDriver
from grasp.clock import Clock, PacedClock, VirtualClock
from grasp.loop import Devices
from scenarios.config import LiftConfig
from scenarios.variation import draw
from scenarios.world.cell import CellSettings, SimulatedCell, Truth

POLL_NS = 100_000_000  # while waiting for activation
ACTIVATION_TIMEOUT_S = 25.0


class Rig(msgspec.Struct, frozen=True):
    """Devices that are connected, activated and have been read once."""

    devices: Devices
    clock: Clock
    cell: SimulatedCell | None

    def truth(self) -> Truth | None:
        """The state of the simulated world now; None on hardware."""
        return None if self.cell is None else self.cell.truth()


def calibration(config: LiftConfig) -> GripperCalibration:
    """The gripper calibration that the configuration names."""
    found = CALIBRATIONS.get(config.gripper.calibration)
    if found is None:
        known = ", ".join(CALIBRATIONS)
        raise ConfigError("gripper", "calibration", f"unknown: {config.gripper.calibration}", known)
    return found


@contextmanager
def open_rig(config: LiftConfig, seed: int, paced: bool) -> Iterator[Rig]:
    """The rig that the configuration names. Raises the drivers' errors; closes what it opened."""
    yield _simulated(config, seed, paced)


def _simulated(config: LiftConfig, seed: int, paced: bool) -> Rig:
    """Real driver cores over the device models, in this process."""
    varied, world = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    trial = draw(config.variation, config.object, config.hand, varied)
    cell = SimulatedCell(
        CellSettings(
            body=trial.body,
            contact=config.contact,
            fingertip=config.fingertip,
            hand=trial.hand,
            board=config.board,
            arm=config.arm_model,
            finger_offset_m=trial.finger_offset_m,
        ),
        world,
    )
    tactile = TakkTileDriver(ModelLink(cell.board), config.tactile)
    tactile.open(0)
    devices = Devices(
        gripper=RobotiqDriver(ModelTransport(cell.gripper), config.gripper, calibration(config)),
        arm=ArmDriver(cell.arm, config.arm),
        tactile=tactile,
    )
    fast = VirtualClock(cell.advance)
    connect(devices, fast)
    devices.arm.set_payload(config.arm.payload_kg)
    cell.place_object()
    clock = PacedClock(cell.advance, fast.now_ns) if paced else fast
    return Rig(devices, clock, cell)


def connect(devices: Devices, clock: Clock) -> None:
    """First exchange with each device, then activation of the gripper if it is not active yet.

    Raises what the devices raise, and DeviceFault when activation takes far longer than usual.
    """
    now_ns = clock.now_ns
    devices.arm.pump(now_ns)
    devices.gripper.pump(now_ns)
    devices.gripper.activate()
    end_ns = now_ns + round(ACTIVATION_TIMEOUT_S * 1e9)
    while (state := devices.gripper.state) is None or not state.active:
        if clock.now_ns >= end_ns:
            raise DeviceFault(
                f"gripper not active {ACTIVATION_TIMEOUT_S:g} s after the request",
                "look at its LED, clear what blocks the fingers, switch it off and on",
            )
        clock.sleep_until_ns(clock.now_ns + POLL_NS)
        devices.gripper.pump(clock.now_ns)
    devices.arm.pump(clock.now_ns)
    devices.tactile.pump(clock.now_ns)
