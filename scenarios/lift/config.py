"""Settings of the object lift."""

from scenarios.trial.config import TrialConfig


class LiftConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one lift."""

    def scene(self, seed: int) -> str:
        return "lift"
