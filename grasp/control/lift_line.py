"""LiftLine: the vertical line along which the arm lifts and lowers."""

from drivers.interfaces import Vector3
from grasp.control.commands import MoveArm
from grasp.control.controller_settings import ControllerSettings
from grasp.control.observation import Observation

AT_HEIGHT_M = 0.001  # the arm counts as there within this; assumed


class LiftLine:
    """The vertical line through the arm's ``home``; heights are above ``home``, in m."""

    def __init__(self, settings: ControllerSettings, home: Vector3) -> None:
        self._settings = settings
        self.home = home

    def height_m(self, obs: Observation) -> float:
        return obs.arm.position_m[2] - self.home[2]

    def stopped_at(self, obs: Observation, height_m: float) -> bool:
        """Whether the arm is at rest at this height, with no command on its way."""
        if obs.pending or obs.arm.moving:
            return False
        return abs(self.height_m(obs) - height_m) < AT_HEIGHT_M

    def move(
        self, height_m: float, speed_mps: float, acceleration_mps2: float | None = None
    ) -> MoveArm:
        """Command to move to this height; by default with the acceleration of the lift."""
        x, y, z = self.home
        ramp_mps2 = acceleration_mps2 or self._settings.lift_acceleration_mps2
        return MoveArm((x, y, z + height_m), speed_mps, ramp_mps2)

    def move_down(self, height_m: float, speed_mps: float) -> MoveArm:
        """Command to move down to where the object may touch the table. The arm brakes no harder
        than in a safe stop, so a stop on the way ends no lower than the target."""
        s = self._settings
        gently_mps2 = min(s.lift_acceleration_mps2, s.stop_deceleration_mps2)
        return self.move(height_m, speed_mps, gently_mps2)
