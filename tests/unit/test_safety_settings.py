"""Every setting of safety and verdict takes effect where its name says, at its value.

A setting is moved (a constant of a verdict is not), and the place where behaviour changes must move
with it. One that is wired to the wrong limit, or to none, leaves that place where it was.
"""

import math
from collections.abc import Callable
from typing import Any

import pytest

from scenarios.lift import scoring as lift
from scenarios.lift.scoring import LiftOutcome
from scenarios.tap import scoring as tap
from scenarios.tap.scoring import Alarm, TapOutcome
from scenarios.world.settings import GROSS_SLIP_MPS, GROSS_TURN_RADPS
from tests.unit.detector import safety_probes as on_rule
from tests.unit.drivers import safety_probes as on_driver
from tests.unit.grasp import safety_probes as on_grasp
from tests.unit.scenarios import safety_probes as on_run

SUCCESSES = (LiftOutcome.HELD, LiftOutcome.HELD_WITHIN_6CM, LiftOutcome.HELD_WITHIN_12CM)
REGISTERED = Alarm(10.03, 10.1)
QUIET = (TapOutcome.UNMOVED_QUIET, TapOutcome.UNMOVED_REGISTERED)

# setting, two values of it, what is let pass with such a value, and how far beyond it is not
MOST: list[tuple[str, tuple[Any, ...], Callable[[Any, Any], bool], float]] = [
    ("ArmSettings.max_speed_mps", (0.1, 0.3),
     lambda v, x: on_driver.moves((0, 0, 0.1), speed=x, max_speed_mps=v), 1e-6),
    ("ArmSettings.max_acceleration_mps2", (0.3, 2.0),
     lambda v, x: on_driver.moves((0, 0, 0.1), ramp=x, max_acceleration_mps2=v), 1e-6),
    ("ArmSettings.workspace_high_m", (0.1, 0.4),
     lambda v, x: on_driver.moves_along_any(x, workspace_high_m=(v, v, v)), 1e-3),
    ("ArmSettings.max_jump_m", (0.1, 0.3),
     lambda v, x: on_driver.moves((0, 0, x), max_jump_m=v), 1e-6),
    ("ArmSettings.stale_after_s", (0.05, 0.2), on_driver.trusted, 1e-3),
    ("TakkTileSettings.max_age_ms", (50.0, 100.0), on_driver.still_new, 1.0),
    ("TakkTileSettings.rest_max_std_counts", (1.5, 4.5),
     lambda v, x: on_driver.rest_taken(450, round(x), rest_max_std_counts=v), 0.5),
    ("TakkTileSettings.rest_max_counts", (460, 500),
     lambda v, x: on_driver.rest_taken(x, rest_max_counts=v), 1),
    ("GuardSettings.estimate_margin_n", (2.0, 5.0),
     lambda v, x: on_grasp.admitted(10.0 + x, estimate_margin_n=v) is not None, 0.01),
    ("ControllerSettings.stale_after_s", (0.1, 0.3), on_grasp.both_trusted, 1e-3),
    ("ControllerSettings.contact_n", (0.2, 0.6), lambda v, x: not on_grasp.touches(v, x), 1e-6),
    ("NEAR_M", (lift.NEAR_M,),
     lambda v, x: on_run.lift_verdict({"slip_distance_m": x})
     is LiftOutcome.HELD_WITHIN_6CM, 1e-6),
    ("FAR_M", (lift.FAR_M,),
     lambda v, x: on_run.lift_verdict({"slip_distance_m": x})
     is LiftOutcome.HELD_WITHIN_12CM, 1e-6),
    ("EARLY_S", (lift.EARLY_S,),
     lambda v, x: on_run.lift_verdict({}, registered_s=1.0 - x) in SUCCESSES, 1e-6),
    ("GROSS_SLIP_MPS", (GROSS_SLIP_MPS,),
     lambda v, x: on_run.lift_verdict({"slip_speed_mps": x}) in SUCCESSES, 1e-6),
    ("GROSS_TURN_RADPS", (GROSS_TURN_RADPS,),
     lambda v, x: on_run.lift_verdict({"turn_speed_radps": x}) in SUCCESSES,
     1e-6),
    ("TURNED_RAD", (lift.TURNED_RAD,),
     lambda v, x: on_run.lift_verdict({"turn_rad": -x}) in SUCCESSES, 1e-6),
    ("GraspObject.crush_n", (6.0, 9.0),
     lambda v, x: on_run.lift_verdict({}, crush_n=v, peak_force_n=x) in SUCCESSES, 1e-6),
    ("REGISTER_S", (tap.REGISTER_S,),
     lambda v, x: on_run.tap_verdict([Alarm(10.0 + x, 10.0 + x + 0.01)])
     is TapOutcome.REGISTERED, 1e-6),
    ("CLEAR_S", (tap.CLEAR_S,),
     lambda v, x: on_run.tap_verdict([Alarm(10.03, 10.02 + x)])
     is TapOutcome.REGISTERED, 1e-6),
    ("PressControlSettings.force_n", (3.0, 6.0),
     lambda v, x: on_run.pressing_mps(x, force_n=v) > 0.0, 0.01),
    ("PressControlSettings.depth_m", (0.002, 0.005),
     lambda v, x: on_run.pressing_mps(1.0, x, depth_m=v) > 0.0, 1e-6),
]  # fmt: skip
LEAST: list[tuple[str, tuple[Any, ...], Callable[[Any, Any], bool], float]] = [
    ("ArmSettings.workspace_low_m", (-0.3, -0.1),
     lambda v, x: on_driver.moves_along_any(x, workspace_low_m=(v, v, v)), 1e-3),
    ("TakkTileSettings.rest_min_counts", (410, 430),
     lambda v, x: on_driver.rest_taken(x, rest_min_counts=v), 1),
    ("LEAST_GRIP_N", (lift.LEAST_GRIP_N,),
     lambda v, x: on_run.lift_verdict(None, estimated_n=x) in SUCCESSES, 1e-6),
    ("LIFTED_M", (lift.LIFTED_M,),
     lambda v, x: on_run.lift_verdict({"height_m": x}) in SUCCESSES, 1e-6),
    ("MOVED_M", (tap.MOVED_M,),
     lambda v, x: on_run.tap_verdict([REGISTERED], x) not in QUIET, 1e-6),
    ("MOVED_RAD", (tap.MOVED_RAD,),
     lambda v, x: on_run.tap_verdict([REGISTERED], 0.0, -x) not in QUIET, 1e-6),
    ("STAY_S", (tap.STAY_S,),
     lambda v, x: on_run.tap_verdict([REGISTERED, Alarm(10.1 + x, 20.0)])
     is TapOutcome.REGISTERED, 1e-6),
    ("RuleSettings.threshold", (0.3, 0.8),
     lambda v, x: on_rule.registers([(math.log(x / (1 - x)),)], consecutive=1, threshold=v)[0],
     1e-6),
    ("RuleSettings.drift", (0.5, 2.0),
     lambda v, x: on_rule.summed(x + 1.0, drift=v, limit=1.0), 1e-6),
    ("RuleSettings.limit", (1.0, 5.0), lambda v, x: on_rule.summed(x, limit=v), 1e-6),
]  # fmt: skip

