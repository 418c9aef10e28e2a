"""Each doubt is there within 100 ms of when it could be told from what is normal."""

import pytest

from grasp.phases import Phase
from tests.unit.scenarios.conftest import HAND_ALONE, Staged, in_phase
from tests.unit.scenarios.lift import device_faults as fault
from tests.unit.scenarios.lift.doubt_delays import delay_ms

P = Phase
WITHIN_MS = 100.0

# what is done, in which phases, and the name of the fault
CASES = [
    (fault.freeze_fingertips, (P.GRASP, P.LIFT, P.HOLD, P.LOWER), "fingertips_frozen"),
    (fault.freeze_thumb, (P.GRASP, P.LIFT, P.HOLD, P.LOWER), "fingertip_dead"),
    (fault.fingertips_read(0), (P.GRASP, P.LIFT, P.HOLD, P.LOWER), "fingertips_at_rail"),
    (fault.shift_fingertips, (P.GRASP, P.LIFT, P.HOLD, P.LOWER), "fingertips_jump"),
    (fault.replug_fingertips, (P.GRASP, P.LIFT, P.HOLD, P.LOWER), "fingertips_absent"),
    (fault.swallow_writes, (P.APPROACH, P.LIFT, P.HOLD), "gripper_silent"),
    (fault.freeze_gripper_status, (P.APPROACH, P.GRASP), "gripper_stands"),
    (fault.jam_gripper, (P.APPROACH, P.GRASP), "gripper_stands"),
    (fault.power_cycle_gripper, (P.APPROACH, P.GRASP, P.LIFT, P.HOLD), "gripper_inactive"),
    (fault.let_thumb_leap, (P.APPROACH, P.GRASP, P.LIFT, P.HOLD), "gripper_impossible"),
    (fault.lose_arm_position, (P.APPROACH, P.GRASP, P.LIFT, P.HOLD), "arm_position_nan"),
    (fault.freeze_arm_values, (P.LIFT, P.LOWER), "arm_frozen"),
    (fault.turn_arm_round, (P.LISTEN,), "arm_wrong_way"),
    (fault.push_arm, (P.APPROACH, P.GRASP, P.LIFT, P.HOLD), "arm_wrong_way"),
    (fault.let_arm_leap, (P.APPROACH, P.GRASP, P.LIFT, P.HOLD), "arm_jump"),
    (fault.stand_still(0.3), (P.APPROACH, P.GRASP, P.LIFT, P.HOLD), "loop_stood_still"),
]
CASE_IDS = [
    pytest.param(act, phase, name, id=f"{act.__name__}-{phase.value}")
    for act, phases, name in CASES
    for phase in phases
]


def staged(act: fault.Act, phase: Phase, after: int = 5, seed: int = 0) -> tuple[Staged, str]:
    """The lift in which this was done, and the name of the fault that came of it."""
    lift = Staged(HAND_ALONE, seed=seed)
    trial = lift.run(in_phase(phase, after), act)
    return lift, trial.controller.fault_cause.partition(":")[0]


@pytest.mark.parametrize(("act", "phase", "name"), CASE_IDS)
def test_what_can_be_seen_is_a_fault_within_a_tenth_of_a_second(
    act: fault.Act, phase: Phase, name: str
) -> None:
    lift, found = staged(act, phase)
    assert found == name
    assert 0.0 <= delay_ms(lift, name) <= WITHIN_MS
