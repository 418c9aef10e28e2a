"""Ground truth of a simulation: the true state of the object or of a pressed fingertip."""

import msgspec

from drivers.interfaces import Vector3

ROUNDING_N = 1e-6  # a smaller contact force is a rounding error


class Truth(msgspec.Struct, frozen=True):
    """True state of a grasped object. Times in seconds since the cell started, None = not yet."""

    t_ns: int
    height_m: float
    speed_mps: float
    slip_distance_m: float
    slip_speed_mps: float
    normal_n: Vector3
    shear_n: Vector3
    peak_n: Vector3
    slip_onset_s: float | None
    force_rise_s: float | None
    flank_slope: float  # of the surface at the pads' last contact; negative: narrowing upwards
    across_m: float = 0.0  # displacement across the closing axis, relative to the fingertips
    impact_s: float | None = None  # start of the last tap
    moved_from_s: float | None = None  # first instant of gross slip since that tap
    moved_until_s: float | None = None  # last such instant so far
    turn_rad: float = 0.0  # rotation in the hand about the closing axis, from across to upwards
    turn_speed_radps: float = 0.0  # while at most one pad sticks; else 0

    @property
    def touched(self) -> bool:
        """Whether a finger bears force beyond rounding errors."""
        return max(self.normal_n) > ROUNDING_N


class PressedTruth(msgspec.Struct, frozen=True):
    """True state of a pressed fingertip at the board's latest sample."""

    t_ns: int
    normal_n: float
    contact_speed_mps: float  # surface against pad, mean over at least the last SPAN_S
    contact_turn_radps: float
    sliding_share: float
