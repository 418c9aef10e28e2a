"""LiftLine: the vertical line through the arm's home, on which a lift goes up and down."""

import math

from drivers.interfaces import Vector3
from grasp.commands import MoveArm
from grasp.controller_settings import ControllerSettings
from grasp.observation import Observation

MOVING_MPS = 0.001  # seen to move: what an arm says of that is said before it does


class LiftLine:
    """Heights are over ``home``, in m. ``reaction_s``: the longest that the arm, while it stood,
    took until it was seen to do what it was told."""

    def __init__(self, settings: ControllerSettings, home: Vector3) -> None:
        self._settings = settings
        self.home = home
        self.reaction_s = 0.0
        self._stands_ns: int | None = None  # the last sample, if it stood there
        self._told_ns: int | None = None  # while it stood

    def see(self, seen: Observation) -> None:
        """One sample, before anything is told."""
        if self._told_ns is not None and math.hypot(*seen.arm.velocity_mps) >= MOVING_MPS:
            self.reaction_s = max(self.reaction_s, (seen.t_ns - self._told_ns) * 1e-9)
            self._told_ns = None
        self._stands_ns = None if seen.arm.moving else seen.t_ns

    def height_m(self, seen: Observation) -> float:
        """Of the arm."""
        return seen.arm.position_m[2] - self.home[2]

    def stands_at(self, seen: Observation, height_m: float) -> bool:
        """Whether the arm stands there, and nothing that was told is on its way."""
        away_m = abs(self.height_m(seen) - height_m)
        return not seen.pending and not seen.arm.moving and away_m < self._settings.at_height_m

    def move(self, height_m: float, speed_mps: float) -> MoveArm:
        """The arm to that height."""
        self._told_ns = self._stands_ns
        x, y, z = self.home
        return MoveArm((x, y, z + height_m), speed_mps, self._settings.lift_acceleration_mps2)
