"""Checks of settings against the limits of hand and arm, before any device is used."""

import math

from drivers.errors import ConfigError
from drivers.ur.settings import ArmSettings
from grasp.control.controller_settings import ControllerSettings
from grasp.control.guard import ForceGuard
from grasp.control.slip_response import RESPONSES
from grasp.control.slip_response.stop_and_close import RESUME_MPS2
from scenarios.rigs.calibration import calibration
from scenarios.rigs.config import HARDWARE
from scenarios.trial.config import TrialConfig


def bounded_by_travel(config: TrialConfig) -> bool:
    """Whether the guard bounds the travel of a closing by the stiffness that the object states. By
    touch, the stiffness measured in the grasp bounds it instead."""
    weak = not config.controller.firm and config.guard.limit_mode == "every_finger"
    stated = config.object.contact_stiffness_npm is not None
    return stated and weak and config.controller.first_grasp != "touch"


def check_override(config: TrialConfig) -> None:
    """Raises ConfigError for incremental tightening with a hand that overrides its force setting.

    Every increment starts from rest, so the override would exceed the limit each time."""
    overrides = config.rig != HARDWARE and config.hand.override_s > 0.0
    if (
        overrides
        and RESPONSES[config.controller.slip_response].closes_in_steps
        and config.controller.first_grasp != "touch"
        and not bounded_by_travel(config)
    ):
        raise ConfigError(
            "hand", "override_s",
            f"the hand overrides its force setting for {config.hand.override_s:g} s at each start: "
            f"each step of controller.slip_response = {config.controller.slip_response} could "
            "exceed the limit",
            "controller.first_grasp = touch, object.contact_stiffness_npm, or another "
            "controller.slip_response",
        )  # fmt: skip


def check_touch(config: TrialConfig) -> None:
    """Raises ConfigError for settings that a first grasp by touch does not follow."""
    other = {
        "firm": config.controller.firm and "controller.firm = false",
        "mode": config.guard.limit_mode != "every_finger" and "guard.limit_mode = every_finger",
    }
    if config.controller.first_grasp != "touch":
        return
    if remedy := next(filter(None, other.values()), ""):
        problem = "touch closes the thumb alone, to a weak grip"
        raise ConfigError("controller", "first_grasp", problem, f"{remedy}, or counts")
    first_n, limit_n = config.controller.first_force_n, config.guard.force_limit_n
    if first_n >= limit_n:
        problem = f"{first_n:g} N leaves no room to the force limit"
        raise ConfigError("controller", "first_force_n", problem, f"less than {limit_n:g} N")
    counts = config.guard.counts_per_newton
    if config.real and not isinstance(counts, tuple):
        raise ConfigError(
            "guard", "counts_per_newton",
            f"{counts:g} for all fingertips, which differ: touch measures force with each of them",
            "three, by `grasp calibrate force`, or controller.first_grasp = counts",
        )  # fmt: skip


def check_grip(config: TrialConfig, guard: ForceGuard) -> None:
    """Raises ConfigError for a first grasp whose speed or force the hand cannot limit enough."""
    known = calibration(config)
    fastest_mps, grip_mps = guard.closing_speed_mps, config.controller.grip_speed_mps
    if grip_mps > fastest_mps:
        raise ConfigError(
            "controller",
            "grip_speed_mps",
            f"{grip_mps:g} m/s onto an object wider than expected exceeds the force limit by more "
            f"than guard.overshoot_n, {config.guard.overshoot_n:g} N",
            f"<= {fastest_mps:.3f}, or a guard.overshoot_n that allows it",
        )
    grip_n = config.controller.grip_force_n
    if grip_n < known.least_force_n and config.controller.first_grasp != "touch":
        raise ConfigError(
            "controller",
            "grip_force_n",
            f"{grip_n:g} N is below the gripper's lowest force setting",
            f">= {known.least_force_n:g} N, the lowest force of calibration {known.name!r}",
        )


