"""Everything that a lift can be told."""

from scenarios.lift.scoring import ScoringSettings
from scenarios.trial.config import TrialConfig
from scenarios.world.world_settings import RunPlan


class LiftConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one lift."""

    scoring: ScoringSettings = ScoringSettings()

    def physics(self, seed: int) -> RunPlan | None:
        """As ``TrialConfig.physics``; all lifts of an object are alike."""
        if self.real:
            return None
        from scenarios.trial.physics import planned, run_scene

        return planned(self, run_scene(self))
