"""A run that ended in a fault can be replayed to the same fault."""

from pathlib import Path

import pytest

from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.lift.lift import lift
from scenarios.rigs import simulated
from scenarios.rigs.rig import Rig
from scenarios.trial.replay import replay_run
from tests.unit.scenarios.conftest import config, in_phase
from tests.unit.scenarios.lift import device_faults as fault


@pytest.mark.parametrize(
    "act", [fault.lose_arm_position, fault.freeze_fingertips, fault.power_cycle_gripper],
    ids=lambda act: act.__name__,
)  # fmt: skip
def test_a_run_that_ended_in_a_fault_is_replayed_to_the_same_end(
    act: fault.Act, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rigs: list[Rig] = []
    monkeypatch.setattr(simulated, "Rig", lambda *a, **k: rigs.append(Rig(*a, **k)) or rigs[-1])
    due, pending = in_phase(State.LIFT, 5), [act]

    def inject(tick: Tick) -> None:
        if pending and due(tick):
            pending.pop()(rigs[-1])

    result = lift.run(config(), 0, tmp_path, on_tick=inject).result
    assert result is not None and result.outcome == "fault"
    assert result.recording is not None
    replay = replay_run(Path(result.recording))
    assert replay.differences == []
    assert any(what.startswith("phase fault: ") for _, what in replay.events)