# setting, two values of it, and what of the behaviour must equal it, within a tolerance
OBSERVED: list[tuple[str, tuple[Any, ...], Callable[[Any], Any], float]] = [
    ("DriverSettings.write_interval_s", (0.02, 0.05), on_driver.between_writes_s, 0.0015),
    ("DriverSettings.refresh_hz", (100, 200),
     lambda v: 200 if on_driver.reads_before_a_write(v, 0.007) else 100, 0),
    ("TakkTileSettings.stale_after_missed", (3, 7), on_driver.missed_until_stale, 0),
    ("GuardSettings.force_limit_n", (8.0, 20.0),
     lambda v: on_grasp.admitted(force_limit_n=v).force_limit_n, 0.0),
    ("GuardSettings.overshoot_n", (0.5, 2.0), lambda v: on_grasp.overshoot_n(overshoot_n=v), 1e-9),
    ("GuardSettings.contact_stiffness_npm", (1000.0, 9000.0),
     lambda v: 2500.0 / on_grasp.overshoot_n(contact_stiffness_npm=v) ** 2, 1e-6),
    ("GuardSettings.tip_mass_kg", (0.05, 0.4),
     lambda v: 0.1 / on_grasp.overshoot_n(tip_mass_kg=v) ** 2, 1e-9),
    ("GuardSettings.counts_per_newton", (100.0, 300.0),
     lambda v: 600 / on_grasp.guard(counts_per_newton=v).estimated_n((-600.0, 0.0, 0.0))[0],
     1e-9),
    ("ControllerSettings.approach_speed_mps", (0.05, 0.1),
     lambda v: on_grasp.fingers_moved(0, approach_speed_mps=v).speed_mps, 0.0),
    ("ControllerSettings.grip_speed_mps", (0.03, 0.1),
     lambda v: on_grasp.fingers_moved(1, grip_speed_mps=v).speed_mps, 0.0),
    ("ControllerSettings.grip_force_n", (5.0, 15.0),
     lambda v: on_grasp.fingers_moved(1, grip_force_n=v).force_n, 0.0),
    ("ControllerSettings.settle_s", (0.1, 0.6),
     lambda v: on_grasp.listened_s(settle_s=v)[0], 0.011),
    ("ControllerSettings.baseline_s", (0.1, 0.6),
     lambda v: on_grasp.listened_s(baseline_s=v)[1], 0.011),
    ("ControllerSettings.lift_height_m", (0.1, 0.3),
     lambda v: on_grasp.risen_m(0, lift_height_m=v), 1e-9),
    ("ControllerSettings.lift_speed_mps", (0.07, 0.2),
     lambda v: on_grasp.arm_moved(0, lift_speed_mps=v).speed_mps, 0.0),
    ("ControllerSettings.lift_acceleration_mps2", (0.3, 2.0),
     lambda v: on_grasp.arm_moved(0, lift_acceleration_mps2=v).acceleration_mps2, 0.0),
    ("ControllerSettings.lower_speed_mps", (0.03, 0.2),
     lambda v: on_grasp.arm_moved(1, lower_speed_mps=v).speed_mps, 0.0),
    ("ControllerSettings.retreat_m", (0.02, 0.1), lambda v: on_grasp.risen_m(2, retreat_m=v), 1e-9),
    ("ArmSettings.max_stop_mps2", (0.5, 3.0), on_driver.hardest_stop_mps2, 0.0),
    ("ControllerSettings.stop_deceleration_mps2", (0.5, 3.0), on_grasp.stopped_at_mps2, 0.0),
    ("ControllerSettings.limit_patience_s", (0.2, 0.6), on_grasp.patience_s, 0.011),
    ("ControllerSettings.keep", (False, True), on_grasp.kept, 0),
    ("RuleSettings.kind", ("consecutive", "cusum"),
     lambda v: "cusum" if on_rule.registers([(3.0,)], kind=v, limit=1.0)[0] else "consecutive", 0),
    ("RuleSettings.fusion", ("any", "mean"),
     lambda v: "any" if on_rule.registers([(3.0, -3.0, -3.0)], consecutive=1, fusion=v)[0]
     else "mean", 0),
    ("RuleSettings.consecutive", (2, 5), on_rule.sure_samples, 0),
    ("RuleSettings.release", (1, 6), on_rule.quiet_samples, 0),
    ("GripperCalibration.least_force_n", (2.0, 9.0),
     lambda v: on_driver.calibrated(least_force_n=v).force_n(0), 1e-12),
    ("GripperCalibration.most_force_n", (20.0, 70.0),
     lambda v: on_driver.calibrated(most_force_n=v).force_n(255), 1e-12),
    ("GripperCalibration.force_exponent", (0.5, 2.0), on_driver.exponent_of_force, 1e-9),
    ("GripperCalibration.least_speed_mps", (0.01, 0.05),
     lambda v: on_driver.calibrated(least_speed_mps=v).speed_mps(0), 1e-12),
    ("GripperCalibration.speed_step_mps", (1e-4, 5e-4), on_driver.speed_of_a_count_mps, 1e-9),
]  # fmt: skip


