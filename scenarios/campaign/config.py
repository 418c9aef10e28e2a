"""The union of what lift and tap can be told: what a file or a command line may say of either."""

from collections.abc import Sequence

from grasp.settings import load
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import ScoringSettings
from scenarios.rigs.calibration import Files, own_layers
from scenarios.rigs.config import part
from scenarios.tap.config import TapConfig
from scenarios.tap.settings import TapScoringSettings, TapSettings
from scenarios.trial.config import DEFAULT_PROFILE, TrialConfig, check_read, trial_layers


class RunConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of a lift or a tap."""

    scoring: ScoringSettings = ScoringSettings()
    tap: TapSettings = TapSettings()
    tap_scoring: TapScoringSettings = TapScoringSettings()

    def for_lift(self) -> LiftConfig:
        return part(self, LiftConfig)

    def for_tap(self) -> TapConfig:
        return part(self, TapConfig)


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
    own = own_layers(files, assignments)
    check_read(config.detector_name, config.rule, config.controller, own)
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
