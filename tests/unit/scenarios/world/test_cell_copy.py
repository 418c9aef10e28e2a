"""Studies continue a lift from copies of its world."""

import copy

from scenarios.campaign.config import load_for_devices
from scenarios.rigs.simulated import any_cell
from scenarios.world.cell import SimulatedCell
from tests.unit.drivers.robotiq.hand import command

MS = 1_000_000


def test_copy_of_a_cell_closes_on_the_object_like_the_original() -> None:
    cell = any_cell(load_for_devices("can", "emulated", None, ()), 0)
    assert isinstance(cell, SimulatedCell)
    cell.gripper.write(0, command(activate=True, go_to=False).to_registers(), 0)
    cell.advance(8_000 * MS)  # activation
    cell.place_object()
    cell.gripper.write(0, command(255, speed=0).to_registers(), 8_000 * MS)
    now_ns = 8_000 * MS
    while not cell.truth().touched:
        now_ns += MS
        cell.advance(now_ns)
    other = copy.deepcopy(cell)
    for world in (cell, other):
        world.advance(now_ns + 500 * MS)
    assert other.truth() == cell.truth()
    assert cell.truth().normal_n[0] > 5.0
