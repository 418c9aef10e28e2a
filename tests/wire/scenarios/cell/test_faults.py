"""Faults on real wires, at every phase of a lift: each ends in the safe state, nothing hangs."""

import pytest

from grasp.phases import Phase
from tests.wire.scenarios.cell.staged import FAULTS, PHASES, run

SAMPLE = [  # one device, one kind of trouble and one phase each; the slow test has them all
    ("gripper-fault", Phase.COMPENSATE),
    ("protective-stop", Phase.LIFT),
    ("fingertips-unplugged", Phase.GRASP),
]


@pytest.mark.parametrize(("fault", "phase"), SAMPLE, ids=str)
def test_fault_ends_in_the_safe_state(fault: str, phase: Phase, monkeypatch) -> None:
    row = run(fault, phase, monkeypatch)
    assert not row.problems, row


@pytest.mark.slow
@pytest.mark.timeout(2400)
def test_every_fault_in_every_phase(monkeypatch) -> None:
    for fault in FAULTS:
        for phase in PHASES:
            row = run(fault, phase, monkeypatch)
            print(row, flush=True)
            assert not row.problems, row
