"""An unexpected exception ends a run like a fault, wherever it is raised."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import Refused
from grasp.control.commands import MoveArm
from grasp.control.controller import GraspController
from grasp.control.guard import ForceGuard
from grasp.control.monitors.checks import Monitors
from grasp.control.states import AIRBORNE_STATES, State
from grasp.run.loop import Tick
from grasp.run.recording import RunRecorder
from scenarios.trial.replay import replay_run
from scenarios.trial.run_folder import could_not_record
from scenarios.world.cell import SimulatedCell
from tests.unit.scenarios.conftest import Staged, config, in_phase
from tests.unit.scenarios.lift import device_faults as fault
from tests.unit.scenarios.trial.test_interrupted import QUICK

TEXT = "planted"
PLACES: dict[str, tuple[type, str]] = {
    "controller": (GraspController, "step"),
    "monitors": (Monitors, "check"),
    "guard": (ForceGuard, "admit"),
    "recorder": (RunRecorder, "write"),
    "truth": (SimulatedCell, "truth"),
}


def plant(
    patch: pytest.MonkeyPatch,
    owner: type,
    name: str,
    error: type[BaseException] = ZeroDivisionError,
) -> Callable[[], None]:
    """After a call of the result, the method raises at every call."""
    whole = getattr(owner, name)
    planted: list[bool] = []

    def broken(self: Any, *args: Any, **more: Any) -> Any:
        if planted:
            raise error(TEXT)
        return whole(self, *args, **more)

    patch.setattr(owner, name, broken)
    return lambda: planted.append(True)


def staged(
    patch: pytest.MonkeyPatch, place: str, phase: State
) -> tuple[Staged, Any, SimulatedCell]:
    begin = plant(patch, *PLACES[place])
    lift = Staged(*QUICK)
    met = in_phase(phase, 5)
    # a rig reads the truth of the cell that it was opened with: no checkpoint can replace it
    trial = lift.run(met.__call__, lambda rig: begin())
    patch.undo()
    cell = fault.cell(lift.rig)
    cell.advance(cell.truth().t_ns + 1_000_000_000)
    return lift, trial, cell


CASES = [
    (place, phase)
    for place in PLACES
    for phase in (State.BRACE, State.LIFT)
    # without a folder there is no recorder
    if place != "recorder"
]


@pytest.mark.parametrize(("place", "phase"), CASES)
def test_unexpected_exception_leaves_a_stationary_arm_and_a_closed_hand(
    place: str, phase: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    lift, trial, cell = staged(monkeypatch, place, phase)
    result = lift.result(trial)
    assert (result.outcome, result.success) == ("internal_error", None)
    assert result.bug is not None
    assert (result.bug.name, result.bug.text) == ("ZeroDivisionError", TEXT)
    assert "Traceback" in result.bug.traceback
    assert result.end is not None and result.end.arm == "the arm is stationary"
    if place != "guard":  # without it nothing may close
        assert result.end.unconfirmed == ()
    truth = cell.truth()
    assert cell.arm.at(truth.t_ns).velocity_mps == (0.0, 0.0, 0.0)
    assert max(truth.peak_n) < 11.0
    if phase in AIRBORNE_STATES and place != "guard":  # without it nothing may close
        assert truth.normal_n[0] > 8.0
    elif phase in AIRBORNE_STATES:
        assert truth.touched
    failure = trial.failure(lift.config)
    assert failure is not None and failure.kind == "internal"
    assert failure.message.startswith("internal_error: ZeroDivisionError: planted (File ")
    assert failure.end == result.end
    raised_ns = lift.ticks[-1].t_ns if place == "guard" else lift.done_at_ns  # asked later on
    sent = [i.admitted for t in lift.ticks for i in t.issued if i.decided_ns > raised_ns]  # type: ignore[operator]
    assert not any(isinstance(c, MoveArm) for c in sent)


def refuse_once(patch: pytest.MonkeyPatch, rig: Any, refused: list[bool]) -> None:
    """The next closing is refused, and noted."""
    close = rig.devices.gripper.close_to_limit

    def refuses_once(*asked: Any) -> Any:
        if not refused:
            refused.append(True)
            raise Refused("busy", "wait")
        return close(*asked)

    patch.setattr(type(rig.devices.gripper), "close_to_limit", lambda _, *a: refuses_once(*a))


def test_refused_closing_is_repeated_without_the_control_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begin = plant(monkeypatch, GraspController, "step")
    lift = Staged(*QUICK)
    refused: list[bool] = []

    def act(rig: Any) -> None:
        begin()
        refuse_once(monkeypatch, rig, refused)

    trial = lift.run(in_phase(State.LIFT, 5), act)
    result = lift.result(trial)
    assert refused and result.end is not None and result.end.unconfirmed == ()
    assert fault.cell(lift.rig).truth().normal_n[0] > 8.0


def test_recording_of_a_run_that_an_observer_ended_is_replayed_to_its_safe_state(
    tmp_path: Path,
) -> None:
    from scenarios.lift.lift import lift

    def on_tick(tick: Tick) -> None:
        if tick.decision.state is State.LIFT:
            raise LookupError("no screen")

    finished = lift.run(config(*QUICK), 0, tmp_path, on_tick=on_tick)
    assert finished.result is not None and finished.result.outcome == "internal_error"
    assert [p.phase for p in finished.result.phases][-2:] == ["lift", "fault"]
    (folder,) = tmp_path.iterdir()
    replay = replay_run(folder)
    assert replay.complete and not replay.differences


def test_a_bug_while_recording_is_named_and_not_taken_for_a_full_disk(tmp_path: Path) -> None:
    full = could_not_record(tmp_path, OSError(28, "No space left on device"))
    assert "free disk space" in full.remedy
    bug = could_not_record(tmp_path, KeyError("/unknown"))
    assert "KeyError: '/unknown'" in bug.message and "a bug" in bug.remedy
