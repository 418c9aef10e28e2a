"""Every fault over real protocols in every phase of a lift ends as the soak test demands."""

from contextlib import closing
from typing import Any

import pytest

from grasp.control.states import State
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.rigs import emulated
from scenarios.trial.series import TrialContext
from tests.nightly.lift_verdict import problems
from tests.nightly.soak.test_soak import FAULTS, PHASES, Watcher
from tests.wire.lab import QUICK


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize(("device", "request_"), FAULTS, ids=str)
def test_fault_on_a_wire_in_any_phase_ends_without_a_problem(
    device: str, request_: dict[str, Any], phase: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, watcher = load_config("can", "emulated", None, None, QUICK).for_lift(), Watcher()
    monkeypatch.setattr(emulated, "cell_process", watcher.cell_process)
    watcher.due = (device, request_), phase
    context = TrialContext(None, watch=watcher.watch)
    with closing(lift.run_series(config, [0], context)) as series:
        ended = watcher.ended(next(series))
    assert watcher.fault == request_["name"]
    assert problems(ended, config) == [], ended
