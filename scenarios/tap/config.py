"""Everything that a tap can be told."""

from scenarios.tap.settings import TapScoringSettings, TapSettings
from scenarios.trial.config import TrialConfig


class TapConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one tap."""

    tap: TapSettings = TapSettings()
    tap_scoring: TapScoringSettings = TapScoringSettings()
