"""Gripper calibration: force, speed and travel that a byte or count of one hand stands for.

The hand has no force sensor; force is set through motor current (manual p. 47). Only a calibration
gives forces in newtons. It belongs to one hand, comes from a file and has a name.
"""

from bisect import bisect_right
from functools import cache
from math import isfinite
from typing import Annotated

import msgspec
from msgspec import Meta

from drivers.errors import Refused
from drivers.robotiq.protocol import FULL_BYTE


class GripperCalibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Calibration of one hand. "manual": Robotiq 3-Finger manual, 2014."""

    name: str
    source: Annotated[
        str, Meta(min_length=1, description="how and when these figures were measured")
    ]
    pressed_bytes: Annotated[
        tuple[int, ...], Meta(description="force bytes that were measured on a scale")
    ] = ()
    presses: Annotated[
        int, Meta(ge=0, description="number of presses per force byte; 0: unknown")
    ] = 0
    least_force_n: Annotated[
        float, Meta(ge=1, le=30, description="N, static force of force byte 0")
    ]
    most_force_n: Annotated[
        float, Meta(ge=15, le=80, description="N, static force of force byte 255; manual p. 47")
    ] = 60.0
    force_exponent: Annotated[
        float,
        Meta(ge=0.3, le=3, description="exponent of force over force byte, 1 = linear; assumed"),
    ] = 1.0
    least_speed_mps: Annotated[
        float,
        Meta(ge=0.001, le=0.1, description="m/s, finger speed of speed byte 0; manual: 22 mm/s"),
    ] = 0.022
    speed_step_mps: Annotated[
        float,
        Meta(ge=1e-5, le=1e-3, description="m/s per count of the speed byte; 88 mm/s over 255"),
    ] = 0.000345
    m_per_count: Annotated[
        float,
        Meta(ge=0.0003, le=0.0012, description="m of fingertip travel; TR711; others 0.47 mm"),
    ] = 0.00077

    def __post_init__(self) -> None:
        if self.most_force_n <= self.least_force_n:
            raise ValueError("most_force_n must exceed least_force_n")
        if any(byte not in range(256) for byte in self.pressed_bytes):
            raise ValueError("pressed_bytes: bytes are 0 to 255")

    def force_n(self, byte: int) -> float:
        """Calibrated static force of a force byte, N."""
        return _forces(self)[byte]

    def byte_at_most(self, force_n: float) -> int:
        """Largest force byte whose calibrated force does not exceed ``force_n``."""
        if not isfinite(force_n) or force_n < self.least_force_n:
            raise Refused(
                f"the '{self.name}' calibration ({self.source}) cannot stay below {force_n:g} N: "
                f"its least force is {self.least_force_n:g} N",
                "raise the force limit, or choose another gripper calibration",
            )
        return bisect_right(_forces(self), force_n) - 1

    def speed_mps(self, byte: int) -> float:
        """Fingertip speed of a speed byte, m/s."""
        return self.least_speed_mps + self.speed_step_mps * byte

    def speed_byte_at_most(self, speed_mps: float) -> int:
        """Largest speed byte not faster than ``speed_mps``; byte 0 where even that is faster."""
        if not isfinite(speed_mps) or speed_mps <= 0:
            raise Refused(f"speed {speed_mps} m/s is not a speed", "ask for more than 0 m/s")
        # The tolerance maps the speed of a byte back to the same byte.
        steps = (speed_mps - self.least_speed_mps) / self.speed_step_mps + 1e-6
        return max(0, min(FULL_BYTE, int(steps)))


@cache
def _forces(calibration: GripperCalibration) -> tuple[float, ...]:
    least, most = calibration.least_force_n, calibration.most_force_n
    exponent = calibration.force_exponent
    return tuple(least + (most - least) * (byte / FULL_BYTE) ** exponent for byte in range(256))
