"""What the arm does: straight lines with trapezoidal speed, in closed form; time is an argument."""

import math
from typing import Annotated

import msgspec
from msgspec import Meta

from drivers.interfaces import Vector3

STANDING: Vector3 = (0.0, 0.0, 0.0)
SHORTEST_M = 1e-9
PROTECTIVE_DECELERATION_MPS2 = 8.0  # assumed


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
        tuple[float, float, float], Meta(description="tool position at power-up, base frame")
    ] = (0.5, 0.1, 0.3)
    period_s: Annotated[
        float, Meta(ge=0.001, le=0.02, description="controller cycle; UR10 CB3: 8 ms")
    ] = 0.008


class Profile(msgspec.Struct, frozen=True):
    """One straight motion: from v0 to cruise speed at t1, cruise until t2, at rest at t3 (s)."""

    start_ns: int
    origin_m: Vector3
    direction: Vector3
    v0: float
    cruise: float
    acceleration: float  # of the first ramp
    deceleration: float
    t1: float
    t2: float
    t3: float

    @property
    def end_ns(self) -> int:
        return self.start_ns + math.ceil(self.t3 * 1e9)

    def along(self, t_ns: int) -> tuple[float, float]:
        """Distance (m) and speed (m/s) along the line."""
        t = min(max(0.0, (t_ns - self.start_ns) * 1e-9), self.t3)
        if t < self.t1:
            return (self.v0 + 0.5 * self.acceleration * t) * t, self.v0 + self.acceleration * t
        distance = 0.5 * (self.v0 + self.cruise) * self.t1 + self.cruise * (min(t, self.t2) - self.t1)
        if t <= self.t2:
            return distance, self.cruise
        braking = t - self.t2
        distance += (self.cruise - 0.5 * self.deceleration * braking) * braking
        return distance, max(0.0, self.cruise - self.deceleration * braking) if t < self.t3 else 0.0

    def position(self, t_ns: int) -> Vector3:
        s = self.along(t_ns)[0]
        (x, y, z), (dx, dy, dz) = self.origin_m, self.direction
        return x + s * dx, y + s * dy, z + s * dz

    def velocity(self, t_ns: int) -> Vector3:
        v = self.along(t_ns)[1]
        dx, dy, dz = self.direction
        return v * dx, v * dy, v * dz


def line(
    origin: Vector3, target: Vector3, speed: float, acceleration: float, start_ns: int
) -> Profile | None:
    """Trapezoid (or triangle) from rest to rest; None where there is no way to go."""
    distance = math.dist(origin, target)
    if distance < SHORTEST_M:
        return None
    dx, dy, dz = ((b - a) / distance for a, b in zip(origin, target, strict=True))
    peak = min(speed, math.sqrt(acceleration * distance))
    ramp = peak / acceleration
    cruise_s = max(0.0, distance / peak - ramp)
    return Profile(
        start_ns, origin, (dx, dy, dz), 0.0, peak, acceleration, acceleration, ramp,
        ramp + cruise_s, 2 * ramp + cruise_s,
    )  # fmt: skip


class ArmModel:
    """A tool on straight lines. Commands take effect at the next controller cycle.

    A move commanded while another is under way brakes on the present line first, with its own
    acceleration, and leaves from where it stopped: the path is a chain of straight motions.
    """

    def __init__(self, settings: ArmModelSettings, now_ns: int) -> None:
        self._period_ns = round(settings.period_s * 1e9)
        self._rest_m: Vector3 = settings.start_m
        self._chain: list[Profile] = []
        self.payload_kg = 0.0
        self.protective_stop = False

    def move_l(
        self, target_m: Vector3, speed_mps: float, acceleration_mps2: float, now_ns: int
    ) -> None:
        """Straight line to target_m; ignored while stopped by safety, as the robot ignores it."""
        if self.protective_stop:
            return
        start_ns = self._brake(acceleration_mps2, now_ns)
        motion = line(self._end_m(), target_m, speed_mps, acceleration_mps2, start_ns)
        if motion is not None:
            self._chain.append(motion)

    def stop_l(self, deceleration_mps2: float, now_ns: int) -> None:
        self._brake(deceleration_mps2, now_ns)

    def trip(self, now_ns: int) -> None:
        """Protective stop: brake hard and refuse to move until released."""
        self.protective_stop = True
        self._brake(PROTECTIVE_DECELERATION_MPS2, now_ns)

    def set_payload(self, mass_kg: float) -> None:
        self.payload_kg = mass_kg

    def position(self, t_ns: int) -> Vector3:
        """Position at t_ns, which must not precede the last command."""
        motion = self._at(t_ns)
        return self._rest_m if motion is None else motion.position(t_ns)

    def velocity(self, t_ns: int) -> Vector3:
        motion = self._at(t_ns)
        return STANDING if motion is None else motion.velocity(t_ns)

    def read(self, now_ns: int) -> ArmSample:
        """The controller's sample of its last cycle."""
        t_ns = now_ns // self._period_ns * self._period_ns
        moving = bool(self._chain) and t_ns < self._chain[-1].end_ns
        return ArmSample(
            t_ns, self.position(t_ns), self.velocity(t_ns), moving, self.protective_stop
        )

    def _at(self, t_ns: int) -> Profile | None:
        """The motion under way at t_ns: the last that has begun."""
        begun = None
        for motion in self._chain:
            if motion.start_ns <= t_ns or begun is None:
                begun = motion
        return begun

    def _end_m(self) -> Vector3:
        return self._chain[-1].position(self._chain[-1].end_ns) if self._chain else self._rest_m

    def _brake(self, deceleration_mps2: float, now_ns: int) -> int:
        """Leave the present motion at the next cycle; returns when the tool stands."""
        cycle_ns = -(-now_ns // self._period_ns) * self._period_ns
        motion = self._at(cycle_ns)
        self._chain = []
        if motion is None:
            return cycle_ns
        speed = motion.along(cycle_ns)[1]
        at_m = motion.position(cycle_ns)
        if cycle_ns > now_ns and motion.start_ns < cycle_ns:
            self._chain.append(motion)  # still runs until the cycle begins
        stop_s = speed / deceleration_mps2
        self._chain.append(
            Profile(
                cycle_ns, at_m, motion.direction, speed, speed, 0.0, deceleration_mps2, 0.0, 0.0,
                stop_s,
            )
        )  # fmt: skip
        return self._chain[-1].end_ns
