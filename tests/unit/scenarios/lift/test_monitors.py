"""Implausible device data: a fault with the right code, in time, and the safe state."""

import pytest

from grasp.control.commands import MoveArm, MoveFingers, OpenFingers, StopArm
from grasp.control.fault import lines
from grasp.control.states import AIRBORNE_STATES, State
from grasp.run.loop import Tick
from scenarios.rigs.rig import Rig
from scenarios.trial.execution import FinishedTrial
from tests.unit.scenarios.conftest import HAND_ALONE, Staged, in_phase, well_in
from tests.unit.scenarios.lift import device_faults as fault

P = State
HELD = (P.LIFT, P.COMPENSATE, P.HOLD, P.DESCEND)
ALL = (P.SHAPE, P.BRACE, *HELD)

# injected fault, phases, code of the expected fault, and the most steps until it is raised, from
# the first frame or ignored command that shows it
CASES = [
    (fault.freeze_fingertips, HELD, "fingertips_frozen", 13),
    (fault.freeze_thumb, (P.LIFT, P.HOLD, P.DESCEND), "fingertip_dead", 35),
    (fault.fingertips_read(0), (P.BRACE, *HELD), "fingertips_at_rail", 6),
    (fault.fingertips_read(1023), (P.BRACE, P.HOLD), "fingertips_at_rail", 6),
    (fault.fingertips_read(0, fault.FINGER), (P.BRACE, P.LIFT), "fingertips_at_rail", 6),
    (fault.shift_fingertips, (P.BRACE, *HELD), "fingertips_jump", 4),
    (fault.replug_fingertips, (P.BRACE, *HELD), "fingertips_absent", 4),
    (fault.freeze_gripper_status, (P.SHAPE, P.BRACE), "gripper_stands", 32),
    (fault.jam_gripper, (P.SHAPE, P.BRACE), "gripper_stands", 32),
    (fault.power_cycle_gripper, ALL, "gripper_inactive", 4),
    (fault.make_thumb_jump, ALL, "gripper_impossible", 3),
    (fault.make_finger_b_jump, (P.BRACE, P.HOLD), "gripper_impossible", 3),
    (fault.lose_arm_position, ALL, "arm_position_nan", 2),
    (fault.freeze_arm_values, (P.LIFT, P.DESCEND), "arm_frozen", 37),
    (fault.freeze_arm_values, (P.COMPENSATE,), "arm_frozen", 140),  # stationary until it resumes
    (fault.push_arm, (P.SHAPE, P.BRACE), "arm_wrong_way", 16),
    (fault.push_arm, (P.LIFT, P.HOLD), "arm_wrong_way", 40),  # it brakes before it turns
    (fault.make_arm_jump, (P.SHAPE, P.BRACE, P.HOLD, P.DESCEND), "arm_wrong_way", 2),
    (
        fault.make_arm_jump,
        (P.LIFT,),
        "arm_wrong_way",
        200,
    ),  # past the top: it jumped along its path
    (fault.pause_loop(0.3), ALL, "loop_stood_still", 1),
    (fault.pause_loop(3.0), (P.LIFT, P.HOLD), "loop_stood_still", 1),
]


def issued_since(staged: Staged, t_ns: int | None) -> list[object]:
    assert t_ns is not None
    return [c.admitted for t in staged.ticks for c in t.issued if c.decided_ns >= t_ns]


def fault_at(staged: Staged) -> int:
    """Index of the step that began the safe state."""
    return next(i for i, t in enumerate(staged.ticks) if t.decision.state is P.FAULT)


def in_safe_state(staged: Staged, trial: FinishedTrial, name: str, case: object = "") -> None:
    """The expected fault ended the run, the arm is stationary, and no force exceeds the limit."""
    assert trial.controller.state is P.FAULT, case
    assert trial.controller.faults[0].code == name, (case, lines(trial.controller.faults))
    assert any(isinstance(c, StopArm) for c in issued_since(staged, staged.done_at_ns)), case
    after = issued_since(staged, staged.ticks[fault_at(staged)].t_ns)
    assert not any(isinstance(c, MoveArm) for c in after), case
    rig = staged.rig
    assert fault.cell(rig).arm.at(rig.clock.now_ns).velocity_mps == (0.0, 0.0, 0.0), case
    assert max(fault.cell(rig).truth().peak_n) < 11.0, case


def thumb_n(staged: Staged) -> float:
    return fault.cell(staged.rig).truth().normal_n[0]


