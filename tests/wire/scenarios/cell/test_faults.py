"""Faults on real protocols in a lift: each ends in the safe state. Tests of all faults in all
phases are in tests/nightly, and in virtual time in tests/unit/scenarios/lift/test_faults.py."""

import pytest

from grasp.control.states import State
from tests.ur_rtde import needs_ur_rtde
from tests.wire.scenarios.cell.lift_with_fault import run


@pytest.mark.parametrize(
    ("fault", "phase"), [("protective-stop", State.LIFT), ("fingertips-unplugged", State.BRACE)]
)
@needs_ur_rtde
def test_fault_ends_in_the_safe_state(
    fault: str, phase: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = run(fault, phase, monkeypatch)
    assert not row.problems, row
