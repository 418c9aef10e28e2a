"""What devices say and cannot be: a fault with a name, soon, and the safe state of the phase."""

import numpy as np
import pytest

from grasp.commands import MoveArm, MoveFingers, OpenFingers, StopArm
from grasp.loop import Tick
from grasp.phases import AIRBORNE_PHASES, Phase
from scenarios.rigs.rig import Rig
from scenarios.trial.execution import FinishedTrial
from tests.unit.scenarios.conftest import HAND_ALONE, ONE_SPEED, Staged, in_phase, well_in
from tests.unit.scenarios.lift import device_faults as fault
from tests.unit.scenarios.lift.test_faults import silence_fingertips

P = Phase
HELD = (P.LIFT, P.COMPENSATE, P.HOLD, P.LOWER)
ALL = (P.APPROACH, P.GRASP, *HELD)

# what is done, in which phases, the name of the fault, and how many steps later it is there at
# the latest, from when it could be seen: the first frame, or the first command that is ignored
CASES = [
    (fault.freeze_fingertips, (P.GRASP, *HELD), "fingertips_frozen", 13),
    (fault.freeze_thumb, (P.GRASP, P.LIFT, P.HOLD, P.LOWER), "fingertip_dead", 53),
    (fault.fingertips_read(0), (P.GRASP, *HELD), "fingertips_at_rail", 6),
    (fault.fingertips_read(1023), (P.GRASP, *HELD), "fingertips_at_rail", 6),
    (fault.fingertips_read(0, fault.FINGER), (P.GRASP, *HELD), "fingertips_at_rail", 6),
    (fault.shift_fingertips, (P.GRASP, *HELD), "fingertips_jump", 4),
    (fault.replug_fingertips, (P.GRASP, *HELD), "fingertips_absent", 4),
    (fault.freeze_gripper_status, (P.APPROACH, P.GRASP), "gripper_stands", 32),
    (fault.jam_gripper, (P.APPROACH, P.GRASP), "gripper_stands", 32),
    (fault.power_cycle_gripper, ALL, "gripper_inactive", 4),
    (fault.let_thumb_leap, ALL, "gripper_impossible", 3),
    (fault.let_finger_b_leap, ALL, "gripper_impossible", 3),
    (fault.lose_arm_position, ALL, "arm_position_nan", 2),
    (fault.freeze_arm_values, (P.LIFT, P.LOWER), "arm_frozen", 14),
    (fault.freeze_arm_values, (P.COMPENSATE,), "arm_frozen", 120),  # it stands until it goes on
    (fault.push_arm, (P.APPROACH, P.GRASP), "arm_wrong_way", 16),
    (fault.push_arm, (P.LIFT, P.HOLD), "arm_wrong_way", 40),  # it brakes before it turns
    (fault.let_arm_leap, ALL, "arm_jump", 2),
    (fault.stand_still(0.3), ALL, "loop_stood_still", 1),
    (fault.stand_still(3.0), ALL, "loop_stood_still", 1),
]


def told(staged: Staged) -> list[object]:
    assert staged.done_at_ns is not None
    return [c.admitted for t in staged.ticks for c in t.issued if c.decided_ns >= staged.done_at_ns]


def fault_at(staged: Staged) -> int:
    """Index of the step that began the safe state."""
    return next(i for i, t in enumerate(staged.ticks) if t.decision.phase is P.FAULT)


def in_safe_state(staged: Staged, trial: FinishedTrial, name: str) -> None:
    """The name stands first in the cause; the arm stands, nothing is squeezed, nothing falls."""
    assert trial.controller.phase is P.FAULT
    assert trial.controller.fault_cause.startswith(f"{name}: "), trial.controller.fault_cause
    commands = told(staged)
    assert any(isinstance(c, StopArm) for c in commands)
    after = [
        c.admitted for t in staged.ticks[fault_at(staged) :] for c in t.issued
        if c.decided_ns >= staged.ticks[fault_at(staged)].t_ns
    ]  # fmt: skip
    assert not any(isinstance(c, MoveArm) for c in after)
    rig = staged.rig
    assert fault.cell(rig).arm.velocity(rig.clock.now_ns) == (0.0, 0.0, 0.0)
    truth = rig.truth()
    assert truth is not None
    assert max(truth.peak_n) < 11.0


CASE_IDS = [
    pytest.param(act, phase, name, steps, id=f"{act.__name__}-{phase.value}")
    for act, phases, name, steps in CASES
    for phase in phases
]