@pytest.mark.parametrize("phase", ALL)
def test_implausible_data_is_a_fault_in_time_and_leads_to_the_safe_state(phase: State) -> None:
    for act, phases, name, steps in CASES:
        if phase not in phases:
            continue
        staged, case = Staged(), (act.__name__, name)
        trial = staged.run(well_in(phase), act)
        in_safe_state(staged, trial, name, case)
        done = next(i for i, t in enumerate(staged.ticks) if t.t_ns == staged.done_at_ns)
        assert fault_at(staged) - done <= steps, case
        before = staged.ticks[fault_at(staged) - 1].decision.state
        lost = act.__name__ == "pause_loop_3_s" and phase is P.LIFT  # during the pause
        if before in AIRBORNE_STATES and not name.startswith("gripper") and not lost:
            assert thumb_n(staged) > 8.0, case  # closed to the limit, not left at 2.4 N
        if before in (P.BRACE, P.SHAPE):
            assert max(fault.cell(staged.rig).truth().normal_n) < 4.0, case  # stays as it is


@pytest.mark.parametrize("phase", [P.CLOSE, P.COMPENSATE, P.OPEN])
def test_command_does_not_activate_a_hand_that_loses_power_at_the_same_time(
    phase: State,
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


@pytest.mark.parametrize(("other", "name"), [(1, "B"), (2, "C")])
def test_a_fingertip_swapped_with_the_thumbs_is_reported(other: int, name: str) -> None:
    trial = Staged().run(in_phase(P.SHAPE), fault.swap_fingertips(0, other))
    (reported,) = trial.trace.reported
    assert (reported.code, reported.data) == ("fingertips_swapped", {"finger": name})
    assert not trial.controller.faults


def test_one_saturated_taxel_is_reported_without_a_fault() -> None:
    staged = Staged()
    trial = staged.run(in_phase(P.LIFT, 5), fault.stick_one_taxel_at_the_rail)
    assert not any(t.observation.faults for t in staged.ticks)
    at_rail = staged.result(trial).taxels_at_rail
    assert set(at_rail) == {"A", "B", "C"}
    assert 1 <= at_rail["A"] < 6


LATER_FAULTS = [
    (fault.lose_arm_position, "arm_position_nan"),
    (fault.make_arm_jump, "arm_wrong_way"),
    (fault.power_cycle_gripper, "gripper_inactive"),
    (fault.make_thumb_jump, "gripper_impossible"),
    (fault.fingertips_read(0), "fingertips_at_rail"),
]


@pytest.mark.parametrize("phase", [P.BRACE, P.HOLD])
def test_later_fault_in_a_safe_state_is_reported_and_moves_neither_hand_nor_arm(
    phase: State,
) -> None:
    for act, name in LATER_FAULTS:
        staged, injected = Staged(), list[int]()

        def then(
            tick: Tick, act: fault.Act = act, staged: Staged = staged,
            injected: list[int] = injected,
        ) -> None:  # fmt: skip
            if tick.decision.state is P.FAULT and not injected:
                injected.append(tick.t_ns)
                act(staged.rig)

        staged.on_tick = then
        trial = staged.run(in_phase(phase, 5), fault.unplug_fingertips)
        assert trial.controller.state is P.FAULT, name
        assert "unplugged" in lines(trial.controller.faults), name
        commands = issued_since(staged, injected[0])
        assert not any(isinstance(c, MoveArm | MoveFingers | OpenFingers) for c in commands), name
        cell = fault.cell(staged.rig)
        assert cell.arm.at(staged.rig.clock.now_ns).velocity_mps == (0.0, 0.0, 0.0), name
        failure = trial.failure(staged.config)
        assert failure is not None and failure.end is not None
        unknown = failure.end.where.endswith("at an unknown height")
        assert unknown == (name == "arm_position_nan")
        later = trial.controller.later_faults
        assert failure.end.later_faults == later
        if name.startswith("fingertips"):  # fingertips are not checked any more
            assert not later
        else:
            assert later[0].code == name
            assert f"; then {name}: " in failure.message


QUIET = "fingertip.noise_counts=0.15"  # in the air its codes repeat for a third of a second


def test_low_noise_fingertips_are_no_fault_and_frozen_ones_prevent_the_lift() -> None:
    staged = Staged(HAND_ALONE, QUIET)
    trial = staged.run(in_phase(P.SET_DOWN), fault.interrupt)
    assert trial.controller.faults == ()
    assert trial.controller.state is P.SET_DOWN
    for phase, act in (
        (P.BRACE, fault.freeze_fingertips), (P.BRACE, fault.freeze_thumb),
        (P.CLOSE, fault.freeze_thumb),
    ):  # fmt: skip
        staged = Staged(HAND_ALONE, QUIET)
        trial = staged.run(in_phase(phase, 20), act)
        assert trial.controller.faults[0].device == "fingertips", (phase, act.__name__)
        assert P.LIFT not in {t.decision.state for t in staged.ticks}, (phase, act.__name__)
