"""Arm positions that cannot be, or that do not follow what the arm was commanded.

What the arm's own safety system watches (speed, force, joint limits, following error) is left to
it. Times are those at which the controller's data came.
"""

import math

from drivers.interfaces import ArmState, Vector3
from grasp.commands import MoveArm, StopArm
from grasp.lift_progress import AT_HEIGHT_M, LEAST_PACE
from grasp.monitors.flips import Flips
from grasp.monitors.settings import Data, MonitorSettings

MOVED_M = 0.0001  # less is no motion; assumed: the slowest path covers 1 mm in arm_start_s
STANDING_MPS = 0.001  # an arm that stands reports no more, as the link of the arm
THERE_M = AT_HEIGHT_M  # so close to its target it need not move
OFF_LINE_M = 0.002  # from its line, or back on it, beyond braking; assumed
FASTEST_MPS = 1.0  # no arm of this kind is faster; UR manual
JUMP_M = 0.01  # beside that: samples come late; assumed


class ArmHistory:
    """What the arm was commanded, and where it has been since."""

    def __init__(self, settings: MonitorSettings) -> None:
        self._start_s = settings.arm_start_s
        self.state: ArmState | None = None  # of this step; None where it is no numbers
        self.move: MoveArm | None = None  # that it is carrying out
        self.stop: StopArm | None = None  # that it was commanded since
        self.from_m: Vector3 = (0.0, 0.0, 0.0)  # where the command found it
        self.room_m = 0.0  # it may go further from there before it follows: to react and to brake
        self.nearest_m = 0.0  # it has been to its target
        self.stood_m: Vector3 | None = None  # where it first reported that a stop was obeyed
        self.seen_moving: tuple[int, Vector3] = (0, (0.0, 0.0, 0.0))  # when and where it last was
        self.must_move = False
        self.flips = Flips()
        self.leapt_m = 0.0  # beyond what it can have gone since the last sample
        self.ramp_s = 0.0  # twice as long as it takes to speed up or brake within MOVED_M
        self._last: ArmState | None = None
        self._pending = False
        self._unheard = False  # the stop has not left yet
        self._settles_ns = -1  # until then what it did while nobody looked may come in

    def command(self, command: MoveArm | StopArm, arm: ArmState) -> None:
        """A command goes out while the arm is like this. A repeated stop changes nothing."""
        if isinstance(command, MoveArm):
            self.move, self.stop, self.stood_m = command, None, None
            self._begin(arm, _speed(arm), command.acceleration_mps2)
        elif not self.stop:
            fastest_mps, self._unheard = self._fastest_mps(arm), True
            self.move, self.stop = None, command
            self._begin(arm, fastest_mps, command.deceleration_mps2)
        else:
            return
        self.flips.clear()

    def _begin(self, arm: ArmState, fastest_mps: float, ramp_mps2: float) -> None:
        self.from_m = arm.position_m
        self.room_m = fastest_mps * self._start_s + fastest_mps**2 / (2.0 * ramp_mps2)
        self.nearest_m = self.away_m(arm)
        self.seen_moving = (arm.t_ns, arm.position_m)
        self.ramp_s = 2.0 * math.sqrt(2.0 * MOVED_M / ramp_mps2)

    def _fastest_mps(self, arm: ArmState) -> float:
        """That it may come to before a stop reaches it."""
        speed_mps = _speed(arm)
        if self.move is None:
            return speed_mps
        later_mps = speed_mps + self.move.acceleration_mps2 * self._start_s
        return max(speed_mps, min(self.move.speed_mps, later_mps))

    def restart(self, arm: ArmState, late_ns: int) -> None:
        """Nobody looked for so long: the arm went on, and what it reported may come in a burst."""
        seen_ns = (self._last or arm).t_ns
        self._settles_ns = max(arm.t_ns, seen_ns + late_ns) + round(self._start_s * 1e9)

    def update(self, arm: ArmState, pending: bool) -> None:
        """Its state of this step. ``pending``: a command has not left yet."""
        numbers = (*arm.position_m, *arm.velocity_mps, arm.angle_rad)
        self.state = arm if all(map(math.isfinite, numbers)) else None
        if self.state is None:
            return
        before, self._last, self._pending = self._last or arm, arm, pending
        if before is arm:
            self.from_m = arm.position_m
        self._unheard = self._unheard and pending
        settling = arm.t_ns <= self._settles_ns
        if self.stop and (self._unheard or settling):
            self._begin(arm, _speed(arm), self.stop.deceleration_mps2)
        elif self.move and pending:  # it goes on as before
            self._begin(arm, _speed(arm), self.move.acceleration_mps2)
        self.nearest_m = min(self.nearest_m, self.away_m(arm))
        stands = self.stop and not (arm.moving or settling)
        self.stood_m = (self.stood_m or arm.position_m) if stands else None
        if settling:
            self.flips.clear()
        self.flips.update(arm.t_ns, arm.moving)
        there = self.move is None or self.away_m(arm) <= THERE_M
        self.must_move = (arm.moving or not there) and not (pending or settling)
        self.leapt_m = 0.0 if settling else self._leapt_m(before, arm)
        moved = math.dist(arm.position_m, self.seen_moving[1]) > MOVED_M
        turned = arm.speed_fraction != before.speed_fraction  # its slider was
        if moved or turned or not self.must_move or before is arm:
            self.seen_moving = (arm.t_ns, arm.position_m)

    def _leapt_m(self, before: ArmState, arm: ArmState) -> float:
        """By the controller's own clock where that says more: samples may come in a burst."""
        apart_s = (arm.t_ns - before.t_ns) * 1e-9
        if arm.sampled_ns is not None and before.sampled_ns is not None:
            most_s = apart_s + self._start_s
            apart_s = max(apart_s, min(most_s, (arm.sampled_ns - before.sampled_ns) * 1e-9))
        return math.dist(before.position_m, arm.position_m) - FASTEST_MPS * apart_s - JUMP_M

    def away_m(self, arm: ArmState) -> float:
        """From its target; of an arm that was commanded nothing, from where it stood."""
        return math.dist(arm.position_m, self.move.position_m if self.move else self.from_m)

    def off_line_m(self) -> float:
        """How far it is off its line or back on it, beyond what reacting and braking take."""
        if self.state is None or self.stop or self._pending:
            return 0.0
        end_m = self.move.position_m if self.move else self.from_m
        aside_m = _distance(self.state.position_m, self.from_m, end_m)
        return max(aside_m, self.away_m(self.state) - self.nearest_m) - self.room_m


