"""The simulated rig: real driver cores over the device models, in this process."""

from collections.abc import Callable
from typing import Any

from drivers.robotiq.driver import RegisterTransport, RobotiqDriver
from drivers.robotiq.model.gripper import ModelTransport
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.model.link import ModelLink
from drivers.ur.driver import ArmDriver
from grasp.clock import PacedClock, VirtualClock
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig
from scenarios.rigs.rig import Rig, calibration, connect
from scenarios.rigs.world_of_seed import any_cell
from scenarios.world.cell import SimulatedCell
from scenarios.world.pressed_cell import PressedCell

Wrap = Callable[[RegisterTransport], RegisterTransport]


def simulated(
    config: AnyRigConfig, seed: int, paced: bool, wrap: Wrap = lambda transport: transport
) -> Rig[Any, Any]:
    """In virtual time; ``paced`` at the wall's pace. ``wrap`` sees every register of the gripper's
    wire, both ways."""
    cell = any_cell(config, seed)
    fingertips = ModelLink(cell.board, config.tactile, cell.advance)
    tactile = TakkTileDriver(fingertips, config.tactile).start()
    arm = ArmDriver(cell.arm, config.arm)
    gripper = _gripper(config, cell, wrap)
    fast = VirtualClock(fingertips.advance)
    connect(arm, tactile, gripper, fast)
    arm.set_payload(config.arm.payload_kg)
    tap = None
    if isinstance(cell, SimulatedCell):
        cell.place_object()
        tap = cell.tap
    clock = PacedClock(fingertips.advance, fast.now_ns) if paced else fast
    return Rig(arm, tactile, gripper, clock, False, cell, cell.truth, tap=tap)


def _gripper(
    config: AnyRigConfig, cell: SimulatedCell | PressedCell, wrap: Wrap
) -> RobotiqDriver | None:
    if not isinstance(config, GraspRigConfig) or not isinstance(cell, SimulatedCell):
        return None
    wire = wrap(ModelTransport(cell.gripper))
    return RobotiqDriver(wire, config.gripper, calibration(config))
