"""Simulation model of the arm in closed form: straight lines with trapezoidal speed, or a kept
velocity. Time is an argument.

A path is a chain of segments of constant acceleration; the last segment is at rest, or keeps the
commanded velocity. Rotation about the tool's z axis is a second chain. A command replaces both
chains from the controller cycle in which it takes effect. It changes nothing before that cycle,
nor before the time to which the world has been simulated. The speed slider slows down moves to a
target; kept velocities and stops are not scaled.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence

import msgspec

from drivers.interfaces import Vector3
from drivers.ur.driver import ArmSample
from drivers.ur.settings import ArmModelSettings

COMMAND_LATENCY_S = 0.002  # transmission to the controller, before the next cycle; assumed
SLIDER_S = 0.5  # from full speed to rest after the slider is moved; assumed
_PROTECTIVE_MPS2 = 8.0  # of a protective stop; assumed
ZERO: Vector3 = (0.0, 0.0, 0.0)
_STATIONARY_BELOW_MPS = 1e-8  # rounding to whole nanoseconds leaves this at the end of a line
_SAME_LINE_M = 1e-6  # a target this close to the present line counts as on it
_HISTORY = 32  # past segments kept: a few commands, far more than one control period


class Segment(msgspec.Struct, frozen=True):
    """Motion with constant acceleration from start_ns until the next segment begins."""

    start_ns: int
    origin_m: Vector3
    velocity_mps: Vector3
    acceleration_mps2: Vector3


class Rotation(msgspec.Struct, frozen=True):
    """Rotation about the tool's z axis with constant acceleration, like a ``Segment``."""

    start_ns: int
    origin_rad: float
    spin_radps: float
    acceleration_radps2: float


def _motion(chain: Sequence[Segment], t_ns: float) -> tuple[Vector3, Vector3, Vector3]:
    """Position, m, velocity, m/s, and acceleration, m/s2, in the last segment that has started."""
    for segment in reversed(chain):
        if segment.start_ns <= t_ns:
            break
    if segment.velocity_mps == ZERO and segment.acceleration_mps2 == ZERO:
        return segment.origin_m, ZERO, ZERO
    t = (t_ns - segment.start_ns) * 1e-9
    x, y, z = segment.origin_m
    u, v, w = segment.velocity_mps
    a, b, c = segment.acceleration_mps2
    return (
        (x + (u + 0.5 * a * t) * t, y + (v + 0.5 * b * t) * t, z + (w + 0.5 * c * t) * t),
        (u + a * t, v + b * t, w + c * t),
        segment.acceleration_mps2,
    )


def _turning(chain: Sequence[Rotation], t_ns: int) -> tuple[float, float]:
    """Angle, rad, and spin, rad/s, in the last part that has started."""
    for part in reversed(chain):
        if part.start_ns <= t_ns:
            break
    t = (t_ns - part.start_ns) * 1e-9
    angle = part.origin_rad + (part.spin_radps + 0.5 * part.acceleration_radps2 * t) * t
    return angle, part.spin_radps + part.acceleration_radps2 * (t_ns - part.start_ns) * 1e-9


