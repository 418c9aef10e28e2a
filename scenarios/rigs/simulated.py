"""The simulated rig: real driver cores over the device models, in this process."""

from collections.abc import Callable
from typing import Any

import msgspec

from drivers.robotiq.driver import RegisterTransport, RobotiqDriver
from drivers.robotiq.model.gripper import ModelTransport
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.model.link import ModelLink
from drivers.takktile.receiver import UsbBoard
from drivers.ur.driver import ArmDriver, ArmLink
from drivers.ur.model import ArmModel
from grasp.clock import PacedClock, VirtualClock
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig
from scenarios.rigs.rig import Rig, calibration, connect
from scenarios.rigs.world_of_seed import any_cell
from scenarios.world.cell import SimulatedCell
from scenarios.world.pressed_cell import PressedCell


class Wires(msgspec.Struct, frozen=True):
    """Who sees all that passes between a driver and its device's model, both ways."""

    gripper: Callable[[RegisterTransport], RegisterTransport] = lambda transport: transport
    arm: Callable[[ArmModel], ArmLink] = lambda model: model
    fingertips: Callable[[UsbBoard], UsbBoard] = lambda usb: usb


DIRECT = Wires()
UNREAD_S = 0.16  # monitors.standstill_s and a cycle: a run that goes on has not been braked


def simulated(config: AnyRigConfig, seed: int, paced: bool, wires: Wires = DIRECT) -> Rig[Any, Any]:
    """In virtual time; ``paced`` at the wall's pace."""
    cell = any_cell(config, seed)
    fingertips = ModelLink(cell.board, config.tactile, cell.advance, wires.fingertips)
    tactile = TakkTileDriver(fingertips, config.tactile).start()
    arm = ArmDriver(wires.arm(cell.arm), config.arm)
    gripper = _gripper(config, cell, wires)
    fast = VirtualClock(fingertips.advance)
    connect(arm, tactile, gripper, fast)
    arm.set_payload(config.arm.payload_kg)
    cell.arm.brake_unread(UNREAD_S)
    tap = None
    if isinstance(cell, SimulatedCell):
        cell.place_object()
        tap = cell.tap
    clock = PacedClock(fingertips.advance, fast.now_ns) if paced else fast
    return Rig(arm, tactile, gripper, clock, False, cell, cell.truth, tap=tap)


def _gripper(
    config: AnyRigConfig, cell: SimulatedCell | PressedCell, wires: Wires
) -> RobotiqDriver | None:
    if not isinstance(config, GraspRigConfig) or not isinstance(cell, SimulatedCell):
        return None
    wire = wires.gripper(ModelTransport(cell.gripper, config.gripper.link))
    return RobotiqDriver(wire, config.gripper, calibration(config))
