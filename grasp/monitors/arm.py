"""Plausibility of the arm's state: invalid values, and motion that does not follow the commands.

The arm's own safety system monitors speed, force, joint limits and following error; these are not
checked here. Times are those at which the controller's data arrived.
"""

import math

from drivers.interfaces import ArmState, Vector3
from grasp.commands import MoveArm, StopArm
from grasp.lift_line import AT_HEIGHT_M
from grasp.monitors.settings import Data, MonitorSettings, too_often
from grasp.state_timer import LEAST_PACE

MOVED_M = 0.0001  # less is no motion; assumed: the slowest path covers 1 mm in arm_start_s
AT_TARGET_M = AT_HEIGHT_M  # so close to its target it need not move
OFF_LINE_M = 0.002  # deviation in addition to reaction and braking distance; assumed
TURN_S = 0.1  # in addition to arm_start_s: an arm that reverses stops for a moment; assumed


class ArmHistory:
    """The arm's last command, and its motion since."""

    def __init__(self, settings: MonitorSettings) -> None:
        self._start_s = settings.arm_start_s
        self.state: ArmState | None = None  # of this step; None if a value is not a number
        self.command: MoveArm | StopArm | None = None
        # deviation beside or behind its line, or after a stop, beyond reaction and braking distance
        self.deviation_m = 0.0
        self.still_s = 0.0  # without motion although it must move, or reports motion
        self.flips_ns: list[int] = []  # times at which its reported motion changed
        self._start_m: Vector3 = (0.0, 0.0, 0.0)  # position at the time of the command
        self._tolerance_m = 0.0  # reaction and braking distance
        self._nearest_m = 0.0  # shortest distance to its target so far
        self._stopped_m: Vector3 | None = None  # where it first reported standstill after a stop
        self._moved: tuple[int, Vector3] = (0, (0.0, 0.0, 0.0))  # time and place of its last motion
        self._last: ArmState | None = None
        self._unsent = False  # the command has not been sent yet

    def sent(self, command: MoveArm | StopArm, arm: ArmState) -> None:
        """Take a command sent in this state of the arm. A repeated stop changes nothing."""
        before, stop = self.command, isinstance(command, StopArm)
        if not (stop and isinstance(before, StopArm)):
            self.command, self._stopped_m, self._unsent = command, None, True
            self.flips_ns.clear()
            self._begin(arm, before.speed_mps if stop and isinstance(before, MoveArm) else 0.0)

    def update(self, arm: ArmState, pending: bool) -> None:
        """Take the arm's state of this step. ``pending``: a command has not been sent yet."""
        numbers = (*arm.position_m, *arm.velocity_mps, arm.angle_rad, arm.speed_fraction)
        self.state = arm if all(map(math.isfinite, numbers)) else None
        if self.state is None:
            return
        before, self._last = self._last or arm, arm
        self._unsent = self._unsent and pending
        if self._unsent or before is arm:  # it still follows the command before
            self._begin(arm, 0.0)
        if arm.moving is not before.moving:
            self.flips_ns.append(arm.t_ns)
        end_m = self._end_m
        away_m = math.dist(arm.position_m, end_m)
        self._nearest_m = min(self._nearest_m, away_m)
        beside_m = _distance(arm.position_m, self._start_m, end_m)
        self.deviation_m = max(beside_m, away_m - self._nearest_m) - self._tolerance_m
        stopped = isinstance(self.command, StopArm) and not arm.moving
        self._stopped_m = (self._stopped_m or arm.position_m) if stopped else None
        if self._stopped_m:
            self.deviation_m = max(self.deviation_m, math.dist(arm.position_m, self._stopped_m))
        must_move = arm.moving or (isinstance(self.command, MoveArm) and away_m > AT_TARGET_M)
        moved = math.dist(arm.position_m, self._moved[1]) > MOVED_M
        slider_changed = arm.speed_fraction != before.speed_fraction
        if moved or slider_changed or not must_move:
            self._moved = (arm.t_ns, arm.position_m)
        self.still_s = (arm.t_ns - self._moved[0]) * 1e-9

    @property
    def deviates(self) -> bool:
        """Whether it is not on its line, or moves on although commanded to stop."""
        most_m = AT_TARGET_M if isinstance(self.command, StopArm) else OFF_LINE_M
        return self.state is not None and self.deviation_m > most_m

    @property
    def flickers(self) -> bool:
        """Whether it alternately reports motion and standstill."""
        return self.state is not None and too_often(self.flips_ns, self.state.t_ns)

    @property
    def _end_m(self) -> Vector3:
        """Its target; after a stop, the position at which the stop was commanded."""
        return self.command.position_m if isinstance(self.command, MoveArm) else self._start_m

    def _begin(self, arm: ArmState, speed_mps: float) -> None:
        """Start from this state. ``speed_mps``: speed that it may reach before the command does."""
        self._start_m, self._moved = arm.position_m, (arm.t_ns, arm.position_m)
        self._nearest_m = math.dist(arm.position_m, self._end_m)
        self._tolerance_m = 0.0
        if c := self.command:
            ramp_mps2 = c.deceleration_mps2 if isinstance(c, StopArm) else c.acceleration_mps2
            speed_mps = max(speed_mps, math.hypot(*arm.velocity_mps))
            self._tolerance_m = speed_mps * self._start_s + speed_mps**2 / (2.0 * ramp_mps2)


def frozen(h: ArmHistory, s: MonitorSettings) -> Data:
    """Fails if the arm keeps its position although it must move, or reports motion."""
    if h.state is None:
        return None
    pace = min(1.0, max(LEAST_PACE, h.state.speed_fraction))
    late = h.still_s > (s.arm_start_s + TURN_S) / pace
    return {"seconds": round(h.still_s, 3)} if late else None


def _distance(at_m: Vector3, start_m: Vector3, end_m: Vector3) -> float:
    """Distance of a point from the line segment between two points."""
    line = [b - a for a, b in zip(start_m, end_m, strict=True)]
    point = [b - a for a, b in zip(start_m, at_m, strict=True)]
    square = sum(d * d for d in line)
    share = sum(a * b for a, b in zip(line, point, strict=True)) / square if square else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.dist(point, [share * d for d in line])
