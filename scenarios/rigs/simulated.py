"""The simulated rig: real driver cores over the device models, in this process."""

from collections.abc import Callable

from drivers.robotiq.driver import RegisterTransport, RobotiqDriver
from drivers.robotiq.model.gripper import ModelTransport
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.model.link import ModelLink
from drivers.ur.driver import ArmDriver
from grasp.clock import PacedClock, VirtualClock
from grasp.loop import Devices
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.rig import Rig, calibration, connect
from scenarios.rigs.world_of_seed import make_cell

Wrap = Callable[[RegisterTransport], RegisterTransport]


def simulated(
    config: GraspRigConfig, seed: int, paced: bool, wrap: Wrap = lambda transport: transport
) -> Rig:
    """In virtual time; ``paced`` at the wall's pace. ``wrap`` sees every register of the gripper's
    wire, both ways."""
    cell = make_cell(config, seed)
    wire = wrap(ModelTransport(cell.gripper))
    fingertips = ModelLink(cell.board, config.tactile, cell.advance)
    devices = Devices(
        gripper=RobotiqDriver(wire, config.gripper, calibration(config)),
        arm=ArmDriver(cell.arm, config.arm),
        tactile=TakkTileDriver(fingertips, config.tactile).start(),
    )
    fast = VirtualClock(fingertips.advance)
    connect(devices, fast)
    devices.arm.set_payload(config.arm.payload_kg)
    cell.place_object()
    clock = PacedClock(fingertips.advance, fast.now_ns) if paced else fast
    return Rig(devices, clock, cell, cell.truth, tap=cell.tap)