class SpeedScaling:
    """Speed scaling by the speed slider.

    A line is planned at full speed, as a function of path time. The slider sets how fast path time
    runs: at a scale f, speeds are f times and accelerations f squared times the planned ones, on
    the same path. The scale changes linearly, one step per cycle.
    """

    def __init__(self, now_ns: int, period_ns: int) -> None:
        self.slider = 1.0
        self._period_ns = period_ns
        self._step = period_ns * 1e-9 / SLIDER_S
        self._scales: list[tuple[int, float]] = [(now_ns, 1.0)]  # each with its start

    @property
    def full(self) -> bool:
        """Whether the scale is 1 and was so all the time."""
        return len(self._scales) == 1 and self._scales[0][1] == 1.0

    def set_slider(self, slider: float, effect_ns: int) -> None:
        """Change the slider from a cycle on."""
        scale = self.at(effect_ns - 1)  # of the previous cycle
        past = [s for s in self._scales if s[0] < effect_ns]
        changes = math.ceil(abs(slider - scale) / self._step)
        step = math.copysign(self._step, slider - scale)
        ramp = [
            (effect_ns + i * self._period_ns, scale + (i + 1) * step) for i in range(changes - 1)
        ]
        there = (effect_ns + max(0, changes - 1) * self._period_ns, slider)
        self.slider, self._scales = slider, [*past, *ramp, there]

    def at(self, t_ns: int) -> float:
        """Scale at a time."""
        return self._scales[self._index(t_ns)][1]

    def discard_before(self, before_ns: int) -> None:
        """Discard scales before a time."""
        self._scales = self._scales[self._index(before_ns) :]

    def path_time_ns(self, from_ns: int, until_ns: int) -> float:
        """Path time that passes between two times."""
        path_ns, at_ns = 0.0, from_ns
        for i in range(self._index(from_ns), len(self._scales)):
            end_ns = self._scales[i + 1][0] if i + 1 < len(self._scales) else until_ns
            end_ns = min(end_ns, until_ns)
            if end_ns > at_ns:
                path_ns += self._scales[i][1] * (end_ns - at_ns)
                at_ns = end_ns
        return path_ns

    def scaled_path(self, line: Sequence[Segment], path_ns: float, now_ns: int) -> list[Segment]:
        """Rest of a line from its path time on, scaled. It ends at rest, or where the scale is
        0."""
        chain: list[Segment] = []
        starts = [s.start_ns for s in line]
        part = max(0, bisect_right(starts, path_ns) - 1)
        for i in range(self._index(now_ns), len(self._scales)):
            scale = self._scales[i][1]
            last = i + 1 == len(self._scales)
            until_ns = math.inf if last else self._scales[i + 1][0]
            while True:
                chain.append(_scaled_segment(line[part], path_ns, now_ns, scale))
                rests = part + 1 == len(line)
                left_ns = math.inf
                if not rests and scale > 0.0:
                    left_ns = (starts[part + 1] - path_ns) / scale
                if last and left_ns == math.inf:
                    return chain
                if now_ns + left_ns > until_ns:
                    break
                now_ns, path_ns, part = now_ns + round(left_ns), starts[part + 1], part + 1
            path_ns += scale * (until_ns - now_ns)
            now_ns = self._scales[i + 1][0]
        return chain

    def _index(self, t_ns: int) -> int:
        return max(0, bisect_right(self._scales, t_ns, key=lambda s: s[0]) - 1)


