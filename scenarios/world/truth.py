"""What only a simulation knows, as it is asked for, kept and sent."""

import msgspec

from drivers.interfaces import Vector3

NOTHING_N = 1e-6  # less than this is what rounding leaves of a contact


class Truth(msgspec.Struct, frozen=True):
    """What only a simulation knows. Times in seconds since the cell began, None = not yet."""

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
    across_m: float = 0.0  # of the object, across the closing axis, relative to the fingertips
    impact_s: float | None = None  # beginning of the last tap
    moved_from_s: float | None = None  # gross slip since that tap: its first instant
    moved_until_s: float | None = None  # and its last one so far
    turn_rad: float = 0.0  # in the hand, about the closing axis, from across to upwards
    turn_speed_radps: float = 0.0  # while the object turns about at most one pad that holds on

    @property
    def touched(self) -> bool:
        """Whether a finger bears anything: an open hand bears what is left by rounding."""
        return max(self.normal_n) > NOTHING_N


class PressedTruth(msgspec.Struct, frozen=True):
    """What only a simulation knows, at the board's latest sample."""

    t_ns: int
    normal_n: float
    contact_speed_mps: float  # surface against pad, mean of the last SPAN_S or a little more
    contact_turn_radps: float
    sliding_share: float
