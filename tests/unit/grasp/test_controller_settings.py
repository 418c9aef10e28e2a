"""Settings of the controller: defaults, and settings that a slip response does not use."""

import msgspec

from grasp.control.controller_settings import ControllerSettings


def test_defaults_match_the_published_results() -> None:
    assert msgspec.structs.asdict(ControllerSettings()) == {
        "first_grasp": None, "first_force_n": 2.0,
        "approach_speed_mps": 0.11,
        "grip_speed_mps": 0.022, "grip_force_n": 10.0, "closing_speed_mps": 0.11,
        "closing": "two_stage", "settle_s": 0.3, "baseline_s": 0.3,
        "lift_height_m": 0.2, "lift_speed_mps": 0.1, "lift_acceleration_mps2": 0.5,
        "slip_response": "stop_and_close", "margin_steps": 2, "slip_stop_mps2": 8.0,
        "lower_speed_mps": 0.05, "feel_speed_mps": 0.005, "retreat_m": 0.05,
        "stop_deceleration_mps2": 1.0, "hold_s": 1.0, "limit_patience_s": 0.3,
        "hold_by_clock": False, "contact_n": 0.3, "stale_after_s": 0.1, "phase_timeout_s": 30.0,
        "keep": False, "firm": False, "reactions": True,
    }  # fmt: skip
