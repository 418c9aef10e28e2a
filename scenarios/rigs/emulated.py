"""The emulated rig: real drivers over real protocols to a cell in another process, in wall time."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec

from drivers.interfaces import Gripper
from grasp.clock import WallClock
from scenarios.rigs.cell_process import CellProcess, at_endpoints, cell_process, wait_placed
from scenarios.rigs.config import AnyRigConfig, GraspRigConfig
from scenarios.rigs.rig import GraspRig, Rig, connect
from scenarios.rigs.wired import acknowledgements, wired_devices

OPEN_MPS = 0.05


@contextmanager
def emulated(config: AnyRigConfig, seed: int) -> Iterator[Rig[Any, Any]]:
    """With the object in place; closes what it opened."""
    with cell_process(config, seed) as cell:
        clock = WallClock(cell.endpoints["start_ns"])
        there = at_endpoints(config, cell.endpoints)
        with wired_devices(there, clock) as (arm, tactile, gripper):
            connect(arm, tactile, gripper, clock)
            arm.set_payload(config.arm.payload_kg)
            wait_placed(cell, clock)
            rig: Rig[Any, Any] = Rig(
                arm, tactile, gripper, clock, True, None, cell.truth, cell.stalls,
                acknowledgements(gripper),
            )  # fmt: skip
            yield rig if gripper is None else _with_object(rig, cell, clock, gripper)


def _with_object(
    rig: GraspRig, cell: CellProcess, clock: WallClock, gripper: Gripper
) -> GraspRig:  # fmt: skip
    def load(trial: GraspRigConfig, seed: int) -> None:
        cell.load(trial, seed)
        state = gripper.state
        if state is None or not state.is_open:  # as a lift leaves it that has lost its object
            gripper.open(OPEN_MPS)
        wait_placed(cell, clock)

    return msgspec.structs.replace(rig, tap=cell.tap, load=load)
