"""The force limit from first to last contact, for objects of unexpected width or lost objects."""

import msgspec
import pytest

from drivers.errors import ConfigError
from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftResult
from scenarios.trial.execution import make_guard
from tests.unit.scenarios.conftest import (
    HAND_ALONE,
    InPhase,
    Staged,
    by_default,
    config,
    in_phase,
    judged,
)
from tests.unit.scenarios.lift import device_faults as fault

OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")
BOUND_N = 11.0  # limit and stated overshoot


def lifted(name: str, wider_m: float, *assignments: str, seed: int = 0) -> LiftResult:
    half_m = config(object_name=name).object.half_width_m + wider_m
    return judged(f"object.half_width_m={half_m}", *assignments, seed=seed, object_name=name)


@pytest.mark.parametrize("name", OBJECTS)
def test_no_finger_exceeds_the_limit_on_an_object_of_unexpected_width(name: str) -> None:
    for wider_mm in (0.0, 5.0, 8.0, *([] if name in ("ball", "football") else [15.0])):
        result = lifted(name, wider_mm * 1e-3)
        assert result.peak_force_n is not None  # also when the run ends in a fault
        assert max(result.peak_force_n.values()) <= BOUND_N, wider_mm
        phases = [p.phase for p in result.phases]
        if wider_mm == 0.0:  # gripped by position and lifted
            assert "fault" not in phases
            assert phases[4:7] == ["grasp.settle", "grasp.baseline", "lift"]
        elif name not in ("foam", "football"):  # a soft one is gripped harder, and lifted
            assert "wider than its file says" in result.phases[-1].cause
    if name != "foam":
        missed = lifted(name, -2e-3)
        assert [p.phase for p in missed.phases][-2:] == [
            "grasp.baseline",
            "fault",
        ]  # before the arm lifts
        assert "no contact" in missed.phases[-1].cause


def wide_box(counts: str) -> LiftResult:
    """Lift of a box 140 mm wide, nearly as wide as the open hand."""
    settings = ("object.half_width_m=0.07", f"object.grip_counts={counts}")
    result = lift.run(by_default(*settings, object_name="box"), 910007, None).result
    assert result is not None
    assert result.peak_force_n is not None
    assert max(result.peak_force_n.values()) <= BOUND_N
    assert "finger C bears nothing" in [p.cause for p in result.phases]
    return result


@pytest.mark.parametrize("counts", ["[10,10,10]", "[11,11,9]"])
def test_box_that_two_fingers_grip_is_held_by_three(counts: str) -> None:
    """Finger C first bears nothing; the box would slide by more than 10 cm and go unnoticed."""
    result = wide_box(counts)
    assert result.outcome == "held_within_6cm"
    assert result.slip_distance_m is not None
    assert result.slip_distance_m < 0.01


def test_box_that_two_fingers_grip_is_not_lifted_if_the_third_is_far_away() -> None:
    result = wide_box("[11,11,5]")
    assert [p.phase for p in result.phases][-2:] == ["grasp.settle", "fault"]
    assert "finger C bears nothing: its fingertip shows 0.0" in result.phases[-1].cause
    assert result.end is not None
    assert not result.end.open  # although the counts are those of an open hand
    assert result.end.hand.startswith("the hand is closed with its previous grip, at (11, 11, 10)")


@pytest.mark.parametrize(("mode", "end"), [("stop", "fault"), ("report", "done.set_down")])
def test_hand_does_not_close_further_for_a_dead_fingertip(mode: str, end: str) -> None:
    staged = Staged(f'monitors.mode="{mode}"', made=by_default)
    staged.run(in_phase(State.TARE, 0), fault.freeze_finger_c)
    log = staged.ticks[-1].decision.state, [t.observation.gripper.requested for t in staged.ticks]
    assert log[0] == end
    assert max(c for _, _, c in log[1]) == staged.config.object.grip_counts[2]


def test_thumb_bears_the_force_of_two_motors_in_mode_each_motor() -> None:
    """Its overshoot is that of two motors too."""
    each = ('guard.limit_mode="each_motor"', "hand.debounce_s=0.001")
    result = lifted("cardboard", -0.24e-3, *each, seed=24)
    assert result.peak_force_n is not None
    thumb_n, *others_n = result.peak_force_n.values()
    assert max(others_n) <= BOUND_N
    assert BOUND_N < thumb_n <= 2 * BOUND_N


SLIPPERY = ("object.friction_static=0.25", "object.friction_kinetic=0.2")


def test_closed_empty_hand_is_not_lowered_onto_the_lost_object() -> None:
    result = judged(*SLIPPERY, HAND_ALONE, object_name="ball")
    assert result.phases[-1].phase == "lost"
    assert result.outcome in ("dropped", "expelled")
    assert result.peak_force_n is not None
    assert max(result.peak_force_n.values()) <= BOUND_N


# The object falls out of a weak grip during a slow closing and is gripped again higher up.
LATE = (
    ("ball", 34, ("loop.decision_delay_s=0.3", "variation.command_latency_s=0.1",
                  "controller.lift_height_m=0.03")),
    ("football", 0, ("hand.command_latency_s=0.15", "controller.lift_height_m=0.1",
                     "energy.threshold_counts=400")),
)  # fmt: skip


