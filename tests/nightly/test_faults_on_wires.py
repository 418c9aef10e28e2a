"""Every fault over real protocols in every phase of a lift ends in the safe state."""

import pytest

from grasp.control.states import State
from tests.wire.scenarios.cell.lift_with_fault import FAULTS, PHASES, run


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("fault", FAULTS)
def test_fault_ends_in_the_safe_state(
    fault: str, phase: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = run(fault, phase, monkeypatch)
    print(row)
    assert not row.problems, row
