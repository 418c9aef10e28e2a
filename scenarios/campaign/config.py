"""Settings of a lift or a tap, and their loading."""

from typing import Any

import msgspec

from grasp.settings import load
from scenarios.lift.config import LiftConfig
from scenarios.rigs.calibration import Assignments, Files, user_layers
from scenarios.rigs.config import HARDWARE, part
from scenarios.tap.config import TapConfig, TapSettings
from scenarios.trial.config import DEFAULT_PROFILE, TrialConfig
from scenarios.trial.layers import check_read, trial_layers

UNNAMED = "unnamed"  # an object of which nothing is known


class RunConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of a lift or a tap."""

    tap: TapSettings = TapSettings()

    def for_lift(self) -> LiftConfig:
        return part(self, LiftConfig)

    def for_tap(self) -> TapConfig:
        return part(self, TapConfig)


def load_config(
    object_name: str,
    rig: str,
    detector: str | None = None,
    files: Files = None,
    assignments: Assignments = (),
    profile: str = DEFAULT_PROFILE,
) -> RunConfig:
    """Settings from the layers of ``trial_layers``. Raises ConfigError for an unknown name, a value
    out of range, or a user setting that detector, rule or slip response do not read."""
    layers = trial_layers(object_name, rig, detector, files, assignments, profile)
    config = load(RunConfig, layers)
    own = user_layers(files, assignments)
    check_read(config.rule, config.controller, own, config.detector_name)
    return config


def load_lift(object_name: str | None, *others: Any) -> RunConfig:
    """Settings of a single lift, as ``load_config``, whose first grasp is by touch where nothing
    else is set. Without ``object_name``: the can, on real devices any object."""
    config, replace = load_config(object_name or "can", *others), msgspec.structs.replace
    weak = not config.controller.firm and config.guard.limit_mode == "every_finger"
    if config.controller.first_grasp is None and weak:
        config = replace(config, controller=replace(config.controller, first_grasp="touch"))
    by_touch = config.controller.first_grasp == "touch"
    if object_name is None and by_touch and config.rig == HARDWARE and config.object.name == "can":
        unknown = {"name": UNNAMED, "description": "", "contact_stiffness_npm": None}
        config = replace(config, object=replace(config.object, **unknown, long_body=False))
    return config


def load_for_devices(
    object_name: str,
    rig: str,
    files: Files = None,
    assignments: Assignments = (),
    detector: str = "energy",
) -> RunConfig:
    """Settings for commands without a trial, whose files may configure any detector. Raises as
    `load_config`."""
    return load(RunConfig, trial_layers(object_name, rig, detector, files, assignments))