@pytest.mark.parametrize(("name", "seed", "settings"), LATE)
def test_hand_that_gripped_a_fallen_object_again_is_not_lowered(
    name: str, seed: int, settings: tuple[str, ...]
) -> None:
    result = lifted(name, 0.0, *settings, seed=seed)
    assert result.phases[-1].phase == "lost"
    assert "no contact for" in result.phases[-1].cause
    assert result.peak_force_n is not None
    assert max(result.peak_force_n.values()) <= BOUND_N


@pytest.mark.parametrize("phase", [State.LIFT, State.HOLD, State.DESCEND])
def test_object_that_vanishes_stops_the_arm_where_it_is(phase: State) -> None:
    staged = Staged()
    trial = staged.run(in_phase(phase, 3), fault.take_object_away)
    assert trial.controller.state is State.LOST
    assert not staged.ticks[-1].arm.moving
    assert trial.controller.unconfirmed == ()
    lost_ns = trial.controller.machine.log[-1].t_ns
    closing_ns = 3_500_000_000  # a thumb that has a long way to close
    assert staged.done_at_ns is not None
    assert lost_ns - staged.done_at_ns < closing_ns
    on_hardware = msgspec.structs.replace(trial, final=None)  # no truth tells
    on_hardware.trace.end = None
    assert lift.judge(staged.config, 0, on_hardware, None).outcome == "dropped"


@pytest.mark.parametrize("broken", [fault.stick_one_taxel_at_the_rail, fault.freeze_taxels(3)])
def test_loss_of_the_object_is_detected_with_taxels_that_still_report_contact(
    broken: fault.Act,
) -> None:
    for phase in (State.HOLD, State.DESCEND):
        staged, gone = Staged(), in_phase(phase, 3)

        def take_away(tick: Tick, staged: Staged = staged, gone: InPhase = gone) -> None:
            if gone(tick) and gone.ticks == 4:
                fault.take_object_away(staged.rig)

        staged.on_tick = take_away
        trial = staged.run(in_phase(State.LIFT, 20), broken)
        assert trial.controller.state is State.LOST
        assert max(staged.ticks[-1].estimated_n) > 0.5
        end = trial.end(staged.config)
        assert end is not None and "without measured contact" in end.hand


REFUSED = [
    (("guard.overshoot_n=0.1",), "overshoot_n"),
    (("hand.override_s=0.05", "controller.slip_response=stop_and_step"), "override_s"),
    (("controller.lift_speed_mps=0.006",), "lift_speed_mps"),
    (("controller.lower_speed_mps=0.006",), "lower_speed_mps"),
    (
        (
            "controller.slip_stop_mps2=0.1",
            "controller.lift_height_m=0.21",
            "controller.lower_speed_mps=0.1",
            "controller.phase_timeout_s=3",
        ),
        "lift_speed_mps",
    ),
    (("controller.lower_speed_mps=0.26",), "lower_speed_mps"),
    (("controller.lift_speed_mps=0.2", "arm.max_speed_mps=0.15"), "lift_speed_mps"),
    (("controller.lift_acceleration_mps2=1.3",), "lift_acceleration_mps2"),
    (("controller.stop_deceleration_mps2=1.3",), "stop_deceleration_mps2"),
    (("arm.max_stop_mps2=7.9",), "slip_stop_mps2"),
    (
        (
            "controller.feel_speed_mps=0.1",
            "controller.lift_speed_mps=0.05",
            "arm.max_speed_mps=0.09",
        ),
        "feel_speed_mps",
    ),
    (("controller.lift_height_m=0.51",), "lift_height_m"),
    (("controller.lift_height_m=0.3", "arm.max_jump_m=0.29"), "lift_height_m"),
    (("controller.lift_height_m=0.5", "controller.slip_stop_mps2=0.4"), "slip_stop_mps2"),
    (("controller.lift_height_m=0.46",), "retreat_m"),
    (("arm.workspace_low_m=[0.2,-0.5,0.1]",), "workspace_low_m"),
    (("arm.workspace_low_m=[-0.1,-0.1,0.001]",), "workspace_low_m"),
    (("arm.workspace_high_m=[0.1,-0.01,0.5]",), "workspace_high_m"),
    (("arm.max_stop_mps2=0.9", "controller.slip_stop_mps2=0.9"), "stop_deceleration_mps2"),
]


def test_infeasible_settings_are_refused_before_anything_moves() -> None:
    for assignments, key in REFUSED:
        with pytest.raises(ConfigError) as caught:
            make_guard(config(*assignments))
        assert caught.value.key == key, assignments


def test_first_grasp_that_is_too_fast_for_the_limit_is_refused() -> None:
    with pytest.raises(ConfigError, match="wider than expected") as refused:
        make_guard(config("controller.grip_speed_mps=0.064"))
    assert refused.value.remedy.endswith("<= 0.063, or a guard.overshoot_n that allows it")


@pytest.mark.parametrize("name", ["cardboard", "ball"])
def test_fastest_allowed_first_grasp_keeps_the_limit(name: str) -> None:
    result = lifted(name, 7.8e-3, "controller.grip_speed_mps=0.063")
    assert result.peak_force_n is not None
    assert max(result.peak_force_n.values()) <= BOUND_N
