"""A run that a signal ends: safe state, closed recording, a result without a verdict."""

import json
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from grasp.control.commands import StopArm
from grasp.control.states import END_STATES, SAFE_STATES, State
from grasp.run import signals
from grasp.run.loop import Tick
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftResult
from scenarios.trial.replay import replay_run
from scenarios.trial.result import JudgedTrial
from tests.unit.scenarios.conftest import HAND_ALONE, ONE_SPEED, RIGID, Staged, config, in_phase
from tests.unit.scenarios.lift.device_faults import interrupt

QUICK = ("controller.hold_s=0.3", "controller.lift_height_m=0.08", "hand.activation_s=0.5")
PHASES = [p for p in State if p not in SAFE_STATES | END_STATES | {State.START, State.HOME}]


def signal_in(phase: State, *numbers: signal.Signals) -> Callable[[Tick], None]:
    """Raises the signals, one per tick, shortly after the start of a phase."""
    due = list(numbers)
    met = in_phase(phase, 3 if phase is not State.TARE else 0)
    ticks: list[Tick] = []

    def on_tick(tick: Tick) -> None:
        ticks.append(tick)
        if due and (len(due) < len(numbers) or met(tick)):
            signal.raise_signal(due.pop(0))

    on_tick.ticks = ticks  # type: ignore[attr-defined]
    return on_tick


def stopped_lift(
    runs: Path | None,
    phase: State,
    *numbers: signal.Signals,
    settings: tuple[str, ...] = QUICK,
) -> tuple[JudgedTrial[LiftResult], list[Tick]]:
    on_tick = signal_in(phase, *numbers)
    with signals.taken():
        finished = lift.run(config(*settings), 0, runs, on_tick=on_tick)
    return finished, on_tick.ticks  # type: ignore[attr-defined]


def test_interruption_in_any_phase_stops_the_arm() -> None:
    for phase in PHASES:
        # only a lift with these settings reaches the phase `feel`
        settings = (*QUICK, *RIGID, HAND_ALONE, ONE_SPEED) if phase is State.FEEL else QUICK
        staged = Staged(*settings)
        trial = staged.run(in_phase(phase, 0 if phase is State.TARE else 3), interrupt)
        assert trial.interrupted, phase
        assert [c.phase for c in trial.controller.machine.log][-2:] == [phase, State.STOPPED]
        assert not staged.ticks[-1].arm.moving, phase


@pytest.mark.parametrize("phase", [State.BRACE, State.DESCEND])
def test_signal_ends_the_run_without_a_verdict(phase: State, tmp_path: Path) -> None:
    finished, ticks = stopped_lift(tmp_path, phase, signal.SIGTERM)
    result = finished.result
    assert result is not None and finished.failure is not None
    assert finished.failure.kind == "interrupted"
    assert (result.outcome, result.success) == ("interrupted", None)
    assert [p.phase for p in result.phases][-2:] == [phase, "stopped"]
    assert "SIGTERM" in result.phases[-1].cause
    assert not ticks[-1].arm.moving
    stops = [i for t in ticks for i in t.issued if isinstance(i.admitted, StopArm)]
    assert stops
    (folder,) = tmp_path.iterdir()
    assert json.loads((folder / "result.json").read_text())["outcome"] == "interrupted"
    replay = replay_run(folder)
    assert replay.complete and not replay.differences
