"""What a lift leaves."""

from scenarios.trial.result import TrialResult


class LiftResult(TrialResult, frozen=True, kw_only=True):
    """Verdict of one lift; docs/data-formats.md explains each outcome. ``alarm_stayed``: slip was
    registered at the end of the hold, whether or not that decides the outcome."""

    first_detection_s: float | None
    reaction_latency_ms: float | None
    slip_distance_m: float | None
    turned_rad: float | None  # in the hand, about the closing axis; None without a simulation
    settled_force_n: dict[str, float] | None
    alarm_stayed: bool
