"""Lifts whose first grasp is by touch, of objects of which the application knows nothing."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from drivers.errors import ConfigError
from scenarios.campaign.config import load_config, load_lift
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftResult
from scenarios.trial.experiment import TrialContext
from scenarios.trial.feasibility import check_touch
from scenarios.trial.replay import replay_run
from scenarios.trial.series import run_series

BOUND_N = 11.0  # limit and stated overshoot
TOUCH = ("controller.first_grasp=touch", "controller.lift_height_m=0.05", "hand.activation_s=0.1")


def lifted(name: str, *settings: str, seed: int = 0) -> LiftResult:
    config = load_config(name, "simulated", None, None, (*TOUCH, *settings)).for_lift()
    result = lift.run(config, seed, None).result
    assert result is not None and result.peak_force_n is not None
    return result


def peak_n(result: LiftResult) -> float:
    assert result.peak_force_n is not None
    return max(result.peak_force_n.values())


@pytest.mark.parametrize(
    ("name", "wider_mm"),
    [("can", -15), ("can", 15), ("box", 8), ("foam", -9), ("ball", 9), ("football", -4)],
)
def test_object_of_another_width_than_stated_is_held_within_the_limit(
    name: str, wider_mm: float
) -> None:
    result = lifted(name, f"variation.width_error_m={wider_mm * 1e-3}")
    assert result.success and peak_n(result) <= BOUND_N
    body = load_config(name, "simulated").object
    assert result.grip is not None
    assert result.grip.stiffness_measured or name != "foam"  # others saturate taxels
    assert result.grip.width_m == pytest.approx(
        2 * (body.half_width_m + wider_mm * 1e-3), abs=0.004
    )


def test_real_fingertips_need_the_counts_per_newton_of_each() -> None:
    """The emulated and simulated ones are alike."""
    config = load_config("can", "simulated", None, None, TOUCH)
    check_touch(config)
    real = msgspec.structs.replace(config, rig="hardware")
    with pytest.raises(ConfigError, match="`grasp calibrate force`"):
        check_touch(real)
    each = msgspec.structs.replace(config.guard, counts_per_newton=(150.0, 160.0, 170.0))
    check_touch(msgspec.structs.replace(real, guard=each))
    by_counts = msgspec.structs.replace(config.controller, first_grasp="counts")
    check_touch(msgspec.structs.replace(real, controller=by_counts))


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_object_that_the_table_holds_is_gripped_where_it_stands(friction: float) -> None:
    for name in ("can", "foam"):
        result = lifted(name, f"contact.table_friction={friction}")
        assert result.success and peak_n(result) <= BOUND_N
        assert result.grip is not None and abs(result.grip.nearer_thumb_m) < 0.004


@pytest.mark.parametrize("told", [(), ('gripper.calibration="manual"',)])
def test_hand_of_the_manual_is_bounded_by_position(told: tuple[str, ...]) -> None:
    strong = ("hand.least_force_n=15", "hand.current_clamp=false", "hand.override_s=0.1")
    result = lifted("can", *strong, *told)
    assert result.success and peak_n(result) <= BOUND_N
    assert result.grip is not None
    assert result.grip.bound == ("travel" if told else "force byte and travel")


def test_first_force_is_the_one_asked_for() -> None:
    forces = [lifted("foam", f"controller.first_force_n={n}") for n in (2.0, 4.0)]
    first_n = [r.grip.first_force_n for r in forces if r.grip is not None]
    assert np.allclose(first_n, (2.0, 4.0), atol=1.0)


def test_nothing_between_the_fingers_is_named_before_the_arm_moves() -> None:
    result = lifted("can", "object.half_width_m=0.005", "object.friction_static=0.1",
                    "object.friction_kinetic=0.1", "damage.taxels_lost=1.0")  # fmt: skip
    assert result.outcome == "fault" and "lift" not in {p.phase for p in result.phases}
    assert result.grip is None


def test_recorded_lift_by_touch_is_replayed_without_a_difference(tmp_path: Path) -> None:
    config = load_config("box", "simulated", None, None, TOUCH).for_lift()
    result = lift.run(config, 1, tmp_path).result
    assert result is not None and result.recording is not None
    assert replay_run(Path(result.recording)).differences == []


def test_lift_on_real_devices_needs_no_object_and_is_by_touch_unless_the_grip_is_strong() -> None:
    unnamed = load_lift(None, "hardware")
    assert unnamed.object.name == "unnamed" and unnamed.object.contact_stiffness_npm is None
    assert load_lift("can", "hardware").object.name == "can"
    assert load_lift(None, "simulated").object.name == "can"
    assert unnamed.controller.first_grasp == "touch"
    for strong in ("controller.firm=true", "guard.limit_mode=each_motor"):
        assert load_lift("can", "simulated", None, None, [strong]).controller.first_grasp is None


def test_fingertips_or_a_hand_that_contradict_their_calibration_are_named() -> None:
    grip = lifted("foam", "variation.width_error_m=0.003").grip
    assert grip is not None and len(grip.lines) == 1
    wrong = msgspec.structs.replace(grip, held_sides_n=(4.3, 2.0))
    assert wrong.lines[1:] == ["A reads 4.3 N, B + C 2.0 N: calibrate each finger"]
    weak = lifted("can", "hand.least_force_n=2.5", seed=1)
    assert weak.outcome == "limit_reached" and weak.grip is not None
    assert "by its calibration 10 N: calibrate hand and fingers" in weak.grip.lines[-1]


def test_every_trial_of_a_series_measures_its_own_grip() -> None:
    config = load_config("can", "simulated", None, None, TOUCH).for_lift()
    results = [done.result for done in run_series(lift, config, (0, 1), TrialContext(None))]
    assert [r is not None and r.success for r in results] == [True, True]


def test_opposing_fingers_that_read_too_little_do_not_close_beyond_the_first_force() -> None:
    result = lifted("football", "controller.first_force_n=4", seed=4)
    assert result.success and peak_n(result) < 6.0


def test_hand_at_its_stop_counts_as_no_closing_of_the_thumb() -> None:
    result = lifted("can", "object.half_width_m=0.068", "object.wall_stiffness_npm=8000")
    assert result.success and peak_n(result) <= BOUND_N