@pytest.mark.parametrize(("act", "phase", "name", "steps"), CASE_IDS)
def test_what_cannot_be_is_a_named_fault_soon_and_the_safe_state_follows(
    act: fault.Act, phase: Phase, name: str, steps: int
) -> None:
    staged = Staged()
    trial = staged.run(well_in(phase), act)
    in_safe_state(staged, trial, name)
    done = next(i for i, t in enumerate(staged.ticks) if t.t_ns == staged.done_at_ns)
    assert fault_at(staged) - done <= steps
    before = staged.ticks[fault_at(staged) - 1].decision.phase
    truth = staged.rig.truth()
    assert truth is not None
    lost = act.__name__ == "stand_still_3_s" and phase in (P.LIFT, P.COMPENSATE)  # meanwhile
    if before in AIRBORNE_PHASES and not name.startswith("gripper") and not lost:
        assert truth.normal_n[0] > 8.0  # closed to the limit, not left at 2.4 N
    if before in (P.GRASP, P.APPROACH):
        assert max(truth.normal_n) < 4.0  # stays as it is


def test_hand_that_says_contact_while_it_closes_is_a_named_fault() -> None:
    """Further than doubt.contact_counts, which a first stage by position need not be."""
    staged = Staged(HAND_ALONE, ONE_SPEED)
    trial = staged.run(well_in(P.COMPENSATE), fault.always_contact)
    in_safe_state(staged, trial, "gripper_impossible")


@pytest.mark.parametrize("phase", [P.OPPOSE, P.COMPENSATE, P.RELEASE])
def test_hand_that_loses_power_on_the_tick_of_a_command_is_not_activated_by_it(
    phase: Phase,
) -> None:
    staged, stood = Staged(), list[float]()

    def act(rig: Rig) -> None:
        fault.power_cycle_gripper(rig)
        stood.extend(fault.cell(rig).gripper.travel_m.tolist())

    trial = staged.run(in_phase(phase, 0), act)
    in_safe_state(staged, trial, "gripper_inactive")
    assert not fault.cell(staged.rig).gripper.moving
    assert fault.cell(staged.rig).gripper.travel_m.tolist() == stood  # no grip is loosened
    end = trial.end(staged.config)
    assert end is not None
    assert "the hand is not activated" in end.hand
    assert "moving" not in end.hand and "closed to the limit" not in end.hand


@pytest.mark.parametrize("phase", [P.APPROACH, P.OPPOSE, P.LISTEN, P.COMPENSATE, P.RELEASE])
@pytest.mark.parametrize("frozen_first", [True, False])
def test_hand_that_loses_power_behind_a_status_that_stands_still_is_not_activated_either(
    phase: Phase, frozen_first: bool
) -> None:
    """Whatever is asked of it then, and asked again, leaves rACT out."""
    staged = Staged()

    def act(rig: Rig) -> None:
        if not frozen_first:
            fault.power_cycle_gripper(rig)
        fault.freeze_gripper_status(rig)
        fault.power_cycle_gripper(rig)

    trial = staged.run(in_phase(phase, 3), act)
    assert trial.controller.phase is P.FAULT
    truth = staged.rig.truth()
    assert truth is not None and max(truth.peak_n) < 11.0
    assert not fault.cell(staged.rig).gripper.ready
    assert not fault.cell(staged.rig).gripper.moving


DETECTORS = {
    "nan": np.full(3, np.nan),
    "nan_of_one_finger": np.array([np.nan, 0.0, 0.0]),
    "infinity": np.array([0.0, np.inf, 0.0]),
    "beyond_one": np.array([0.0, 1.5, 0.0]),
    "wrong_shape": np.zeros((3, 1)),
    "one_number": 0.5,
    "nothing": None,
}


@pytest.mark.parametrize("phase", [P.GRASP, P.LIFT, P.COMPENSATE, P.HOLD])
@pytest.mark.parametrize("answer", DETECTORS)
def test_a_detector_that_answers_nonsense_is_a_fault_and_the_hand_closes_to_the_limit_in_the_air(
    answer: str, phase: Phase, monkeypatch: pytest.MonkeyPatch
) -> None:
    staged = Staged()
    trial = staged.run(in_phase(phase, 5), fault.answering(monkeypatch, DETECTORS[answer]))
    in_safe_state(staged, trial, "detector_failed")
    truth = staged.rig.truth()
    assert truth is not None
    assert (truth.normal_n[0] > 8.0) == (phase in AIRBORNE_PHASES)


@pytest.mark.parametrize("phase", [P.LIFT, P.COMPENSATE, P.HOLD])
def test_a_detector_that_cannot_forget_what_it_heard_before_the_board_fell_silent_is_a_fault(
    phase: Phase, monkeypatch: pytest.MonkeyPatch
) -> None:
    staged = Staged()

    def both(rig: Rig) -> None:
        fault.unforgetting(monkeypatch)(rig)
        silence_fingertips(rig)

    trial = staged.run(in_phase(phase, 5), both)
    in_safe_state(staged, trial, "detector_failed")
    assert staged.result(trial).outcome == "fault"
    truth = staged.rig.truth()
    assert truth is not None and truth.normal_n[0] > 8.0


def test_a_detector_that_raises_is_a_fault_and_the_hand_closes_to_the_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    staged = Staged()
    trial = staged.run(in_phase(P.LIFT, 5), fault.raising(monkeypatch))
    in_safe_state(staged, trial, "detector_failed")
    assert "MemoryError" in trial.controller.fault_cause
    truth = staged.rig.truth()
    assert truth is not None and truth.normal_n[0] > 8.0


