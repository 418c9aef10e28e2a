"""What an arm says and cannot be: the part of ``grasp.doubt`` that watches it."""

import math

from drivers.interfaces import ArmState, Vector3
from grasp.commands import MoveArm, StopArm
from grasp.doubt_settings import DoubtSettings
from grasp.flicker import Flicker
from grasp.state_clock import LEAST_PACE

NOWHERE: Vector3 = (0.0, 0.0, 0.0)


class ArmDoubt:
    """Positions that cannot be, or do not follow what the arm was told. Times are those at which
    the controller's own clock was seen to run."""

    def __init__(self, settings: DoubtSettings) -> None:
        self._settings = settings
        self._before: ArmState | None = None
        self._command: MoveArm | None = None  # on which it is on its way
        self._way = self._old_way = _Way(NOWHERE, NOWHERE)  # and before that was told
        self._spare_s = 0.0  # to turn round
        self._anchor: tuple[int, Vector3] = (0, NOWHERE)  # last motion seen
        self._started = False
        self._stop: StopArm | None = None  # it was told so, last
        self._anew_ns = -1  # until then it may say what nobody saw it do
        self._stood_m: Vector3 | None = None  # where it said first that it does
        self._stop_m: Vector3 = NOWHERE  # where it was told to stop, and its way from there
        self._room_m = 0.0
        self._stop_left = False  # it was not on its way any more
        self._flickers = Flicker()
        self._late_s = 0.0  # by how much what it says may have come later than before
        self._pace = 1.0  # that it has come to by its speed slider

    def told(self, command: MoveArm | StopArm, arm: ArmState) -> None:
        """A command goes out while the arm is like this."""
        if not (self._stop and isinstance(command, StopArm)):  # a stop is told again and again
            self._flickers.told()
        if isinstance(command, StopArm):
            if not self._stop:
                self._anchor = (arm.t_ns, arm.position_m)
                self._stop_m, self._room_m = arm.position_m, self._brakes_m(command, arm)
                self._stop_left = False
            self._way.stop(arm, self._fastest_mps(arm), command.deceleration_mps2)
            self._command, self._stop = None, command
            self._spare_s = self._ramp_s(command.deceleration_mps2)
            return
        self._command, self._started, self._stop = command, False, None
        self._old_way, self._way = self._way, self._way_of(command, arm)
        self._spare_s = self._ramp_s(command.acceleration_mps2)
        self._anchor = (arm.t_ns, arm.position_m)

    def _fastest_mps(self, arm: ArmState) -> float:
        """That it may come to before a stop, which is told now, has reached it."""
        speed_mps, command = math.hypot(*arm.velocity_mps), self._command
        if command is None:
            return speed_mps
        later_mps = speed_mps + command.acceleration_mps2 * self._settings.arm_frozen_s
        return max(speed_mps, min(command.speed_mps, later_mps))

    def _brakes_m(self, command: StopArm, arm: ArmState) -> float:
        """How far a stop may take, which acts no later than a move does."""
        s, fastest_mps = self._settings, self._fastest_mps(arm)
        braking_m = fastest_mps**2 / (2.0 * command.deceleration_mps2)
        return fastest_mps * s.arm_start_s + braking_m + s.arm_there_m

    def _ramp_s(self, ramp_mps2: float) -> float:
        """Twice as long as an arm that begins or ends to move takes for what counts as motion."""
        return 2.0 * math.sqrt(2.0 * self._settings.arm_moved_m / ramp_mps2)

    def _way_of(self, command: MoveArm, arm: ArmState) -> "_Way":
        """With room to brake in where it has to turn round."""
        if _lies_ahead(arm, command, self._settings):
            return _Way(arm.position_m, command.position_m)
        speed_mps = math.hypot(*arm.velocity_mps)
        braking_m = speed_mps**2 / (2.0 * command.acceleration_mps2)
        spare_m = braking_m + speed_mps * self._settings.arm_start_s
        x, y, z = (v / speed_mps for v in arm.velocity_mps)
        return _Way(arm.position_m, command.position_m, spare_m, (x, y, z))

    def see(self, arm: ArmState, pending: bool) -> str:
        """What is wrong with it. ``pending``: what it was told is still on its way."""
        if not all(map(math.isfinite, (*arm.position_m, *arm.velocity_mps, arm.angle_rad))):
            return "arm_position_nan: position or speed of the arm is not a number"
        if not 0.0 <= arm.speed_fraction <= 1.0:
            return f"arm_slider: a speed slider cannot stand at {100 * arm.speed_fraction:.3g} %"
        before, self._before = self._before, arm
        self._slow(before, arm)
        apart_s = 0.0 if before is None else self._apart_s(before, arm)
        if before is None:
            self._way = _Way(arm.position_m, arm.position_m)
            self._anchor = (arm.t_ns, arm.position_m)
            return ""
        if pending and not self._started:
            self._anchor = (arm.t_ns, arm.position_m)
        if arm.t_ns <= self._anew_ns:
            self._forget(arm)
            return self._strayed(arm, pending)
        if self._stop and pending and not self._stop_left:  # it cannot know of it yet
            self._stop_m = arm.position_m
        self._stop_left = self._stop_left or not pending
        strayed = self._strayed(arm, pending)
        wrong = self._jumped(before, arm, apart_s) or strayed or self._went_on(arm)
        if not wrong and self._flickers.take(arm.t_ns, arm.moving):
            return "arm_flickers: it says again and again that it moves and that it stands"
        return wrong or self._froze(arm, pending)

    def _slow(self, before: ArmState | None, arm: ArmState) -> None:
        """An arm whose slider is turned up takes a while to be as fast."""
        passed_s = 0.0 if before is None else (arm.t_ns - before.t_ns) * 1e-9
        faster = self._pace + max(0.0, passed_s) / self._settings.arm_slider_s
        self._pace = max(LEAST_PACE, min(arm.speed_fraction, faster))

    def begin_anew(self, arm: ArmState, late_ns: int) -> None:
        """For so long nobody saw what it did. It went on, and what it said meanwhile may be heard
        only now, all at once: as long as a command may take to be heard, it is no leap, and where a
        stop finds it is where it is then."""
        seen_ns = (self._before or arm).t_ns
        woken_ns = max(arm.t_ns, seen_ns + late_ns)
        self._anew_ns = woken_ns + round(self._settings.arm_start_s * 1e9)

    def _forget(self, arm: ArmState) -> None:
        """All that what it says next would be held against, but its line."""
        self._anchor = (arm.t_ns, arm.position_m)
        self._stood_m = None
        self._flickers.told()
        if self._stop:
            self._stop_m, self._room_m = arm.position_m, self._brakes_m(self._stop, arm)

    def _went_on(self, arm: ArmState) -> str:
        """Told to stop, it goes further than braking takes, or goes on when it says that it stands:
        one that obeys no stop ends its move, and stands then."""
        gone_m = math.dist(arm.position_m, self._stop_m)
        if self._stop and gone_m > self._room_m:
            return f"arm_goes_on: {gone_m * 1e3:.0f} mm since it was told to stop"
        if not self._stop or arm.moving:
            self._stood_m = None
            return ""
        self._stood_m = self._stood_m or arm.position_m
        way_m = math.dist(arm.position_m, self._stood_m)
        if way_m > self._settings.arm_there_m:
            return f"arm_goes_on: {way_m * 1e3:.0f} mm since it said that it stands"
        return ""

    def _apart_s(self, before: ArmState, arm: ArmState) -> float:
        """How long passed between two samples: by the controller's own clock, for who reads it may
        have been kept waiting and hear then of more than he waited for now. But no longer than has
        passed here beside what that clock was behind before: one that lies makes room for no leap,
        nor does one that stands still or runs back."""
        here_s = (arm.t_ns - before.t_ns) * 1e-9
        if arm.sampled_ns is None or before.sampled_ns is None:
            return here_s
        there_s = max(0, arm.sampled_ns - before.sampled_ns) * 1e-9
        most_s = here_s + self._late_s
        self._late_s = min(max(0.0, most_s - there_s), self._settings.arm_start_s)
        return min(there_s, most_s)

    def _jumped(self, before: ArmState, arm: ArmState, apart_s: float) -> str:
        s = self._settings
        way_m = math.dist(before.position_m, arm.position_m)
        if way_m > s.arm_jump_m + s.arm_fastest_mps * apart_s:
            return f"arm_jump: {way_m:.3f} m from one sample to the next"
        return ""

    def _strayed(self, arm: ArmState, pending: bool) -> str:
        s, way = self._settings, self._way
        if pending and way.turns and self._command is not None:  # it goes on as before
            way, self._way = self._old_way, self._way_of(self._command, arm)
        turned = way.turns
        beyond_m = way.beyond_m(arm.position_m, s)
        if turned and not way.turns:
            self._anchor = (arm.t_ns, arm.position_m)
        if beyond_m > s.arm_astray_m:
            return f"arm_wrong_way: {beyond_m * 1e3:.0f} mm away from where it was told to be"
        return ""

    def _froze(self, arm: ArmState, pending: bool) -> str:
        s, (since_ns, there_m) = self._settings, self._anchor
        if math.dist(arm.position_m, there_m) > s.arm_moved_m:
            self._anchor = (arm.t_ns, arm.position_m)
            self._started = self._command is not None and not pending
            return ""
        command, still_s = self._command, (arm.t_ns - since_ns) * 1e-9
        if command is None or math.dist(arm.position_m, command.position_m) <= s.arm_there_m:
            patience_s = (s.arm_frozen_s if self._stop else s.arm_start_s) + self._spare_s
            if arm.moving and still_s > patience_s / self._pace:
                return f"arm_frozen: {still_s:.2f} s at one place, and it says that it moves"
            if not arm.moving:
                self._anchor = (arm.t_ns, arm.position_m)
            return ""
        limit_s = s.arm_frozen_s if self._started else s.arm_start_s
        if self._way.turns or not self._started:
            limit_s += self._spare_s
        if still_s > limit_s / self._pace:
            return f"arm_frozen: {still_s:.2f} s at one place while told to move"
        return ""


