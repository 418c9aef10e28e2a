"""An exception of our own code ends a run as a fault does, wherever it is raised."""

import json
import signal
from asyncio import CancelledError
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from detector.energy import EnergyDetector
from drivers.errors import LinkLost, Refused
from drivers.robotiq.pumped import PumpedHand
from grasp.cli.live import Display
from grasp.cli.main import main
from grasp.closing import Closing
from grasp.commands import MoveArm, StopArm
from grasp.controller import GraspController
from grasp.doubt import Doubts
from grasp.guard import ForceGuard
from grasp.interruption import Interruption
from grasp.loop import Tick
from grasp.phases import AIRBORNE_PHASES, Phase
from grasp.recording import RunRecorder
from grasp.safe_state import SafeState
from scenarios.campaign.spec import Task
from scenarios.campaign.worker import run_trial as run_task
from scenarios.tap import tap
from scenarios.trial.replay import replay_run
from scenarios.trial.trace import Trace
from scenarios.world.cell import SimulatedCell
from tests.unit.scenarios.conftest import Staged, config, in_phase
from tests.unit.scenarios.lift import device_faults as fault
from tests.unit.scenarios.trial.test_stopped import QUICK, tap_config

TEXT = "planted"
PLACES: dict[str, tuple[type, str]] = {
    "controller": (GraspController, "step"),
    "doubts": (Doubts, "of"),
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
    """From when the result is called on, the method raises, whenever it is called."""
    whole = getattr(owner, name)
    planted: list[bool] = []

    def broken(self: Any, *args: Any, **more: Any) -> Any:
        if planted:
            raise error(TEXT)
        return whole(self, *args, **more)

    patch.setattr(owner, name, broken)
    return lambda: planted.append(True)


def staged(
    patch: pytest.MonkeyPatch, place: str, phase: Phase
) -> tuple[Staged, Any, SimulatedCell]:
    begin = plant(patch, *PLACES[place])
    lift = Staged(*QUICK)
    trial = lift.run(in_phase(phase, 5), lambda rig: begin())
    patch.undo()
    cell = fault.cell(lift.rig)
    cell.advance(cell.truth().t_ns + 1_000_000_000)
    return lift, trial, cell


CASES = [
    (place, phase)
    for place in PLACES
    for phase in (Phase.APPROACH, Phase.GRASP, Phase.LIFT, Phase.HOLD)
    # without a folder there is no recorder; in a hold nobody asks the guard
    if place != "recorder" and (place, phase) != ("guard", Phase.HOLD)
]


@pytest.mark.parametrize(("place", "phase"), CASES)
def test_exception_of_ours_leaves_a_standing_arm_and_a_hand_that_holds(
    place: str, phase: Phase, monkeypatch: pytest.MonkeyPatch
) -> None:
    lift, trial, cell = staged(monkeypatch, place, phase)
    result = lift.result(trial)
    assert (result.outcome, result.success) == ("internal_error", None)
    assert result.bug is not None
    assert (result.bug.name, result.bug.text) == ("ZeroDivisionError", TEXT)
    assert "Traceback" in result.bug.traceback
    assert result.end is not None and result.end.arm == "the arm stands"
    if place != "guard":  # without it nothing may close
        assert result.end.unreached == ()
    truth = cell.truth()
    assert cell.arm.velocity(truth.t_ns) == (0.0, 0.0, 0.0)
    assert max(truth.peak_n) < 11.0
    if phase in AIRBORNE_PHASES and place != "guard":  # without it nothing may close
        assert truth.normal_n[0] > 8.0
    elif phase in AIRBORNE_PHASES:
        assert truth.touched
    failure = trial.failure(lift.config)
    assert failure is not None and failure.kind == "internal"
    assert failure.message.startswith("internal_error: ZeroDivisionError: planted (File ")
    assert failure.end == result.end
    raised_ns = lift.ticks[-1].t_ns if place == "guard" else lift.done_at_ns  # asked later on
    sent = [i.admitted for t in lift.ticks for i in t.issued if i.decided_ns > raised_ns]  # type: ignore[operator]
    assert not any(isinstance(c, MoveArm) for c in sent)


def test_a_library_that_ends_the_program_ends_the_run_as_a_fault_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begin = plant(monkeypatch, GraspController, "step", SystemExit)
    lift = Staged(*QUICK)
    trial = lift.run(in_phase(Phase.LIFT, 5), lambda rig: begin())
    monkeypatch.undo()
    result = lift.result(trial)
    assert result.outcome == "internal_error" and result.bug is not None
    assert result.bug.name == "SystemExit"
    assert result.end is not None and result.end.arm == "the arm stands"


def refuse_once(patch: pytest.MonkeyPatch, rig: Any, refused: list[bool]) -> None:
    """The next closing is refused, and noted."""
    close = rig.devices.gripper.close_fast

    def refuses_once(*asked: Any) -> Any:
        if not refused:
            refused.append(True)
            raise Refused("busy", "wait")
        return close(*asked)

    patch.setattr(type(rig.devices.gripper), "close_fast", lambda _, *a: refuses_once(*a))


def test_a_hand_that_refuses_once_is_told_again_where_no_step_can_be_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begin = plant(monkeypatch, GraspController, "step")
    lift = Staged(*QUICK)
    refused: list[bool] = []

    def act(rig: Any) -> None:
        begin()
        refuse_once(monkeypatch, rig, refused)

    trial = lift.run(in_phase(Phase.LIFT, 5), act)
    result = lift.result(trial)
    assert refused and result.end is not None and result.end.unreached == ()
    assert fault.cell(lift.rig).truth().normal_n[0] > 8.0


@pytest.mark.parametrize("phase", [Phase.LISTEN, Phase.LIFT, Phase.HOLD])
def test_a_hand_that_is_not_heard_any_more_is_not_told_as_safe_where_no_step_can_be_taken(
    phase: Phase, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = plant(monkeypatch, GraspController, "step")
    lift = Staged(*QUICK)

    def lost(*_: Any) -> None:
        raise LinkLost("gone", "look")

    def act(rig: Any) -> None:
        begin()
        monkeypatch.setattr(type(rig.devices.gripper), "pump", lost)

    trial = lift.run(in_phase(phase, 5), act)
    end = lift.result(trial).end
    assert end is not None
    assert any("the hand is not heard" in text for text in end.unreached)


def test_a_device_that_ends_the_program_whenever_it_is_asked_leaves_a_standing_arm_and_a_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    begin = plant(monkeypatch, PumpedHand, "pump", SystemExit)
    in_the_lift(monkeypatch, begin)
    assert main(words(tmp_path)) == 5
    assert "the arm stands; the hand cannot be told anything" in capsys.readouterr().err
    (folder,) = tmp_path.iterdir()
    assert json.loads((folder / "result.json").read_text())["bug"]["name"] == "SystemExit"


def test_a_bug_of_the_fingertips_keeps_no_hand_from_being_told_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lift = Staged(*QUICK, "controller.reactions=false")
    refused: list[bool] = []

    def act(rig: Any) -> None:
        monkeypatch.setattr(type(rig.devices.tactile), "pump", lambda *_: 1 / 0)
        refuse_once(monkeypatch, rig, refused)

    end = lift.result(lift.run(in_phase(Phase.LIFT, 40), act)).end
    assert refused and end is not None and (end.arm, end.unreached) == ("the arm stands", ())
    assert fault.cell(lift.rig).truth().normal_n[0] > 8.0


@pytest.mark.parametrize(("owner", "name"), [(Closing, "slowly"), (SafeState, "of_hand")])
def test_where_the_closing_cannot_be_told_the_arm_is_stopped_and_the_hand_holds(
    owner: type, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    begins = [plant(monkeypatch, GraspController, "step"), plant(monkeypatch, owner, name)]
    lift = Staged(*QUICK)
    result = lift.result(lift.run(in_phase(Phase.LIFT, 5), lambda rig: [b() for b in begins]))
    assert result.end is not None and result.end.arm == "the arm stands"
    cell = fault.cell(lift.rig)
    assert cell.arm.velocity(cell.truth().t_ns) == (0.0, 0.0, 0.0)
    assert cell.truth().touched


def test_a_bug_in_what_keeps_the_verdict_leaves_a_result(monkeypatch: pytest.MonkeyPatch) -> None:
    begin = plant(monkeypatch, Trace, "add")
    lift = Staged(*QUICK)
    result = lift.result(lift.run(in_phase(Phase.LIFT, 5), lambda rig: begin()))
    assert result.outcome == "internal_error" and result.end is not None
    assert result.end.arm == "the arm stands"
    assert fault.cell(lift.rig).truth().normal_n[0] > 8.0


def test_a_bug_once_all_is_over_asks_for_nothing_and_misses_nothing() -> None:
    def act(rig: Any) -> None:
        raise ZeroDivisionError(TEXT)

    lift = Staged(*QUICK, "controller.reactions=false", "controller.keep=true")
    result = lift.result(lift.run(in_phase(Phase.KEPT, 0), act))
    assert result.outcome == "internal_error" and result.end is not None
    assert result.end.unreached == ()


@pytest.mark.parametrize(
    ("text", "told"), [("caf\udce9", "caf\\udce9"), ("x; arm_jump: y", "x, arm_jump: y")]
)
def test_what_an_exception_says_is_told_in_one_cause_and_in_utf_8(
    text: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def begin() -> None:
        raise ValueError(text)

    in_the_lift(monkeypatch, begin)
    assert main(words(tmp_path)) == 5
    assert f"internal_error: ValueError: {told}" in capsys.readouterr().err
    (folder,) = tmp_path.iterdir()
    end = json.loads((folder / "result.json").read_text())["end"]
    assert (end["arm"], end["unreached"]) == ("the arm stands", [])


def in_the_lift(patch: pytest.MonkeyPatch, act: Callable[[], None]) -> None:
    """Call it in each step of the controller from then on."""
    inner = GraspController.step

    def step(self: GraspController, seen: Any) -> Any:
        decision = inner(self, seen)
        if self.phase is Phase.LIFT:
            act()
        return decision

    patch.setattr(GraspController, "step", step)


class Unspeakable(Exception):
    """One whose own text raises."""

    def __str__(self) -> str:
        raise self


def test_an_exception_whose_text_raises_leaves_a_standing_arm_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begin = plant(monkeypatch, GraspController, "step", Unspeakable)
    lift = Staged(*QUICK)
    result = lift.result(lift.run(in_phase(Phase.LIFT, 5), lambda rig: begin()))
    assert result.bug is not None and result.bug.name == "Unspeakable"
    assert result.end is not None and result.end.arm == "the arm stands"
    assert fault.cell(lift.rig).truth().normal_n[0] > 8.0


def bug_after(begin: Callable[[], None]) -> Callable[[Any], None]:
    def act(rig: Any) -> None:
        begin()
        raise ZeroDivisionError(TEXT)

    return act


def test_ctrl_c_while_the_safe_state_of_a_bug_is_pursued_leaves_a_standing_arm(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begin = plant(monkeypatch, GraspController, "step", KeyboardInterrupt)
    lift = Staged(*QUICK)
    with pytest.raises(KeyboardInterrupt):
        lift.run(in_phase(Phase.LIFT, 5), bug_after(begin))
    cell = fault.cell(lift.rig)
    assert cell.arm.velocity(cell.truth().t_ns) == (0.0, 0.0, 0.0)
    assert cell.truth().normal_n[0] > 8.0


class Cut(Interruption):
    def __init__(self, _: str) -> None:
        super().__init__(signal.SIGINT)


def test_what_hangs_while_the_safe_state_is_pursued_and_is_cut_leaves_a_result(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begin = plant(monkeypatch, GraspController, "step", Cut)
    lift = Staged(*QUICK)
    result = lift.result(lift.run(in_phase(Phase.LIFT, 5), bug_after(begin)))
    assert result.bug is not None and result.bug.name == "ZeroDivisionError"
    assert result.end is not None and result.end.arm == "the arm stands"


def words(runs: Path, *more: str) -> list[str]:
    settings = [word for text in QUICK for word in ("--set", text)]
    return ["run", "lift", "--rig", "simulated", "--detector", "energy", "--runs", str(runs),
            *settings, *more]  # fmt: skip


@pytest.mark.parametrize(
    ("owner", "name"), [*PLACES.values(), (Display, "tick")], ids=[*PLACES, "onlooker"]
)
def test_command_ends_with_what_happened_how_it_was_left_and_a_result(
    owner: type, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    begin = plant(monkeypatch, owner, name)
    inner = GraspController.step

    def step(self: GraspController, seen: Any) -> Any:
        decision = inner(self, seen)
        if self.phase is Phase.HOLD:
            begin()
        return decision

    monkeypatch.setattr(GraspController, "step", step)
    assert main(words(tmp_path)) == 5
    said = capsys.readouterr()
    *_, first, left, remedy = said.err.strip().splitlines()
    assert "internal_error: ZeroDivisionError: planted" in first and "report it" in remedy
    assert "the arm stands; the hand is closed" in left
    assert "NOT JUDGED: internal error" in said.out
    (folder,) = tmp_path.iterdir()
    result = json.loads((folder / "result.json").read_text())
    assert result["outcome"] == "internal_error"
    assert result["bug"]["name"] == "ZeroDivisionError"
    assert result["end"]["arm"] == "the arm stands"
    assert main(["runs", "--runs", str(tmp_path)]) == 0
    assert "internal_error" in capsys.readouterr().out


def test_exception_of_a_detector_whose_text_raises_is_a_fault_as_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(*_: Any) -> None:
        raise Unspeakable

    monkeypatch.setattr(EnergyDetector, "update", fails)
    assert main(words(tmp_path)) == 4
    assert "detector_failed: Unspeakable: its text raises too" in capsys.readouterr().err


@pytest.mark.parametrize("bug", [ZeroDivisionError, SystemExit, CancelledError])
def test_exception_of_a_detector_is_a_fault_of_its_own(
    bug: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def fails(*_: Any) -> None:
        raise bug

    monkeypatch.setattr(EnergyDetector, "update", fails)
    assert main(words(tmp_path)) == 4
    assert f"detector_failed: {bug.__name__}" in capsys.readouterr().err


def test_recording_of_a_run_that_an_onlooker_ended_is_replayed_to_its_safe_state(
    tmp_path: Path,
) -> None:
    from scenarios.lift import lift

    def on_tick(tick: Tick) -> None:
        if tick.decision.phase is Phase.LIFT:
            raise LookupError("no screen")

    finished = lift.run(config(*QUICK), 0, tmp_path, on_tick=on_tick)
    assert finished.result is not None and finished.result.outcome == "internal_error"
    assert [p.phase for p in finished.result.phases][-2:] == ["lift", "fault"]
    (folder,) = tmp_path.iterdir()
    replay = replay_run(folder)
    assert replay.complete and not replay.differences


def test_exception_in_a_tap_is_no_verdict() -> None:
    def on_tick(tick: Tick) -> None:
        if tick.decision.phase is Phase.HOLD:
            raise LookupError("no screen")

    finished = tap.run(tap_config(), 0, None, on_tick=on_tick)
    assert finished.result is not None
    assert (finished.result.outcome, finished.result.success) == ("internal_error", None)
    assert finished.result.moved is None


def test_trial_of_a_campaign_that_our_own_code_ended_is_an_error_to_be_run_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plant(monkeypatch, SimulatedCell, "truth")()
    task = Task(
        number=0, scenario="lift", repetition=0, seed=0, swept={}, config=config(*QUICK),
        recordings="none",
    )  # fmt: skip
    row = run_task(task).row
    assert row.status == "error"
    assert row.error is not None and "ZeroDivisionError: planted" in row.error


def test_stop_is_sent_although_no_step_can_be_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    lift, trial, _ = staged(monkeypatch, "controller", Phase.LIFT)
    assert trial.trace.last is not lift.ticks[-1]  # as the devices were afterwards
    assert any(isinstance(i.admitted, StopArm) for i in trial.trace.last.issued)
