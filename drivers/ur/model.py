"""What the arm does: straight lines with trapezoidal speed, in closed form; time is an argument.

A path is a chain of segments of constant acceleration, each on a straight line; the last one is
always at rest. A command replaces the part of the chain from the controller cycle in which it
takes effect, and nothing before it.
"""

import math
from bisect import bisect_right
from typing import Annotated

import msgspec
from msgspec import Meta

from drivers.interfaces import Vector3

_STANDING: Vector3 = (0.0, 0.0, 0.0)
_SAME_LINE_M = 1e-6  # a target this close to the present line counts as lying on it
_HISTORY = 32  # past segments kept: a few commands, hence far more than one control period


class ArmSample(msgspec.Struct, frozen=True):
    """What the controller reports of one cycle; t_ns is its own timestamp."""

    t_ns: int
    position_m: Vector3
    velocity_mps: Vector3
    moving: bool
    protective_stop: bool


class ArmModelSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The modelled controller."""

    start_m: Annotated[
        tuple[float, float, float], Meta(description="m, tool position at power-up, base frame")
    ] = (0.5, 0.1, 0.3)
    period_s: Annotated[
        float, Meta(ge=0.001, le=0.02, description="s, controller cycle; UR manual: CB3 125 Hz")
    ] = 0.008
    command_latency_s: Annotated[
        float,
        Meta(
            ge=0.0,
            le=0.1,
            description="s on the way to the controller, before it waits for the next cycle; "
            "assumed",
        ),
    ] = 0.002
    protective_deceleration_mps2: Annotated[
        float, Meta(ge=0.5, le=50.0, description="m/s2 of a protective stop; assumed")
    ] = 8.0


class Segment(msgspec.Struct, frozen=True):
    """Constant acceleration along a line from start_ns on, until the next segment begins."""

    start_ns: int
    origin_m: Vector3
    direction: Vector3  # of unit length
    speed_mps: float
    acceleration_mps2: float

    @property
    def at_rest(self) -> bool:
        return self.speed_mps == 0.0 and self.acceleration_mps2 == 0.0

    def position(self, t_ns: int) -> Vector3:
        t = (t_ns - self.start_ns) * 1e-9
        return _ahead(
            self.origin_m, self.direction, (self.speed_mps + 0.5 * self.acceleration_mps2 * t) * t
        )

    def speed(self, t_ns: int) -> float:
        return self.speed_mps + self.acceleration_mps2 * (t_ns - self.start_ns) * 1e-9


class ArmModel:
    """A tool on straight lines. Commands take effect at the next controller cycle.

    A move commanded while another is under way goes on from the present speed if its target lies
    ahead on the present line and far enough to stop there. Otherwise the tool first brakes on the
    present line, with the new move's acceleration, and leaves from where it stopped.
    Times asked for may precede the last commands by a few control periods, not more.
    """

    def __init__(self, settings: ArmModelSettings, now_ns: int) -> None:
        self._period_ns = round(settings.period_s * 1e9)
        self._latency_ns = round(settings.command_latency_s * 1e9)
        self._protective_mps2 = settings.protective_deceleration_mps2
        self._install([_rest(now_ns, settings.start_m)])
        self.payload_kg = 0.0
        self.protective_stop = False

    def move_l(
        self, target_m: Vector3, speed_mps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        """Straight line to target_m; False, and no motion, while stopped by safety."""
        if self.protective_stop:
            return False
        effect_ns = self._effect_ns(now_ns)
        present = self._at(effect_ns)
        at_m, speed = present.position(effect_ns), max(0.0, present.speed(effect_ns))
        chain: list[Segment] = []
        start_ns = effect_ns
        if speed and not _can_go_on(at_m, present.direction, target_m, speed**2, acceleration_mps2):
            chain = _brake(effect_ns, at_m, present.direction, speed, acceleration_mps2)
            start_ns, at_m, speed = chain[-1].start_ns, chain[-1].origin_m, 0.0
        chain += _line(start_ns, at_m, target_m, speed, speed_mps, acceleration_mps2)
        self._replace_from(effect_ns, chain)
        return True

    def stop_l(self, deceleration_mps2: float, now_ns: int) -> None:
        """Brake along the present line, from the speed that the tool has when this takes effect."""
        effect_ns = self._effect_ns(now_ns)
        present = self._at(effect_ns)
        at_m, speed = present.position(effect_ns), max(0.0, present.speed(effect_ns))
        chain = _brake(effect_ns, at_m, present.direction, speed, deceleration_mps2)
        self._replace_from(effect_ns, chain)

    def trip(self, now_ns: int) -> None:
        """Protective stop: brake hard and refuse to move until released."""
        self.protective_stop = True
        self.stop_l(self._protective_mps2, now_ns)

    def release(self) -> None:
        """End the protective stop, as the teach pendant does; the arm stays where it stands."""
        self.protective_stop = False

    def set_payload(self, mass_kg: float) -> None:
        self.payload_kg = mass_kg

    def position(self, t_ns: int) -> Vector3:
        return self._at(t_ns).position(t_ns)

    def velocity(self, t_ns: int) -> Vector3:
        segment = self._at(t_ns)
        return _ahead(_STANDING, segment.direction, segment.speed(t_ns))

    def read(self, now_ns: int) -> ArmSample:
        """The controller's sample of its last cycle."""
        t_ns = now_ns // self._period_ns * self._period_ns
        moving = not self._at(t_ns).at_rest
        return ArmSample(
            t_ns, self.position(t_ns), self.velocity(t_ns), moving, self.protective_stop
        )

    def _effect_ns(self, now_ns: int) -> int:
        return -(-(now_ns + self._latency_ns) // self._period_ns) * self._period_ns

    def _at(self, t_ns: int) -> Segment:
        return self._chain[max(0, bisect_right(self._starts, t_ns) - 1)]

    def _replace_from(self, effect_ns: int, chain: list[Segment]) -> None:
        past = [segment for segment in self._chain if segment.start_ns < effect_ns]
        self._install(past[-_HISTORY:] + chain)

    def _install(self, chain: list[Segment]) -> None:
        self._chain = chain
        self._starts = [segment.start_ns for segment in chain]


def _ahead(origin: Vector3, direction: Vector3, distance: float) -> Vector3:
    (x, y, z), (dx, dy, dz) = origin, direction
    return x + distance * dx, y + distance * dy, z + distance * dz


def _rest(start_ns: int, at_m: Vector3) -> Segment:
    return Segment(start_ns, at_m, _STANDING, 0.0, 0.0)


def _can_go_on(
    at_m: Vector3, direction: Vector3, target_m: Vector3, speed_squared: float, braking: float
) -> bool:
    """True when the target is ahead on the line, no nearer than the stopping distance."""
    ahead = sum(d * (b - a) for d, a, b in zip(direction, at_m, target_m, strict=True))
    on_line = math.dist(_ahead(at_m, direction, ahead), target_m) <= _SAME_LINE_M
    return on_line and ahead >= speed_squared / (2.0 * braking)


def _brake(
    start_ns: int, at_m: Vector3, direction: Vector3, speed: float, deceleration: float
) -> list[Segment]:
    """From the present speed to rest; just rest where there is no speed."""
    if speed == 0.0:
        return [_rest(start_ns, at_m)]
    stop_ns = start_ns + round(speed / deceleration * 1e9)
    stop_m = _ahead(at_m, direction, speed**2 / (2.0 * deceleration))
    return [Segment(start_ns, at_m, direction, speed, -deceleration), _rest(stop_ns, stop_m)]


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
        origin = _ahead(at_m, (x, y, z), s)
        chain.append(Segment(start_ns + round(t * 1e9), origin, (x, y, z), v, a))
        t, s = t + duration, s + (v + 0.5 * a * duration) * duration
    return [*chain, _rest(start_ns + round(t * 1e9), target_m)]
