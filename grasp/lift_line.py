"""LiftLine: the vertical line through the arm's home, on which a lift goes up and down."""

from drivers.interfaces import Vector3
from grasp.commands import MoveArm
from grasp.controller_settings import ControllerSettings
from grasp.observation import Observation

AT_HEIGHT_M = 0.001  # the arm counts as there within this; assumed


class LiftLine:
    """Heights are over ``home``, in m."""

    def __init__(self, settings: ControllerSettings, home: Vector3) -> None:
        self._settings = settings
        self.home = home

    def height_m(self, obs: Observation) -> float:
        """Of the arm."""
        return obs.arm.position_m[2] - self.home[2]

    def stands_at(self, obs: Observation, height_m: float) -> bool:
        """Whether the arm stands there, and no command is on its way."""
        away_m = abs(self.height_m(obs) - height_m)
        return not obs.pending and not obs.arm.moving and away_m < AT_HEIGHT_M

    def move(
        self, height_m: float, speed_mps: float, acceleration_mps2: float | None = None
    ) -> MoveArm:
        """The arm to that height; without an acceleration of its own at that of the lift."""
        x, y, z = self.home
        ramp_mps2 = acceleration_mps2 or self._settings.lift_acceleration_mps2
        return MoveArm((x, y, z + height_m), speed_mps, ramp_mps2)

    def down(self, height_m: float, speed_mps: float) -> MoveArm:
        """To a height at which something may stand: the arm brakes for it no harder than a safe
        state's stop does, so that one that is stopped on the way ends no lower."""
        s = self._settings
        gently_mps2 = min(s.lift_acceleration_mps2, s.stop_deceleration_mps2)
        return self.move(height_m, speed_mps, gently_mps2)
