"""The simulated rig: what its settings say of a wire that it does not have."""

from scenarios.rigs.opening import open_rig
from tests.unit.scenarios.conftest import config


def test_hand_that_is_set_to_a_serial_line_is_simulated_with_the_registers_of_one() -> None:
    """Its file may be that of a laboratory."""
    with open_rig(config("gripper.link=rtu"), 0, paced=False) as rig:
        assert rig.gripper is not None and rig.gripper.state is not None
        assert rig.gripper.state.active
