"""Everything that a tap can be told."""

from scenarios.tap.blows import direction_of
from scenarios.tap.settings import TapScoringSettings, TapSettings
from scenarios.trial.config import TrialConfig
from scenarios.trial.physics import contact_levels
from scenarios.world.settings import ContactLevels


class TapConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one tap."""

    tap: TapSettings = TapSettings()
    tap_scoring: TapScoringSettings = TapScoringSettings()

    def physics(self, seed: int) -> ContactLevels | None:
        return contact_levels(self, direction_of(self.tap, seed))