class _Way:
    """A straight line that an arm was told to move along, and how far it has got."""

    def __init__(
        self,
        start_m: Vector3,
        end_m: Vector3,
        spare_m: float = 0.0,
        heading: Vector3 | None = None,
    ) -> None:
        """``spare_m``: to brake in along ``heading``, a unit vector: it must turn round first."""
        self._start_m, self._end_m = start_m, end_m
        self._target_m = end_m  # of the move; told to stop, the arm may end beyond it
        self._stop_mps2 = math.inf
        self._spare_m, self._heading = spare_m, heading
        self._least_m = math.dist(start_m, end_m)  # from its end, so far
        self._furthest_m = 0.0  # along its heading

    @property
    def turns(self) -> bool:
        """It must turn round and has not yet."""
        return self._heading is not None

    def stop(self, arm: ArmState, speed_mps: float, deceleration_mps2: float) -> None:
        """The arm is told to on it: it may end past the target by what braking takes from that
        speed, where that is gentler than the end of the move. One that is past it already gets no
        more room by being told again."""
        way_m = math.dist(self._start_m, self._target_m)
        past_m = math.dist(arm.position_m, self._start_m) - way_m
        again = past_m > 0.0 and deceleration_mps2 >= self._stop_mps2
        if self.turns or again or not way_m:
            return
        self._stop_mps2 = deceleration_mps2
        braking_m = speed_mps**2 / (2.0 * deceleration_mps2)
        over = (max(0.0, past_m) + braking_m) / way_m
        ends = zip(self._start_m, self._target_m, strict=True)
        x, y, z = (b + over * (b - a) for a, b in ends)
        self._end_m = (x, y, z)
        self._least_m = math.dist(arm.position_m, self._end_m)

    def beyond_m(self, at_m: Vector3, s: DoubtSettings) -> float:
        """How far from the line, or back on it, that is, beyond what braking takes."""
        away_m = math.dist(at_m, self._end_m)
        self._least_m = min(self._least_m, away_m)
        aside_m = _off_line(at_m, self._start_m, self._end_m)
        beyond_m = max(aside_m, away_m - self._least_m) - self._spare_m
        if self._heading is not None and self._has_turned(at_m, self._heading, s):
            self._heading, self._spare_m = None, 0.0
            self._start_m, self._least_m = at_m, away_m
        return beyond_m

    def _has_turned(self, at_m: Vector3, heading: Vector3, s: DoubtSettings) -> bool:
        """It comes back, or has left the line on which it brakes. That it comes nearer to its end
        tells nothing: an end too near to brake for is passed first."""
        gone = [b - a for a, b in zip(self._start_m, at_m, strict=True)]
        along_m = sum(a * b for a, b in zip(gone, heading, strict=True))
        aside_m = math.sqrt(max(0.0, sum(x * x for x in gone) - along_m**2))
        self._furthest_m = max(self._furthest_m, along_m)
        return aside_m > s.arm_line_m or along_m < self._furthest_m - s.arm_moved_m


def _lies_ahead(arm: ArmState, command: MoveArm, s: DoubtSettings) -> bool:
    """Whether the arm stands, or goes towards there and can brake in time."""
    way = [b - a for a, b in zip(arm.position_m, command.position_m, strict=True)]
    speed_mps, way_m = math.hypot(*arm.velocity_mps), math.hypot(*way)
    if speed_mps < s.arm_standing_mps:
        return True
    along_m = sum(v * x for v, x in zip(arm.velocity_mps, way, strict=True)) / speed_mps
    aside_m = math.sqrt(max(0.0, way_m**2 - along_m**2))
    return aside_m < s.arm_line_m and along_m >= speed_mps**2 / (2.0 * command.acceleration_mps2)


def _off_line(at_m: Vector3, start_m: Vector3, end_m: Vector3) -> float:
    """Distance from the straight line between two points, its ends included."""
    x0, y0, z0 = start_m
    x, y, z = end_m[0] - x0, end_m[1] - y0, end_m[2] - z0
    gone = u, v, w = at_m[0] - x0, at_m[1] - y0, at_m[2] - z0
    square = x * x + y * y + z * z
    share = (x * u + y * v + z * w) / square if square else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.dist(gone, (share * x, share * y, share * z))
