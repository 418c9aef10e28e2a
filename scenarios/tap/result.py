"""What a tap leaves."""

import msgspec

from scenarios.trial.result import TrialResult


class Alarm(msgspec.Struct, frozen=True):
    """A stretch of status REGISTERED; None: it was still so at the end."""

    on_s: float
    off_s: float | None


class TapResult(TrialResult, frozen=True, kw_only=True):
    """Verdict of one tap. Lengths in metres, relative to the fingertips, down and across the
    closing axis; ``turned_rad`` about it. ``moved`` is False for a tap that moved nothing, which is
    reported apart: it is no success, and a failure only if slip was registered. It is None for a
    tap that never was struck, or not to its end."""

    direction: str
    moved: bool | None
    displacement_m: float | None
    down_m: float | None
    across_m: float | None
    turned_rad: float | None
    impulse_n_s: float | None
    mallet_mps: float | None
    struck_s: float | None
    slip_end_s: float | None
    slip_duration_ms: float | None
    nominal_again_s: float | None
    nominal_again_ms: float | None
    alarms: list[Alarm]
    watched_until_s: float | None
    grip_force_n: dict[str, float] | None
