"""What `page/view.html` draws of a run, whether it is over or still goes on."""

from typing import Any

import msgspec

from drivers.interfaces import KIT_TAXELS
from scenarios.report.run_decision import Bound
from scenarios.report.run_record import Told
from scenarios.world.settings import HALF_APERTURE_M, PAD_HALF_LENGTH_M


class Seen(msgspec.Struct, frozen=True):
    """What there is to be drawn, as `page/view.html` asks. ``hand``: a grasp, not an
    acquisition."""

    hand: bool
    truth: bool
    motion: bool
    limit_n: float | None
    rule: Bound | None
    evidence: bool = False  # sums of a rule, for a run that is over


def taxels_of(told: Told) -> int:
    """How many a fingertip has."""
    return len(told.fingertip.taxels_mm) or KIT_TAXELS


def scene(told: Told, grip_m: float, top_m: float) -> dict[str, Any]:
    """Of the side view, in metres; heights count from ``grip_m``, the arm's when a lift begins."""
    return {
        "object": msgspec.to_builtins(told.object),
        "half_aperture_m": HALF_APERTURE_M,
        "pad_half_m": PAD_HALF_LENGTH_M,
        "m_per_count": told.calibration.m_per_count,
        "grip_m": grip_m,
        "top_m": top_m,
    }