class ArmModel:
    """Arm model: a tool on straight lines. Commands take effect at the next controller cycle.

    A move commanded during another one continues at the present speed if its target lies ahead on
    the present line and beyond the stopping distance. Otherwise the tool first brakes on the
    present line, with the new move's acceleration, and starts from there. Requested times may
    precede the last commands by a few control periods only.
    """

    def __init__(
        self,
        settings: ArmModelSettings,
        now_ns: int,
        command_latency_s: float = COMMAND_LATENCY_S,
    ) -> None:
        self._period_ns = round(settings.period_s * 1e9)
        self._latency_ns = round(command_latency_s * 1e9)
        self._committed_ns = now_ns
        self._chain: list[Segment] = [_rest(now_ns, settings.start_m)]
        self._rotations: list[Rotation] = [Rotation(now_ns, 0.0, 0.0, 0.0)]
        self._scaling = SpeedScaling(now_ns, self._period_ns)
        self._line: list[Segment] = []  # of the last command, if it is a move: at full speed
        self._acceleration_mps2 = 1.2  # of the last motion; UR manual: movel's default
        self._stopping = False  # since the last motion command
        self._read_ns = now_ns
        self._read_timeout_ns: int | None = None  # a motion is braked when unread for so long
        self.payload_kg = 0.0
        self.protective_stop = False
        self.reversed_moves = False  # injected fault: moves away from its target
        self._corrupt: Callable[[ArmSample], ArmSample] | None = None

    def move_l(
        self, target_m: Vector3, speed_mps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        """Straight line to target_m; False, and no motion, during a safety stop."""
        if self.protective_stop:
            return False
        effect_ns = self._effect_ns(now_ns)
        at_m, direction, speed = self._present(effect_ns)
        if self.reversed_moves:
            target_m = ahead(times(at_m, 2.0), target_m, -1.0)
        speed = speed and speed / self._scaling.at(effect_ns)  # in path time
        chain: list[Segment] = []
        start_ns = effect_ns
        if speed and not _can_go_on(at_m, direction, target_m, speed**2, acceleration_mps2):
            speed = self._present(effect_ns)[2]
            chain = _brake(effect_ns, at_m, direction, speed, acceleration_mps2)
            start_ns, at_m, speed = chain[-1].start_ns, chain[-1].origin_m, 0.0
        line = _line(start_ns, at_m, target_m, speed, speed_mps, acceleration_mps2)
        self._scaling.discard_before(effect_ns)
        chain += line if self._scaling.full else self._scaling.scaled_path(line, start_ns, start_ns)
        self._replace_segments_from(effect_ns, chain)
        self._line, self._acceleration_mps2, self._stopping = line, acceleration_mps2, False
        self._spin_to(effect_ns, 0.0, acceleration_mps2)
        return True

    def speed_l(
        self, velocity_mps: Vector3, spin_radps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        """Change to this velocity and keep it (URScript's speedl). The tool also spins about its z
        axis, with the same acceleration in rad/s2. False during a safety stop."""
        if self.protective_stop:
            return False
        effect_ns = self._effect_ns(now_ns)
        at_m, from_mps, _ = _motion(self._chain, effect_ns)
        self._replace_segments_from(
            effect_ns, _ramp(effect_ns, at_m, from_mps, velocity_mps, acceleration_mps2)
        )
        self._acceleration_mps2, self._stopping = acceleration_mps2, False
        self._spin_to(effect_ns, spin_radps, acceleration_mps2)
        return True

    def set_speed_slider(self, fraction: float, now_ns: int) -> None:
        """Set the speed slider, 0 to 1; it scales moves to a target."""
        effect_ns = self._effect_ns(now_ns)
        self._scaling.set_slider(fraction, effect_ns)
        line = self._line
        if not line:
            return
        began_ns = line[0].start_ns
        from_ns = max(began_ns, effect_ns)
        path_ns = began_ns + self._scaling.path_time_ns(began_ns, from_ns)
        if path_ns < line[-1].start_ns:  # the line is not finished
            self._replace_segments_from(from_ns, self._scaling.scaled_path(line, path_ns, from_ns))
            self._line = line

    def speed_scaling(self, t_ns: int) -> float:
        """Speed scale of moves at a time."""
        return self._scaling.at(t_ns)

    def stop_l(self, deceleration_mps2: float, now_ns: int) -> None:
        """Brake along the present line, from the speed at the time when this takes effect."""
        self._stopping = True
        effect_ns = self._effect_ns(now_ns)
        at_m, direction, speed = self._present(effect_ns)
        self._replace_segments_from(
            effect_ns, _brake(effect_ns, at_m, direction, speed, deceleration_mps2)
        )
        self._spin_to(effect_ns, 0.0, deceleration_mps2)

    def trip(self, now_ns: int) -> None:
        """Protective stop: brake hard and refuse to move until released."""
        self.protective_stop = True
        self.stop_l(_PROTECTIVE_MPS2, now_ns)

    def misreport(self, corruption: Callable[[ArmSample], ArmSample]) -> None:
        """Fault injection: from now on ``corruption`` is applied to every sample."""
        self._corrupt = corruption

    def release(self) -> None:
        """End the protective stop, as on the teach pendant; the arm does not move."""
        self.protective_stop = False

    def set_payload(self, mass_kg: float) -> None:
        self.payload_kg = mass_kg

    def brake_when_unread(self, after_s: float) -> None:
        """Brake a motion when the arm is not read for so long. A driver's worker does that
        for a caller that stops reading (``ur.heartbeat_timeout_s``)."""
        self._read_timeout_ns = round(after_s * 1e9)

    def advance(self, until_ns: int) -> tuple[Vector3, Vector3, Vector3]:
        """Simulate to a time; returns position, m, velocity, m/s, and acceleration, m/s2. The
        motion up to then is fixed: later commands take effect after it, even those of a controller
        that catches up on cycles."""
        if self._read_timeout_ns is not None and not self._stopping:
            alone_ns = self._read_ns + self._read_timeout_ns
            if until_ns > alone_ns:
                self.stop_l(self._acceleration_mps2, alone_ns)
        if until_ns > self._committed_ns:
            self._committed_ns = until_ns
        return _motion(self._chain, until_ns)

    def at(self, t_ns: int) -> ArmSample:
        """True state at a time."""
        position_m, velocity_mps, acceleration_mps2 = _motion(self._chain, t_ns)
        angle_rad, spin_radps = _turning(self._rotations, t_ns)
        moving = velocity_mps != ZERO or acceleration_mps2 != ZERO or spin_radps != 0.0
        return ArmSample(
            t_ns, position_m, velocity_mps, moving, self.protective_stop,
            angle_rad, spin_radps, self._scaling.slider,
        )  # fmt: skip

    def read(self, now_ns: int) -> ArmSample:
        """The controller's sample of its last cycle."""
        self._read_ns = max(self._read_ns, now_ns)
        sample = self.at(now_ns // self._period_ns * self._period_ns)
        return sample if self._corrupt is None else self._corrupt(sample)

    def _effect_ns(self, now_ns: int) -> int:
        """First controller cycle in which a command takes effect."""
        t_ns = max(now_ns + self._latency_ns, self._committed_ns)
        return -(-t_ns // self._period_ns) * self._period_ns

    def _present(self, t_ns: int) -> tuple[Vector3, Vector3, float]:
        """Position, unit vector of the velocity, speed."""
        at_m, (x, y, z), _ = _motion(self._chain, t_ns)
        speed = math.hypot(x, y, z)
        if speed < _STATIONARY_BELOW_MPS:
            return at_m, ZERO, 0.0
        return at_m, (x / speed, y / speed, z / speed), speed

    def _spin_to(self, effect_ns: int, spin_radps: float, acceleration_radps2: float) -> None:
        angle, spin = _turning(self._rotations, effect_ns)
        change_s = abs(spin_radps - spin) / acceleration_radps2
        end_ns = effect_ns + round(change_s * 1e9)
        past = [turn for turn in self._rotations if turn.start_ns < effect_ns][-_HISTORY:]
        ramp = math.copysign(acceleration_radps2, spin_radps - spin)
        chain = [Rotation(effect_ns, angle, spin, ramp)] if change_s else []
        reached = angle + 0.5 * (spin + spin_radps) * change_s
        self._rotations = [*past, *chain, Rotation(end_ns, reached, spin_radps, 0.0)]

    def _replace_segments_from(self, effect_ns: int, chain: list[Segment]) -> None:
        self._line = []
        past = [segment for segment in self._chain if segment.start_ns < effect_ns]
        self._chain = past[-_HISTORY:] + chain


def _rest(start_ns: int, at_m: Vector3) -> Segment:
    return Segment(start_ns, at_m, ZERO, ZERO)


def _ramp(
    start_ns: int, at_m: Vector3, from_mps: Vector3, to_mps: Vector3, acceleration_mps2: float
) -> list[Segment]:
    """Change from one velocity to another, which is then kept."""
    change_s = math.dist(from_mps, to_mps) / acceleration_mps2
    if change_s == 0.0:
        return [Segment(start_ns, at_m, to_mps, ZERO)]
    x, y, z = ((b - a) / change_s for a, b in zip(from_mps, to_mps, strict=True))
    ramp = Segment(start_ns, at_m, from_mps, (x, y, z))
    end_ns = start_ns + round(change_s * 1e9)
    return [ramp, Segment(end_ns, _motion([ramp], end_ns)[0], to_mps, ZERO)]


def _can_go_on(
    at_m: Vector3, direction: Vector3, target_m: Vector3, speed_squared: float, braking: float
) -> bool:
    """True when the target is ahead on the line, no nearer than the stopping distance."""
    along = sum(d * (b - a) for d, a, b in zip(direction, at_m, target_m, strict=True))
    on_line = math.dist(ahead(at_m, direction, along), target_m) <= _SAME_LINE_M
    return on_line and along >= speed_squared / (2.0 * braking)


def _brake(
    start_ns: int, at_m: Vector3, direction: Vector3, speed: float, deceleration: float
) -> list[Segment]:
    """Brake from the present speed to rest; only the rest if there is no speed."""
    if speed == 0.0:
        return [_rest(start_ns, at_m)]
    stop_ns = start_ns + round(speed / deceleration * 1e9)
    stop_m = ahead(at_m, direction, speed**2 / (2.0 * deceleration))
    braking = times(direction, -deceleration)
    return [Segment(start_ns, at_m, times(direction, speed), braking), _rest(stop_ns, stop_m)]


def _line(
    start_ns: int, at_m: Vector3, target_m: Vector3, v0: float, speed: float, acceleration: float
) -> list[Segment]:
    """Accelerate to ``speed`` from v0, cruise, and brake to rest exactly at the target.

    Where the distance d is too short for that, the peak speed v follows from
    (v^2 - v0^2) / 2a + v^2 / 2a = d.
    """
    distance = math.dist(at_m, target_m)
    if distance == 0.0:
        return [_rest(start_ns, target_m)]
    x, y, z = ((b - a) / distance for a, b in zip(at_m, target_m, strict=True))
    peak = min(speed, math.sqrt(acceleration * distance + 0.5 * v0**2))
    change_s, brake_s = abs(peak - v0) / acceleration, peak / acceleration
    cruise_m = distance - 0.5 * (v0 + peak) * change_s - 0.5 * peak * brake_s
    phases = (
        (change_s, v0, math.copysign(acceleration, peak - v0)),
        (max(0.0, cruise_m) / peak, peak, 0.0),
        (brake_s, peak, -acceleration),
    )
    chain: list[Segment] = []
    t, s = 0.0, 0.0
    for duration, v, a in phases:
        origin = ahead(at_m, (x, y, z), s)
        begins_ns = start_ns + round(t * 1e9)
        chain.append(Segment(begins_ns, origin, times((x, y, z), v), times((x, y, z), a)))
        t, s = t + duration, s + (v + 0.5 * a * duration) * duration
    return [*chain, _rest(start_ns + round(t * 1e9), target_m)]


def ahead(origin: Vector3, direction: Vector3, distance: float) -> Vector3:
    (x, y, z), (dx, dy, dz) = origin, direction
    return x + distance * dx, y + distance * dy, z + distance * dz


def times(direction: Vector3, size: float) -> Vector3:
    x, y, z = direction
    return x * size, y * size, z * size


def _scaled_segment(part: Segment, path_ns: float, now_ns: int, scale: float) -> Segment:
    at_m, velocity_mps, acceleration_mps2 = _motion([part], path_ns)
    return Segment(
        now_ns, at_m, times(velocity_mps, scale), times(acceleration_mps2, scale * scale)
    )
