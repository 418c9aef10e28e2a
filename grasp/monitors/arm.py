"""Arm positions that cannot be, or that do not follow what the arm was commanded.

What the arm's own safety system watches (speed, force, joint limits, following error) is left to
it. Times are those at which the controller's data came.
"""

import math

from drivers.interfaces import ArmState, Vector3
from grasp.commands import MoveArm, StopArm
from grasp.lift_progress import AT_HEIGHT_M, LEAST_PACE
from grasp.monitors.settings import Data, MonitorSettings, too_often

MOVED_M = 0.0001  # less is no motion; assumed: the slowest path covers 1 mm in arm_start_s
THERE_M = AT_HEIGHT_M  # so close to its target it need not move
OFF_LINE_M = 0.002  # beyond reacting and braking; assumed
TURN_S = 0.1  # beside arm_start_s: an arm that turns round stands for a moment; assumed


class ArmHistory:
    """What the arm was commanded, and where it has been since."""

    def __init__(self, settings: MonitorSettings) -> None:
        self._start_s = settings.arm_start_s
        self.state: ArmState | None = None  # of this step; None where it is no numbers
        self.command: MoveArm | StopArm | None = None
        # off its line, back on it or on though stopped, beyond what reacting and braking take
        self.stray_m = 0.0
        self.still_s = 0.0  # at one place though it has to move, or reports that it does
        self.flips_ns: list[int] = []  # when it reported otherwise than before of its motion
        self._from_m: Vector3 = (0.0, 0.0, 0.0)  # where the command found it
        self._room_m = 0.0  # it may go further from there before it follows
        self._nearest_m = 0.0  # it has been to its target
        self._stood_m: Vector3 | None = None  # where it first reported that a stop was obeyed
        self._moved: tuple[int, Vector3] = (0, (0.0, 0.0, 0.0))  # when and where it last did
        self._last: ArmState | None = None
        self._unsent = False  # the command has not left yet

    def sent(self, command: MoveArm | StopArm, arm: ArmState) -> None:
        """A command goes out while the arm is like this. A repeated stop changes nothing."""
        before, stop = self.command, isinstance(command, StopArm)
        if not (stop and isinstance(before, StopArm)):
            self.command, self._stood_m, self._unsent = command, None, True
            self.flips_ns.clear()
            self._begin(arm, before.speed_mps if stop and isinstance(before, MoveArm) else 0.0)

    def update(self, arm: ArmState, pending: bool) -> None:
        """Its state of this step. ``pending``: a command has not left yet."""
        numbers = (*arm.position_m, *arm.velocity_mps, arm.angle_rad, arm.speed_fraction)
        self.state = arm if all(map(math.isfinite, numbers)) else None
        if self.state is None:
            return
        before, self._last = self._last or arm, arm
        self._unsent = self._unsent and pending
        if self._unsent or before is arm:  # it goes on as before
            self._begin(arm, 0.0)
        if arm.moving is not before.moving:
            self.flips_ns.append(arm.t_ns)
        end_m = self._end_m
        away_m = math.dist(arm.position_m, end_m)
        self._nearest_m = min(self._nearest_m, away_m)
        aside_m = _distance(arm.position_m, self._from_m, end_m)
        self.stray_m = max(aside_m, away_m - self._nearest_m) - self._room_m
        stands = isinstance(self.command, StopArm) and not arm.moving
        self._stood_m = (self._stood_m or arm.position_m) if stands else None
        if self._stood_m:
            self.stray_m = max(self.stray_m, math.dist(arm.position_m, self._stood_m))
        must_move = arm.moving or (isinstance(self.command, MoveArm) and away_m > THERE_M)
        moved = math.dist(arm.position_m, self._moved[1]) > MOVED_M
        turned = arm.speed_fraction != before.speed_fraction  # its slider was
        if moved or turned or not must_move:
            self._moved = (arm.t_ns, arm.position_m)
        self.still_s = (arm.t_ns - self._moved[0]) * 1e-9

    @property
    def strays(self) -> bool:
        """Whether it is not on its line, or goes on though commanded to stop."""
        most_m = THERE_M if isinstance(self.command, StopArm) else OFF_LINE_M
        return self.state is not None and self.stray_m > most_m

    @property
    def flickers(self) -> bool:
        """Whether it reports by turns that it moves and that it stands."""
        return self.state is not None and too_often(self.flips_ns, self.state.t_ns)

    @property
    def _end_m(self) -> Vector3:
        """Its target; of an arm that shall stand, where it was told so."""
        return self.command.position_m if isinstance(self.command, MoveArm) else self._from_m

    def _begin(self, arm: ArmState, speed_mps: float) -> None:
        """``speed_mps``: that it may come to before the command reaches it."""
        self._from_m, self._moved = arm.position_m, (arm.t_ns, arm.position_m)
        self._nearest_m = math.dist(arm.position_m, self._end_m)
        self._room_m = 0.0
        if c := self.command:
            ramp_mps2 = c.deceleration_mps2 if isinstance(c, StopArm) else c.acceleration_mps2
            speed_mps = max(speed_mps, math.hypot(*arm.velocity_mps))
            self._room_m = speed_mps * self._start_s + speed_mps**2 / (2.0 * ramp_mps2)


def frozen(h: ArmHistory, s: MonitorSettings) -> Data:
    """It keeps its place though it has to move, or though it reports that it does."""
    if h.state is None:
        return None
    pace = min(1.0, max(LEAST_PACE, h.state.speed_fraction))
    late = h.still_s > (s.arm_start_s + TURN_S) / pace
    return {"seconds": round(h.still_s, 3)} if late else None


def _distance(at_m: Vector3, start_m: Vector3, end_m: Vector3) -> float:
    """From the straight line between two points, its ends included."""
    line = [b - a for a, b in zip(start_m, end_m, strict=True)]
    gone = [b - a for a, b in zip(start_m, at_m, strict=True)]
    square = sum(d * d for d in line)
    share = sum(a * b for a, b in zip(line, gone, strict=True)) / square if square else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.dist(gone, [share * d for d in line])
