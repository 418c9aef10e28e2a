"""The simulated rig: real driver cores over the device models, in this process."""

from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.model.gripper import ModelTransport
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.model.link import ModelLink
from drivers.ur.driver import ArmDriver
from grasp.clock import PacedClock, VirtualClock
from grasp.loop import Devices
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.rig import Rig, calibration, connect
from scenarios.rigs.world_of_seed import make_cell


def simulated(config: GraspRigConfig, seed: int, paced: bool) -> Rig:
    """In virtual time; ``paced`` at the wall's pace."""
    cell = make_cell(config, seed)
    fingertips = ModelLink(cell.board, config.tactile, cell.advance)
    devices = Devices(
        gripper=RobotiqDriver(ModelTransport(cell.gripper), config.gripper, calibration(config)),
        arm=ArmDriver(cell.arm, config.arm),
        tactile=TakkTileDriver(fingertips, config.tactile).start(),
    )
    fast = VirtualClock(fingertips.advance)
    connect(devices, fast)
    devices.arm.set_payload(config.arm.payload_kg)
    cell.place_object()
    clock = PacedClock(fingertips.advance, fast.now_ns) if paced else fast
    return Rig(devices, clock, cell, cell.truth, tap=cell.tap)
