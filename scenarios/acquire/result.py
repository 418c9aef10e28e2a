"""What an acquisition leaves, in figures and in a person's words."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Any

import msgspec
import numpy as np

from detector.recordings import Recording
from scenarios.acquire.session import Sample
from scenarios.trial.result import Bug, Failure


class AcquireOutcome(StrEnum):
    """How an acquisition ended."""

    COMPLETE = "complete"
    FAULT = "fault"
    INTERRUPTED = "interrupted"
    INTERNAL_ERROR = "internal_error"


class AcquireResult(msgspec.Struct, frozen=True, kw_only=True):
    """What a run has left behind; with a ``failure`` it ended early, and this is what there was."""

    scenario: str
    rig: str
    surface: str
    direction: str
    seed: int
    outcome: str
    samples: int
    slip: int
    slip_true: int | None
    missed_periods: int  # that the session slept through, from its start on
    repeated: int  # samples without a new frame
    real_time: bool | None  # did the system grant a real-time priority; None in virtual time
    force_mean_n: float | None  # estimated by the fingertip
    force_std_n: float | None
    speed_max_mps: float | None
    recording: str | None  # of the whole session
    recordings: list[str]  # labelled, for training
    versions: dict[str, str]
    failure: Failure | None = None
    bug: Bug | None = None  # an exception of our own code that ended it

    def as_json(self) -> str:
        return msgspec.json.encode(self).decode()

    def in_short(self) -> str:
        """One line, without a path of this machine."""
        true = "" if self.slip_true is None else f" (the contact truly slid in {self.slip_true})"
        return f"{self.outcome}: {self.samples} samples, {self.slip} labelled slip{true}"

    def as_text(self) -> str:
        session = "" if self.recording is None else f"\nsession: {self.recording}"
        if not self.recordings:
            return f"no labelled sample was recorded{session}"
        true = "" if self.slip_true is None else f" (the contact truly slid in {self.slip_true})"
        cut = "" if len(self.recordings) == 1 else ", cut where too many samples were missing"
        return (
            f"{self.samples} samples, {self.slip} labelled slip{true}, {self.repeated} repeated, "
            f"{self.missed_periods} periods missed\n"
            f"force by the fingertip {self.force_mean_n:.1f} +- {self.force_std_n:.1f} N, "
            f"fastest {(self.speed_max_mps or 0.0) * 1e3:.0f} mm/s\n"
            f"recording: {', '.join(self.recordings)}{cut}{session}"
        )


def figures(samples: Sequence[Sample], made: Sequence[Recording]) -> dict[str, Any]:
    """Those of the samples that went into the recordings ``made``, by the result's fields."""
    force = np.array([sample.force_n for sample in samples])
    fastest = [np.hypot(*r.velocity_mps.T).max() for r in made if r.velocity_mps is not None]
    true = [int(r.slip_true.sum()) for r in made if r.slip_true is not None]
    return {
        "samples": len(samples),
        "slip": sum(int(r.slip.sum()) for r in made),
        "slip_true": sum(true) if true else None,
        "repeated": sum(sample.frame.missed > 0 for sample in samples),
        "force_mean_n": float(force.mean()) if samples else None,
        "force_std_n": float(force.std()) if samples else None,
        "speed_max_mps": float(max(fastest)) if fastest else None,
        "recordings": [r.source for r in made],
    }
