"""Everything that a lift can be told."""

from scenarios.lift.scoring import ScoringSettings
from scenarios.trial.config import TrialConfig


class LiftConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one lift."""

    scoring: ScoringSettings = ScoringSettings()