def check_arm(config: TrialConfig) -> None:
    """Raises ConfigError for motion settings beyond the arm's limits or workspace."""
    controller, arm = config.controller, config.arm
    limits = {
        "max_speed_mps": ("lower_speed_mps", "lift_speed_mps", "feel_speed_mps"),
        "max_acceleration_mps2": ("lift_acceleration_mps2", "stop_deceleration_mps2"),
        "max_stop_mps2": ("slip_stop_mps2", "stop_deceleration_mps2"),
    }
    for limit, keys in limits.items():
        most = getattr(arm, limit)
        for key in (key for key in keys if key not in controller.unread):
            if (value := getattr(controller, key)) > most:
                problem = f"{value:g} exceeds the arm's limit"
                raise ConfigError("controller", key, problem, f"<= {most:g}, arm.{limit}")
    _check_start(arm)
    _check_height(controller, arm)


def _check_start(arm: ArmSettings) -> None:
    """Raises ConfigError for a workspace without the start position of every run."""
    for name, beyond in (("workspace_low_m", 1.0), ("workspace_high_m", -1.0)):
        for axis, bound_m in zip("xyz", getattr(arm, name), strict=True):
            if beyond * bound_m > 0.0:
                raise ConfigError(
                    "arm", name, f"{bound_m:g} m in {axis} excludes the arm's start, which is "
                    "the origin of the workspace and the end of every run",
                    f"{'<=' if beyond > 0.0 else '>='} 0 in {axis}",
                )  # fmt: skip


def _check_height(controller: ControllerSettings, arm: ArmSettings) -> None:
    """Raises ConfigError where the lift, a stop near its top or the retreat leaves the
    workspace."""
    s, high_m = controller, arm.workspace_high_m[2]
    most_m = min(high_m, arm.max_jump_m)
    if s.lift_height_m > most_m:
        problem = f"{s.lift_height_m:g} m exceeds the arm's limit"
        where = "the lower of arm.workspace_high_m (z) and arm.max_jump_m"
        raise ConfigError("controller", "lift_height_m", problem, f"<= {most_m:g}, {where}")
    braking_m = s.lift_speed_mps**2 / (2.0 * s.slip_stop_mps2)
    beyond_m = braking_m - s.lift_speed_mps**2 / (2.0 * s.lift_acceleration_mps2)
    if s.slip_response != "close" and s.lift_height_m + beyond_m > high_m:
        raise ConfigError(
            "controller", "slip_stop_mps2",
            f"{s.slip_stop_mps2:g} would carry the arm {beyond_m:.3f} m past the top of the lift",
            "a higher one, or a lower controller.lift_height_m",
        )  # fmt: skip
    if not s.keep and s.lift_height_m + s.retreat_m > high_m:
        raise ConfigError(
            "controller", "retreat_m",
            f"{s.retreat_m:g} m above an object that is released at the top of the lift "
            f"({s.lift_height_m:g} m) exceeds the arm's workspace",
            f"<= {high_m - s.lift_height_m:.3g}, up to arm.workspace_high_m (z)",
        )  # fmt: skip


def check_waits(config: TrialConfig) -> None:
    """Raises ConfigError where lifting or lowering takes longer than a phase may last."""
    s = config.controller
    ramp_mps2 = s.lift_acceleration_mps2
    gently_mps2 = min(ramp_mps2, RESUME_MPS2, s.slip_stop_mps2)
    up_mps2 = ramp_mps2 if s.slip_response == "close" else gently_mps2
    down_mps2 = min(ramp_mps2, s.stop_deceleration_mps2)
    durations_s = {
        "lift_speed_mps": _duration_s(s.lift_height_m, s.lift_speed_mps, up_mps2),
        "lower_speed_mps": _duration_s(s.lift_height_m, s.lower_speed_mps, down_mps2),
    }
    key, longest_s = max(durations_s.items(), key=lambda item: item[1])
    if longest_s > s.phase_timeout_s:
        raise ConfigError(
            "controller", key,
            f"{s.lift_height_m:g} m take {longest_s:.1f} s, but a phase may last "
            f"{s.phase_timeout_s:g} s: the object would stay in the air",
            f"a higher speed, a lower controller.lift_height_m, or controller.phase_timeout_s >= "
            f"{math.ceil(longest_s)}",
        )  # fmt: skip


def _duration_s(distance_m: float, speed_mps: float, ramp_mps2: float) -> float:
    """Duration of a motion from rest to rest, s."""
    if distance_m < speed_mps**2 / ramp_mps2:  # it never reaches that speed
        return 2.0 * math.sqrt(distance_m / ramp_mps2)
    return distance_m / speed_mps + speed_mps / ramp_mps2
