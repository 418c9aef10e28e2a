"""An object is put on the table, wherever the arm stands meanwhile."""

import pytest

from scenarios.rigs.opening import open_rig
from scenarios.world.cell import SimulatedCell
from tests.unit.scenarios.conftest import config

UP_M = 0.05


def test_object_that_is_put_down_under_a_raised_arm_has_its_mark_at_the_pads_when_it_descends() -> (
    None
):
    with open_rig(config(object_name="ball"), 0, paced=False) as rig:
        cell, clock = rig.cell, rig.clock
        assert isinstance(cell, SimulatedCell)
        cell.arm.brake_unread(None)  # nobody reads it here
        x, y, z = cell.arm.position(clock.now_ns)
        for height_m, mark_m in ((UP_M, UP_M), (0.0, 0.0)):
            cell.arm.move_l((x, y, z + height_m), 0.1, 0.5, clock.now_ns)
            clock.sleep_until_ns(clock.now_ns + 3_000_000_000)
            cell.advance(clock.now_ns)
            if height_m:
                cell.place_object()
            assert cell.truth().slip_distance_m == pytest.approx(mark_m, abs=1e-6)