def position_nan(h: ArmHistory, s: MonitorSettings) -> Data:
    """Position, speed or angle is not a number."""
    return {} if h.state is None else None


def off_line(h: ArmHistory, s: MonitorSettings) -> Data:
    """It is not on the straight line to its target, or moves though commanded nothing."""
    return {"mm": _mm(h.off_line_m())} if h.off_line_m() > OFF_LINE_M else None


def jumped(h: ArmHistory, s: MonitorSettings) -> Data:
    """It is further from where it was than any arm can have gone."""
    return {"mm": _mm(h.leapt_m)} if h.state and h.leapt_m > 0.0 else None


def flickers(h: ArmHistory, s: MonitorSettings) -> Data:
    """It reports by turns that it moves and that it stands."""
    return {} if h.flips.too_many else None


def frozen(h: ArmHistory, s: MonitorSettings) -> Data:
    """It keeps its place though it has to move, or though it reports that it does."""
    if h.state is None or not h.must_move:
        return None
    still_s = (h.state.t_ns - h.seen_moving[0]) * 1e-9
    pace = min(1.0, max(LEAST_PACE, h.state.speed_fraction))
    return {"seconds": round(still_s, 3)} if still_s > (s.arm_start_s + h.ramp_s) / pace else None


def goes_on(h: ArmHistory, s: MonitorSettings) -> Data:
    """Commanded to stop it goes further than braking takes, or on after it reported to stand."""
    if h.state is None or not h.stop:
        return None
    gone_m = math.dist(h.state.position_m, h.from_m)
    on_m = math.dist(h.state.position_m, h.stood_m or h.state.position_m)
    return {"mm": _mm(gone_m)} if gone_m > h.room_m + THERE_M or on_m > THERE_M else None


def _mm(m: float) -> float:
    return round(m * 1e3, 1)


def _speed(arm: ArmState) -> float:
    """0.0 where it stands."""
    speed_mps = math.hypot(*arm.velocity_mps)
    return speed_mps if speed_mps > STANDING_MPS else 0.0


def _distance(at_m: Vector3, start_m: Vector3, end_m: Vector3) -> float:
    """From the straight line between two points, its ends included."""
    x, y, z = (b - a for a, b in zip(start_m, end_m, strict=True))
    gone = u, v, w = at_m[0] - start_m[0], at_m[1] - start_m[1], at_m[2] - start_m[2]
    square = x * x + y * y + z * z
    share = (x * u + y * v + z * w) / square if square else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.dist(gone, (share * x, share * y, share * z))
