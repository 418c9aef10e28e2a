"""Plausibility of the arm's state: invalid values, and motion that does not follow the commands.

The arm's own safety system monitors speed, force, joint limits and following error; these are not
checked here. Times are those at which the controller's data arrived.
"""

import math

from drivers.interfaces import ArmState, Vector3
from grasp.control.commands import MoveArm, StopArm
from grasp.control.lift_line import AT_HEIGHT_M
from grasp.control.monitors.settings import FLIPS, Failures, MonitorSettings, too_often
from grasp.control.state_timer import LEAST_PACE

MOVED_M = 0.0001  # less is no motion; assumed: the slowest path covers 1 mm in arm_start_s
AT_TARGET_M = AT_HEIGHT_M  # so close to its target it need not move
OFF_LINE_M = 0.002  # deviation in addition to reaction and braking distance; assumed
TURN_S = 0.1  # in addition to arm_start_s: an arm that reverses stops for a moment; assumed


class ArmHistory:
    """The arm's last command, and its motion since."""

    def __init__(self, settings: MonitorSettings) -> None:
        self._start_s = settings.arm_start_s
        self._last: ArmState | None = None
        self._command: MoveArm | StopArm | None = None
        self._unsent = False  # the command has not been sent yet
        self._start_m: Vector3 = (0.0, 0.0, 0.0)  # position at the time of the command
        self._end_m: Vector3 = (0.0, 0.0, 0.0)  # its target; of a stop, where it was commanded
        self._tolerance_m = 0.0  # reaction and braking distance
        self._nearest_m = 0.0  # shortest distance to its target so far
        self._stopped_m: Vector3 | None = None  # where it first reported standstill after a stop
        self._moved: tuple[int, Vector3] = (0, (0.0, 0.0, 0.0))  # time and place of its last motion
        self._flips_ns: list[int] = []  # times at which its reported motion changed

    def sent(self, command: MoveArm | StopArm, arm: ArmState) -> None:
        """Take a command sent in this state of the arm. A repeated stop changes nothing."""
        before, stop = self._command, isinstance(command, StopArm)
        if not (stop and isinstance(before, StopArm)):
            self._command, self._stopped_m, self._unsent = command, None, True
            self._flips_ns.clear()
            self._begin(arm, before.speed_mps if stop and isinstance(before, MoveArm) else 0.0)

    def update(self, arm: ArmState, pending: bool) -> Failures:
        """Take the arm's state of this step; returns the checks that it fails. ``pending``: a
        command has not been sent yet."""
        numbers = (*arm.position_m, *arm.velocity_mps, arm.angle_rad, arm.speed_fraction)
        if not all(map(math.isfinite, numbers)):
            return {"arm_position_nan": {}}
        before, self._last = self._last or arm, arm
        self._unsent = self._unsent and pending
        if self._unsent or before is arm:  # it still follows the command before
            self._begin(arm, 0.0)
        if arm.moving is not before.moving:
            self._flips_ns.append(arm.t_ns)
        failures: Failures = {}
        away_m = math.dist(arm.position_m, self._end_m)
        deviation_m = self._deviation_m(arm, away_m)
        if deviation_m > (AT_TARGET_M if isinstance(self._command, StopArm) else OFF_LINE_M):
            failures["arm_wrong_way"] = {"mm": round(deviation_m * 1e3, 1)}
        if len(self._flips_ns) > FLIPS and too_often(self._flips_ns, arm.t_ns):
            failures["arm_flickers"] = {}
        must_move = arm.moving or (isinstance(self._command, MoveArm) and away_m > AT_TARGET_M)
        if (
            not must_move
            or math.dist(arm.position_m, self._moved[1]) > MOVED_M
            or arm.speed_fraction != before.speed_fraction
        ):
            self._moved = (arm.t_ns, arm.position_m)
        still_s = (arm.t_ns - self._moved[0]) * 1e-9
        if still_s > (self._start_s + TURN_S) / min(1.0, max(LEAST_PACE, arm.speed_fraction)):
            failures["arm_frozen"] = {"seconds": round(still_s, 3)}
        return failures

    def _deviation_m(self, arm: ArmState, away_m: float) -> float:
        """Distance beside or behind its line, beyond reaction and braking distance; or from where
        it stood still after a stop. ``away_m``: distance from its target."""
        self._nearest_m = min(self._nearest_m, away_m)
        beside_m = _distance(arm.position_m, self._start_m, self._end_m)
        deviation_m = max(beside_m, away_m - self._nearest_m) - self._tolerance_m
        if arm.moving or not isinstance(self._command, StopArm):
            self._stopped_m = None
            return deviation_m
        self._stopped_m = self._stopped_m or arm.position_m
        return max(deviation_m, math.dist(arm.position_m, self._stopped_m))

    def _begin(self, arm: ArmState, speed_mps: float) -> None:
        """Start from this state. ``speed_mps``: speed that it may reach before the command does."""
        c = self._command
        self._start_m, self._moved = arm.position_m, (arm.t_ns, arm.position_m)
        self._end_m = c.position_m if isinstance(c, MoveArm) else arm.position_m
        self._nearest_m = math.dist(arm.position_m, self._end_m)
        self._tolerance_m = 0.0
        if c:
            ramp_mps2 = c.deceleration_mps2 if isinstance(c, StopArm) else c.acceleration_mps2
            speed_mps = max(speed_mps, math.hypot(*arm.velocity_mps))
            self._tolerance_m = speed_mps * self._start_s + speed_mps**2 / (2.0 * ramp_mps2)


def _distance(at_m: Vector3, start_m: Vector3, end_m: Vector3) -> float:
    """Distance of a point from the line segment between two points."""
    (x, y, z), (start_x, start_y, start_z), (end_x, end_y, end_z) = at_m, start_m, end_m
    x, y, z = x - start_x, y - start_y, z - start_z
    line_x, line_y, line_z = end_x - start_x, end_y - start_y, end_z - start_z
    square = line_x * line_x + line_y * line_y + line_z * line_z
    share = (line_x * x + line_y * y + line_z * z) / square if square else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.dist((x, y, z), (share * line_x, share * line_y, share * line_z))
