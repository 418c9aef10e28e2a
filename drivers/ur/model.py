"""What the arm does: straight lines with trapezoidal speed, or a velocity that is kept, in closed
form; time is an argument.

A path is a chain of segments of constant acceleration; the last one is at rest, or keeps the
velocity that was asked for. The turn of the tool about its own axis is a second, shorter chain. A
command replaces the part of the chains from the controller cycle in which it takes effect, and
nothing before it, nor what a world that is ahead of its controller has seen. The speed slider slows
down what moves to a place; velocities that are kept, and stops, are what they are told to be.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import Annotated

import msgspec
from msgspec import Meta

from drivers.interfaces import Vector3
from drivers.ur.driver import ArmSample

COMMAND_LATENCY_S = 0.002  # on the way to the controller, before it waits for a cycle; assumed
SLIDER_S = 0.5  # from full pace to none after the slider is turned; assumed
_PROTECTIVE_MPS2 = 8.0  # of a protective stop; assumed
STANDING: Vector3 = (0.0, 0.0, 0.0)
_STANDING_BELOW_MPS = 1e-8  # what rounding to whole nanoseconds leaves at the end of a line
_SAME_LINE_M = 1e-6  # a target this close to the present line counts as lying on it
_HISTORY = 32  # past segments kept: a few commands, hence far more than one control period


class ArmModelSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The modelled controller."""

    start_m: Vector3 = (0.5, 0.1, 0.3)  # tool position at power-up, base frame
    period_s: Annotated[
        float, Meta(ge=0.001, le=0.02, description="s, controller cycle; UR manual: CB3 125 Hz")
    ] = 0.008


class Segment(msgspec.Struct, frozen=True):
    """Constant acceleration from start_ns on, until the next segment begins."""

    start_ns: int
    origin_m: Vector3
    velocity_mps: Vector3
    acceleration_mps2: Vector3

    @property
    def at_rest(self) -> bool:
        return self.velocity_mps == STANDING and self.acceleration_mps2 == STANDING

    def position(self, t_ns: float) -> Vector3:
        t = (t_ns - self.start_ns) * 1e-9
        (x, y, z), (u, v, w), (a, b, c) = self.origin_m, self.velocity_mps, self.acceleration_mps2
        return x + (u + 0.5 * a * t) * t, y + (v + 0.5 * b * t) * t, z + (w + 0.5 * c * t) * t

    def velocity(self, t_ns: float) -> Vector3:
        return ahead(self.velocity_mps, self.acceleration_mps2, (t_ns - self.start_ns) * 1e-9)

    def upright(self, t_ns: int) -> tuple[float, float]:
        """Height, m, and speed upwards, m/s: the last of ``position`` and of ``velocity``."""
        t = (t_ns - self.start_ns) * 1e-9
        z, w, c = self.origin_m[2], self.velocity_mps[2], self.acceleration_mps2[2]
        return z + (w + 0.5 * c * t) * t, w + c * t


class Turn(msgspec.Struct, frozen=True):
    """The same about the tool's axis."""

    start_ns: int
    origin_rad: float
    spin_radps: float
    acceleration_radps2: float

    def angle(self, t_ns: int) -> float:
        t = (t_ns - self.start_ns) * 1e-9
        return self.origin_rad + (self.spin_radps + 0.5 * self.acceleration_radps2 * t) * t

    def spin(self, t_ns: int) -> float:
        return self.spin_radps + self.acceleration_radps2 * (t_ns - self.start_ns) * 1e-9


