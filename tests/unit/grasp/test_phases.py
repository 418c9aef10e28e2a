"""The table of phases."""

import pytest
from transitions import MachineError

from grasp.phases import TRANSITIONS, Phase, PhaseMachine, Trigger


def test_every_edge_of_the_table_can_be_walked_and_no_other() -> None:
    for trigger in Trigger:
        for phase in Phase:
            machine = PhaseMachine(phase)
            expected = [
                dest for t, sources, dest in TRANSITIONS if t is trigger and phase in sources
            ]
            if expected:
                machine.fire(trigger, 0, "test")
                assert machine.phase is expected[0]
            else:
                with pytest.raises(MachineError):
                    machine.fire(trigger, 0, "test")
