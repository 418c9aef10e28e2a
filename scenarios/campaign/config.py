"""The experiments, and the settings that a file or a command line may give for any of them."""

from collections.abc import Sequence
from typing import Any

from grasp.settings import load
from scenarios.lift.lift import LiftConfig, lift
from scenarios.rigs.calibration import Files, user_layers
from scenarios.tap.mallet import TapConfig, TapSettings
from scenarios.tap.tap import tap
from scenarios.trial.config import DEFAULT_PROFILE, TrialConfig
from scenarios.trial.experiment import Experiment
from scenarios.trial.layers import check_read, trial_layers

EXPERIMENTS: dict[str, Experiment[Any, Any, Any]] = {each.name: each for each in (lift, tap)}


class RunConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of a lift or a tap."""

    tap: TapSettings = TapSettings()

    def for_lift(self) -> LiftConfig:
        return lift.own(self)

    def for_tap(self) -> TapConfig:
        return tap.own(self)


def load_config(
    object_name: str,
    rig: str,
    detector: str | None = None,
    files: Files = None,
    assignments: Sequence[str] = (),
    profile: str = DEFAULT_PROFILE,
) -> RunConfig:
    """From the layers of ``trial_layers``. Raises ConfigError for an unknown name or the first
    setting that is not allowed, or that the detector or the answer to slip does not read."""
    layers = trial_layers(object_name, rig, detector, files, assignments, profile)
    config = load(RunConfig, layers)
    own = user_layers(files, assignments)
    check_read(config.rule, config.controller, own, config.detector_name)
    return config


def load_for_devices(
    object_name: str,
    rig: str,
    files: Files = None,
    assignments: Sequence[str] = (),
    detector: str = "energy",
) -> RunConfig:
    """For who runs no trial: one's own files may speak of any detector. Raises as `load_config`."""
    return load(RunConfig, trial_layers(object_name, rig, detector, files, assignments))
