"""Faults on real wires in a lift: each ends in the safe state, nothing hangs. All of them at every
phase are in tests/nightly, and in virtual time in tests/unit/scenarios/lift/test_faults.py."""

import pytest

from grasp.states import State
from tests.wire.scenarios.cell.staged import run


@pytest.mark.parametrize(
    ("fault", "phase"), [("protective-stop", State.LIFT), ("fingertips-unplugged", State.BRACE)]
)
def test_fault_ends_in_the_safe_state(
    fault: str, phase: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = run(fault, phase, monkeypatch)
    assert not row.problems, row