def test_upper_limits_take_effect_at_the_setting() -> None:
    for name, values, passes, beyond in MOST:
        for value in values:
            assert passes(value, value - beyond), name
            assert not passes(value, value + beyond), name


def test_lower_limits_take_effect_at_the_setting() -> None:
    for name, values, passes, beyond in LEAST:
        for value in values:
            assert passes(value, value + beyond), name
            assert not passes(value, value - beyond), name


def test_observed_value_equals_the_setting() -> None:
    for name, values, observed, within in OBSERVED:
        for value in values:
            assert observed(value) == (pytest.approx(value, abs=within) if within else value), name


# what of the behaviour equals a constant, its value, and a tolerance
CONSTANTS: list[tuple[Callable[[], float], float, float]] = [
    (on_grasp.held_under_alarms_s, 2.0, 0.1),
    (on_grasp.seconds_of_overload, 0.03, 0.011),
    (on_grasp.paused_for_nothing_s, 1.5, 0.011),
    (
        lambda: on_grasp.safe_travel_counts(force_limit_n=60.0, overshoot_n=20.0),
        79 // (1.3 * 2.5),
        0,
    ),
    (on_grasp.worst_first_n, 1.0, 0.011),
    (lambda: on_grasp.at_the_top(0.00099), True, 0),
    (lambda: on_grasp.at_the_top(0.00101), False, 0),
]


def test_constants_take_effect_at_their_values() -> None:
    for number, (observed, value, within) in enumerate(CONSTANTS):
        assert observed() == pytest.approx(value, abs=within), number


@pytest.mark.parametrize("gap_s", [0.08, 0.12])
def test_object_without_contact_for_too_long_is_not_set_down(
    gap_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # no response to lost contact
    monkeypatch.setattr("grasp.control.contact_estimator.LOST_NS", 10**9)
    assert on_grasp.lowered_after_gap(gap_s) == (gap_s < 0.1)