class Pace:
    """The speed slider: at what share of its pace the arm moves along a line.

    A line is planned at full pace, in its own time; the slider says how fast that time runs: at a
    share f, speeds are f times and accelerations f squared times the planned ones, on the same
    path. The share changes evenly, a step a cycle.
    """

    def __init__(self, now_ns: int, period_ns: int) -> None:
        self.slider = 1.0
        self._period_ns = period_ns
        self._step = period_ns * 1e-9 / SLIDER_S
        self._shares: list[tuple[int, float]] = [(now_ns, 1.0)]  # from when on

    @property
    def full(self) -> bool:
        """Nobody has ever touched the slider, or all is as if nobody had."""
        return len(self._shares) == 1 and self._shares[0][1] == 1.0

    def turn(self, slider: float, effect_ns: int) -> None:
        """From a cycle on."""
        share = self.at(effect_ns - 1)  # of the cycle before
        past = [s for s in self._shares if s[0] < effect_ns]
        changes = math.ceil(abs(slider - share) / self._step)
        step = math.copysign(self._step, slider - share)
        ramp = [
            (effect_ns + i * self._period_ns, share + (i + 1) * step) for i in range(changes - 1)
        ]
        there = (effect_ns + max(0, changes - 1) * self._period_ns, slider)
        self.slider, self._shares = slider, [*past, *ramp, there]

    def at(self, t_ns: int) -> float:
        """The share then."""
        return self._shares[self._index(t_ns)][1]

    def forget(self, before_ns: int) -> None:
        """Nobody asks for what was earlier."""
        self._shares = self._shares[self._index(before_ns) :]

    def own_ns(self, from_ns: int, until_ns: int) -> float:
        """How much own time passes."""
        own_ns, at_ns = 0.0, from_ns
        for i in range(self._index(from_ns), len(self._shares)):
            end_ns = self._shares[i + 1][0] if i + 1 < len(self._shares) else until_ns
            end_ns = min(end_ns, until_ns)
            if end_ns > at_ns:
                own_ns += self._shares[i][1] * (end_ns - at_ns)
                at_ns = end_ns
        return own_ns

    def slowed(self, line: Sequence[Segment], own_ns: float, now_ns: int) -> list[Segment]:
        """What is left of a line, whose own time it is, from now on. It ends with a rest, or where
        the slider does not let it go on."""
        chain: list[Segment] = []
        starts = [s.start_ns for s in line]
        part = max(0, bisect_right(starts, own_ns) - 1)
        for i in range(self._index(now_ns), len(self._shares)):
            share = self._shares[i][1]
            last = i + 1 == len(self._shares)
            until_ns = math.inf if last else self._shares[i + 1][0]
            while True:
                chain.append(_at_share(line[part], own_ns, now_ns, share))
                rests = part + 1 == len(line)
                left_ns = math.inf
                if not rests and share > 0.0:
                    left_ns = (starts[part + 1] - own_ns) / share
                if last and left_ns == math.inf:
                    return chain
                if now_ns + left_ns > until_ns:
                    break
                now_ns, own_ns, part = now_ns + round(left_ns), starts[part + 1], part + 1
            own_ns += share * (until_ns - now_ns)
            now_ns = self._shares[i + 1][0]
        return chain

    def _index(self, t_ns: int) -> int:
        return max(0, bisect_right(self._shares, t_ns, key=lambda s: s[0]) - 1)


