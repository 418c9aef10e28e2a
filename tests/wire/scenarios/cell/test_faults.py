"""Faults on real wires in a lift: each ends in the safe state, nothing hangs. All of them at every
phase are in tests/nightly, and in virtual time in tests/unit/scenarios/lift/test_faults.py."""

import pytest

from grasp.phases import Phase
from tests.wire.scenarios.cell.staged import run


@pytest.mark.parametrize(
    ("fault", "phase"), [("protective-stop", Phase.LIFT), ("fingertips-unplugged", Phase.GRASP)]
)
def test_fault_ends_in_the_safe_state(
    fault: str, phase: Phase, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = run(fault, phase, monkeypatch)
    assert not row.problems, row
