"""Everything that a lift can be told."""

from scenarios.lift.scoring import ScoringSettings
from scenarios.trial.config import TrialConfig
from scenarios.trial.physics import contact_levels
from scenarios.world.settings import ContactLevels


class LiftConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one lift."""

    scoring: ScoringSettings = ScoringSettings()

    def physics(self, seed: int) -> ContactLevels | None:
        return contact_levels(self, "lift")