class ArmModel:
    """A tool on straight lines. Commands take effect at the next controller cycle.

    A move commanded while another is under way goes on from the present speed if its target lies
    ahead on the present line and far enough to stop there. Otherwise the tool first brakes on the
    present line, with the new move's acceleration, and leaves from where it stopped.
    Times asked for may precede the last commands by a few control periods, not more.
    """

    def __init__(
        self,
        settings: ArmModelSettings,
        now_ns: int,
        command_latency_s: float = COMMAND_LATENCY_S,
    ) -> None:
        self._period_ns = round(settings.period_s * 1e9)
        self._latency_ns = round(command_latency_s * 1e9)
        self._seen_ns = now_ns
        self._chain: list[Segment] = [_rest(now_ns, settings.start_m)]
        self._starts = [now_ns]
        self._turns: list[Turn] = [Turn(now_ns, 0.0, 0.0, 0.0)]
        self._pace = Pace(now_ns, self._period_ns)
        self._line: list[Segment] = []  # of the last command, if a move: at full pace
        self._acceleration_mps2 = 1.2  # of the last motion; UR manual: movel's default
        self._stopping = False  # since the last motion was told
        self._read_ns = now_ns
        self._alone_ns: int | None = None  # unread for so long it is braked
        self.payload_kg = 0.0
        self.protective_stop = False
        self.contrary = False  # a fault: moves away from where it is told to go
        self._corrupt: Callable[[ArmSample], ArmSample] = lambda sample: sample

    def move_l(
        self, target_m: Vector3, speed_mps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        """Straight line to target_m; False, and no motion, while stopped by safety."""
        if self.protective_stop:
            return False
        effect_ns = self._effect_ns(now_ns)
        at_m, direction, speed = self._present(effect_ns)
        if self.contrary:
            target_m = ahead(times(at_m, 2.0), target_m, -1.0)
        speed = speed and speed / self._pace.at(effect_ns)  # in the own time of a line
        chain: list[Segment] = []
        start_ns = effect_ns
        if speed and not _can_go_on(at_m, direction, target_m, speed**2, acceleration_mps2):
            speed = self._present(effect_ns)[2]
            chain = _brake(effect_ns, at_m, direction, speed, acceleration_mps2)
            start_ns, at_m, speed = chain[-1].start_ns, chain[-1].origin_m, 0.0
        line = _line(start_ns, at_m, target_m, speed, speed_mps, acceleration_mps2)
        self._pace.forget(effect_ns)
        chain += line if self._pace.full else self._pace.slowed(line, start_ns, start_ns)
        self._replace_from(effect_ns, chain)
        self._line, self._acceleration_mps2, self._stopping = line, acceleration_mps2, False
        self._spin_to(effect_ns, 0.0, acceleration_mps2)
        return True

    def speed_l(
        self, velocity_mps: Vector3, spin_radps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        """Change to this velocity and keep it; the tool also spins about its own axis, at an
        acceleration of the same number in rad/s2 (URScript's speedl). False while stopped by
        safety."""
        if self.protective_stop:
            return False
        effect_ns = self._effect_ns(now_ns)
        present = self._at(effect_ns)
        at_m, from_mps = present.position(effect_ns), present.velocity(effect_ns)
        self._replace_from(
            effect_ns, _ramp(effect_ns, at_m, from_mps, velocity_mps, acceleration_mps2)
        )
        self._acceleration_mps2, self._stopping = acceleration_mps2, False
        self._spin_to(effect_ns, spin_radps, acceleration_mps2)
        return True

    def turn_slider(self, fraction: float, now_ns: int) -> None:
        """Of full pace, 0 to 1: what is on its way to a place goes on at that."""
        effect_ns = self._effect_ns(now_ns)
        self._pace.turn(fraction, effect_ns)
        line = self._line
        if not line:
            return
        began_ns = line[0].start_ns
        from_ns = max(began_ns, effect_ns)
        own_ns = began_ns + self._pace.own_ns(began_ns, from_ns)
        if own_ns < line[-1].start_ns:  # it has not come to its end
            self._replace_from(from_ns, self._pace.slowed(line, own_ns, from_ns))
            self._line = line

    def pace(self, t_ns: int) -> float:
        """The share of full pace that moves have."""
        return self._pace.at(t_ns)

    def stop_l(self, deceleration_mps2: float, now_ns: int) -> None:
        """Brake along the present line, from the speed that the tool has when this takes effect."""
        self._stopping = True
        effect_ns = self._effect_ns(now_ns)
        at_m, direction, speed = self._present(effect_ns)
        self._replace_from(effect_ns, _brake(effect_ns, at_m, direction, speed, deceleration_mps2))
        self._spin_to(effect_ns, 0.0, deceleration_mps2)

    def trip(self, now_ns: int) -> None:
        """Protective stop: brake hard and refuse to move until released."""
        self.protective_stop = True
        self.stop_l(_PROTECTIVE_MPS2, now_ns)

    def misreport(self, corruption: Callable[[ArmSample], ArmSample]) -> None:
        """A fault: from now on a sample is what ``corruption`` makes of it."""
        self._corrupt = corruption

    def release(self) -> None:
        """End the protective stop, as the teach pendant does; the arm stays where it stands."""
        self.protective_stop = False

    def set_payload(self, mass_kg: float) -> None:
        self.payload_kg = mass_kg

    def brake_unread(self, after_s: float | None) -> None:
        """From now on brake a motion when nobody has read for so long: a driver's worker does it
        for an arm whose caller stands still (``ur.heartbeat_timeout_s``). None: never."""
        self._alone_ns = None if after_s is None else round(after_s * 1e9)

    def go_on(self, until_ns: int) -> None:
        """The world is about to come so far: what the arm does by itself by then."""
        if self._alone_ns is None or self._stopping:
            return
        alone_ns = self._read_ns + self._alone_ns
        if until_ns > alone_ns:
            self.stop_l(self._acceleration_mps2, alone_ns)

    def seen(self, until_ns: int) -> None:
        """The world has come so far: that stays as it was, whatever a controller commands that has
        yet to make up for cycles of before."""
        self._seen_ns = max(self._seen_ns, until_ns)

    def position(self, t_ns: int) -> Vector3:
        return self._at(t_ns).position(t_ns)

    def velocity(self, t_ns: int) -> Vector3:
        return self._at(t_ns).velocity(t_ns)

    def upright(self, t_ns: int) -> tuple[float, float]:
        """Height, m, and speed upwards, m/s."""
        return self._at(t_ns).upright(t_ns)

    def angle(self, t_ns: int) -> float:
        """Turn of the tool about its own axis since the start, rad."""
        return self._turning(t_ns).angle(t_ns)

    def spin(self, t_ns: int) -> float:
        return self._turning(t_ns).spin(t_ns)

    def moving(self, t_ns: int) -> bool:
        return not self._at(t_ns).at_rest or self.spin(t_ns) != 0.0

    def read(self, now_ns: int) -> ArmSample:
        """The controller's sample of its last cycle."""
        self._read_ns = max(self._read_ns, now_ns)
        t_ns = now_ns // self._period_ns * self._period_ns
        segment, turn = self._at(t_ns), self._turning(t_ns)
        spin_radps = turn.spin(t_ns)
        sample = ArmSample(
            t_ns, segment.position(t_ns), segment.velocity(t_ns),
            not segment.at_rest or spin_radps != 0.0,
            self.protective_stop, turn.angle(t_ns), spin_radps, self._pace.slider,
        )  # fmt: skip
        return self._corrupt(sample)

    def _effect_ns(self, now_ns: int) -> int:
        """The first cycle from then on."""
        t_ns = max(now_ns + self._latency_ns, self._seen_ns)
        return -(-t_ns // self._period_ns) * self._period_ns

    def _at(self, t_ns: int) -> Segment:
        if t_ns >= self._starts[-1]:  # most often
            return self._chain[-1]
        return self._chain[max(0, bisect_right(self._starts, t_ns) - 1)]

    def _present(self, t_ns: int) -> tuple[Vector3, Vector3, float]:
        """Position, unit vector of the velocity, speed."""
        at_m, (x, y, z) = self.position(t_ns), self.velocity(t_ns)
        speed = math.hypot(x, y, z)
        if speed < _STANDING_BELOW_MPS:
            return at_m, STANDING, 0.0
        return at_m, (x / speed, y / speed, z / speed), speed

    def _turning(self, t_ns: int) -> Turn:
        started = bisect_right(self._turns, t_ns, key=lambda turn: turn.start_ns)
        return self._turns[max(0, started - 1)]

    def _spin_to(self, effect_ns: int, spin_radps: float, acceleration_radps2: float) -> None:
        present = self._turning(effect_ns)
        angle, spin = present.angle(effect_ns), present.spin(effect_ns)
        change_s = abs(spin_radps - spin) / acceleration_radps2
        end_ns = effect_ns + round(change_s * 1e9)
        past = [turn for turn in self._turns if turn.start_ns < effect_ns][-_HISTORY:]
        ramp = math.copysign(acceleration_radps2, spin_radps - spin)
        chain = [Turn(effect_ns, angle, spin, ramp)] if change_s else []
        reached = angle + 0.5 * (spin + spin_radps) * change_s
        self._turns = [*past, *chain, Turn(end_ns, reached, spin_radps, 0.0)]

    def _replace_from(self, effect_ns: int, chain: list[Segment]) -> None:
        self._line = []
        past = [segment for segment in self._chain if segment.start_ns < effect_ns]
        self._chain = past[-_HISTORY:] + chain
        self._starts = [segment.start_ns for segment in self._chain]


def _rest(start_ns: int, at_m: Vector3) -> Segment:
    return Segment(start_ns, at_m, STANDING, STANDING)


def _ramp(
    start_ns: int, at_m: Vector3, from_mps: Vector3, to_mps: Vector3, acceleration_mps2: float
) -> list[Segment]:
    """From one velocity to another, which is then kept."""
    change_s = math.dist(from_mps, to_mps) / acceleration_mps2
    if change_s == 0.0:
        return [Segment(start_ns, at_m, to_mps, STANDING)]
    x, y, z = ((b - a) / change_s for a, b in zip(from_mps, to_mps, strict=True))
    ramp = Segment(start_ns, at_m, from_mps, (x, y, z))
    end_ns = start_ns + round(change_s * 1e9)
    return [ramp, Segment(end_ns, ramp.position(end_ns), to_mps, STANDING)]


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
    """From the present speed to rest; just rest where there is no speed."""
    if speed == 0.0:
        return [_rest(start_ns, at_m)]
    stop_ns = start_ns + round(speed / deceleration * 1e9)
    stop_m = ahead(at_m, direction, speed**2 / (2.0 * deceleration))
    braking = times(direction, -deceleration)
    return [Segment(start_ns, at_m, times(direction, speed), braking), _rest(stop_ns, stop_m)]


def _line(
    start_ns: int, at_m: Vector3, target_m: Vector3, v0: float, speed: float, acceleration: float
) -> list[Segment]:
    """Reach ``speed`` from v0, cruise, and brake to rest exactly at the target.

    Where the way is too short for that, the peak speed v follows from the distance d:
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


def _at_share(part: Segment, own_ns: float, now_ns: int, share: float) -> Segment:
    return Segment(
        now_ns, part.position(own_ns), times(part.velocity(own_ns), share),
        times(part.acceleration_mps2, share * share),
    )  # fmt: skip
