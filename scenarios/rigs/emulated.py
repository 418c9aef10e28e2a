"""The emulated rig: real drivers over real protocols to a cell in another process, in wall time."""

from collections.abc import Iterator
from contextlib import contextmanager

from grasp.clock import WallClock
from scenarios.rigs.cell_process import at_endpoints, cell_process, wait_placed
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.rig import Rig, calibration, connect
from scenarios.rigs.wired import acknowledgements, wired_devices


@contextmanager
def emulated(config: GraspRigConfig, seed: int) -> Iterator[Rig]:
    """With the object in place; closes what it opened."""
    with cell_process(config, seed) as cell:
        clock = WallClock(cell.endpoints["start_ns"])
        there = at_endpoints(config, cell.endpoints)
        with wired_devices(there, calibration(config), clock) as devices:
            connect(devices, clock)
            devices.arm.set_payload(config.arm.payload_kg)
            wait_placed(cell, clock)

            def load(trial: GraspRigConfig, seed: int) -> None:
                cell.load(trial, seed)
                wait_placed(cell, clock)

            yield Rig(
                devices, clock, None, cell.truth, cell.stalls, acknowledgements(devices),
                cell.tap, load,
            )  # fmt: skip