def test_a_detector_that_takes_too_long_is_a_fault_in_the_step_after(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    staged = Staged()
    trial = staged.run(in_phase(P.LIFT, 5), fault.taking(monkeypatch, 0.12))
    in_safe_state(staged, trial, "detector_late")


@pytest.mark.parametrize(
    ("phase", "act"),
    [(P.APPROACH, fault.swallow_writes), (P.LIFT, fault.swallow_writes),
     (P.HOLD, fault.swallow_writes), (P.LIFT, fault.freeze_gripper_status),
     (P.HOLD, fault.freeze_gripper_status)],
)  # fmt: skip
def test_a_gripper_that_does_not_answer_a_command_is_a_fault_within_its_deadline(
    phase: Phase, act: fault.Act
) -> None:
    staged = Staged()
    trial = staged.run(well_in(phase), act)
    in_safe_state(staged, trial, "gripper_silent")
    first = next(
        t.t_ns for t in staged.ticks if not t.gripper.fresh and t.t_ns > (staged.done_at_ns or 0)
    )
    assert staged.ticks[fault_at(staged)].t_ns - first <= 0.25e9


def test_an_arm_that_moves_against_its_command_is_stopped_after_millimetres() -> None:
    staged = Staged()
    trial = staged.run(in_phase(P.LISTEN, 5), fault.turn_arm_round)
    in_safe_state(staged, trial, "arm_wrong_way")
    assert abs(staged.ticks[-1].arm.position_m[2] - staged.ticks[0].arm.position_m[2]) < 0.02


def test_one_taxel_at_the_rail_is_no_fault_and_is_reported() -> None:
    staged = Staged()
    trial = staged.run(in_phase(P.LIFT, 5), fault.stick_one_taxel_at_the_rail)
    assert not any(t.observation.doubt for t in staged.ticks)
    at_rail = staged.result(trial).taxels_at_rail
    assert set(at_rail) == {"A", "B", "C"}
    assert 1 <= at_rail["A"] < 6


FURTHER = [
    (fault.lose_arm_position, "arm_position_nan"),
    (fault.let_arm_leap, "arm_jump"),
    (fault.power_cycle_gripper, "gripper_inactive"),
    (fault.let_thumb_leap, "gripper_impossible"),
    (fault.fingertips_read(0), "fingertips_at_rail"),
]


@pytest.mark.parametrize("phase", [P.GRASP, P.LIFT, P.HOLD])
@pytest.mark.parametrize(("act", "name"), FURTHER, ids=[name for _, name in FURTHER])
def test_fault_in_a_safe_state_is_told_and_neither_opens_the_hand_nor_moves_the_arm(
    act: fault.Act, name: str, phase: Phase
) -> None:
    staged = Staged()
    inject = in_phase(phase, 5)

    def both(tick: Tick) -> bool:
        if tick.decision.phase is P.FAULT:
            return True
        if inject(tick):
            staged.rig.cell.board.unplug()  # type: ignore[union-attr]
        return False

    trial = staged.run(both, act)
    assert trial.controller.phase is P.FAULT
    assert "unplugged" in trial.controller.fault_cause
    commands = told(staged)
    assert not any(isinstance(c, MoveArm | MoveFingers | OpenFingers) for c in commands)
    cell = fault.cell(staged.rig)
    now_ns = staged.rig.clock.now_ns
    assert cell.arm.velocity(now_ns) == (0.0, 0.0, 0.0)
    failure = trial.failure(staged.config)
    assert failure is not None and failure.end is not None
    unknown = failure.end.where.endswith("at a height that the arm does not tell")
    assert unknown == (name == "arm_position_nan")
    if trial.controller.further:
        assert trial.controller.further[0].startswith(f"{name}: ")
        assert f"; then {name}: " in failure.message
        assert failure.end.further == tuple(trial.controller.further)
    else:
        assert name.startswith("fingertips")  # nobody hears them any more


QUIET = "fingertip.noise_counts=0.15"  # in the air its codes repeat for a third of a second


def test_a_lift_with_quiet_sensors_is_held() -> None:
    trial = Staged(HAND_ALONE, QUIET).run(lambda tick: False, lambda rig: None)
    assert trial.controller.fault_cause == ""
    assert trial.controller.phase is P.DONE


@pytest.mark.parametrize("act", [fault.freeze_fingertips, fault.freeze_thumb])
@pytest.mark.parametrize("phase", [P.GRASP, P.OPPOSE])
def test_quiet_sensors_that_freeze_in_the_air_are_refused_before_the_arm_lifts(
    act: fault.Act, phase: Phase
) -> None:
    staged = Staged(HAND_ALONE, QUIET)
    trial = staged.run(in_phase(phase, 20), act)
    assert trial.controller.fault_cause.startswith("fingertip")
    assert P.LIFT not in {t.decision.phase for t in staged.ticks}
