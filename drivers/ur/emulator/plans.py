"""Motions that turn the tool or are told in joints, a controller cycle at a time.

A plan gives the joint angles one period further on. Moves have a trapezoidal speed along their way:
in the leading joint, or along the line of the tool, or about its turn where that is the longer one
(radians counted as metres). Speeds change at an even rate. Following a joint target is critically
damped, with twice the inverse of the look-ahead time as its frequency: assumed.
"""

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from drivers.ur import kinematics
from drivers.ur.kinematics import Frame, Joints

JOINT_SPEEDS = (2.0944, 2.0944, 3.1416, 3.1416, 3.1416, 3.1416)  # rad/s, UR10 user manual
JOINT_RANGE = 2.0 * math.pi  # rad either way, UR10 user manual
_SLACK = 1.02  # of a joint's speed: rounding is no fault
_SINGULAR = 0.1  # of the least that the tool moves for a joint, m or rad: assumed
STILL: Joints = (0.0,) * kinematics.JOINTS


class OutOfReach(Exception):
    """No joint angles bring the tool there."""


class Plan(Protocol):
    """What the arm is about to do; ``q`` and ``qd`` are those of the last step."""

    q: Joints
    qd: Joints
    done: bool
    ends: bool  # comes to rest by itself

    def step(self, period_s: float, fraction: float) -> None:
        """One period further, slowed down by the speed slider. Raises OutOfReach."""


class Trapezoid:
    """Way along a length against time, from rest to rest."""

    def __init__(self, length: float, speed: float, acceleration: float) -> None:
        self._length = length
        self._peak = min(speed, math.sqrt(acceleration * length)) if length else speed
        self._ramp_s = self._peak / acceleration
        self._acceleration = acceleration
        self.seconds = length / self._peak + self._ramp_s if length else 0.0

    @classmethod
    def lasting(cls, length: float, seconds: float) -> "Trapezoid":
        """A third of the time each for gaining speed and for losing it."""
        return cls(length, 1.5 * length / seconds, 4.5 * length / seconds**2)

    def share(self, t_s: float) -> float:
        """Of the way, 0 to 1."""
        if t_s >= self.seconds or not self._length:
            return 1.0
        left_s = self.seconds - t_s
        if t_s < self._ramp_s:
            way = 0.5 * self._acceleration * t_s**2
        elif left_s < self._ramp_s:
            way = self._length - 0.5 * self._acceleration * left_s**2
        else:
            way = self._peak * (t_s - 0.5 * self._ramp_s)
        return min(1.0, way / self._length)


class JointMove:
    """All joints together, no faster than any of them can."""

    ends = True

    def __init__(
        self, q: Joints, target: Joints, speed: float, acceleration: float, seconds: float = 0.0
    ) -> None:
        self.q, self.qd = q, STILL
        self.done = False
        self._from, self._to = q, target
        ways = [abs(b - a) for a, b in zip(q, target, strict=True)]
        lead = max(ways)
        limits = zip(JOINT_SPEEDS, ways, strict=True)
        possible = [limit * lead / way for limit, way in limits if way]
        if seconds and lead:
            self._way = Trapezoid.lasting(lead, seconds)
        else:
            self._way = Trapezoid(lead, min([speed, *possible]), acceleration)
        self._t_s = 0.0

    def step(self, period_s: float, fraction: float) -> None:
        self._t_s += period_s * fraction
        share = self._way.share(self._t_s)
        q = tuple(a + share * (b - a) for a, b in zip(self._from, self._to, strict=True))
        self.q, self.qd = q, _speed(self.q, q, period_s)
        self.done = share >= 1.0


class ToolMove:
    """A straight line of the tool centre point, the tool turning evenly about one axis."""

    ends = True

    def __init__(
        self, q: Joints, target: Frame, tcp: Frame, speed: float, acceleration: float,
        seconds: float = 0.0,
    ) -> None:  # fmt: skip
        self.q, self.qd = q, STILL
        self.done = False
        self._from, self._to = kinematics.forward(q) @ tcp, target
        self._tcp_back = kinematics.inverted(tcp)
        metres = math.dist(self._from[:3, 3], target[:3, 3])
        length = max(metres, kinematics.turn_between(self._from, target))
        timed = seconds and length
        self._way = (
            Trapezoid.lasting(length, seconds) if timed else Trapezoid(length, speed, acceleration)
        )
        self._t_s = 0.0

    def step(self, period_s: float, fraction: float) -> None:
        self._t_s += period_s * fraction
        share = self._way.share(self._t_s)
        at = np.eye(4)
        at[:3, :3] = kinematics.turned(self._from[:3, :3], self._to[:3, :3], share)
        at[:3, 3] = self._from[:3, 3] + share * (self._to[:3, 3] - self._from[:3, 3])
        q = _joints(at @ self._tcp_back, self.q)
        self.q, self.qd = q, _speed(self.q, q, period_s)
        self.done = share >= 1.0


class JointSpeed:
    """Joint speeds that are kept; done, for one that ends, when all joints stand."""

    def __init__(self, q: Joints, qd: Joints, target: Joints, acceleration: float) -> None:
        self.q, self.qd = q, qd
        self.target, self.acceleration = target, acceleration
        self.ends = target == STILL
        self.done = False

    def step(self, period_s: float, fraction: float) -> None:
        new = _towards(self.qd, self.target, self.acceleration * period_s)
        self.q = tuple(
            q + 0.5 * (a + b) * period_s for q, a, b in zip(self.q, self.qd, new, strict=True)
        )
        self.qd = new
        self.done = self.ends and new == STILL


class ToolSpeed:
    """A velocity of the tool centre point, m/s and rad/s in the base frame, that is kept."""

    def __init__(
        self, q: Joints, twist: Joints, target: Joints, tcp: Frame, acceleration: float
    ) -> None:
        self.q, self.qd = q, STILL
        self.target, self.acceleration = target, acceleration
        self.ends = target == STILL
        self.done = False
        self._twist = twist
        self._at = kinematics.forward(q) @ tcp
        self._tcp_back = kinematics.inverted(tcp)

    def step(self, period_s: float, fraction: float) -> None:
        new = _towards(self._twist, self.target, self.acceleration * period_s)
        x, y, z, *turn = (0.5 * (a + b) * period_s for a, b in zip(self._twist, new, strict=True))
        self._at[:3, 3] += (x, y, z)
        self._at[:3, :3] = kinematics.rotation(turn) @ self._at[:3, :3]
        self._twist = new
        q = _joints(self._at @ self._tcp_back, self.q)
        self.q, self.qd = q, _speed(self.q, q, period_s)
        self.done = self.ends and new == STILL


class JointServo:
    """Follows a joint target that is told again and again."""

    done = False
    ends = False

    def __init__(self, q: Joints, qd: Joints) -> None:
        self.q, self.qd = q, qd
        self.target, self.lookahead_s = q, 0.1

    def step(self, period_s: float, fraction: float) -> None:
        rate = 2.0 / self.lookahead_s
        fade = math.exp(-rate * period_s)
        found = []
        for q, qd, target in zip(self.q, self.qd, self.target, strict=True):
            error = q - target
            drive = (qd + rate * error) * period_s
            found.append((target + (error + drive) * fade, (qd - rate * drive) * fade))
        self.q = tuple(q for q, _ in found)
        self.qd = tuple(qd for _, qd in found)


def beyond(q: Sequence[float], qd: Sequence[float]) -> str:
    """Which joint is further or faster than it can be; empty when none is."""
    for joint, (angle, speed, limit) in enumerate(zip(q, qd, JOINT_SPEEDS, strict=True)):
        if abs(angle) > JOINT_RANGE:
            return f"joint {joint} at its limit, {angle:.2f} rad"
        if abs(speed) > limit * _SLACK:
            return f"joint {joint} too fast, {speed:.2f} rad/s"
    return ""


def where(trouble: str, q: Sequence[float]) -> str:
    """The same words, and whether the arm is where the tool can hardly go one way whatever joints
    do."""
    if not trouble or np.linalg.svd(kinematics.jacobian(q), compute_uv=False)[-1] > _SINGULAR:
        return trouble
    return f"{trouble}: singularity"


def in_range(q: Sequence[float], near: Sequence[float]) -> Joints:
    """The same posture, each joint by whole turns as near to another one as its range lets it."""
    return tuple(_whole_turns(angle, other) for angle, other in zip(q, near, strict=True))


def _whole_turns(angle: float, near: float) -> float:
    turn = 2.0 * math.pi
    least = math.ceil((-JOINT_RANGE - angle) / turn)
    most = math.floor((JOINT_RANGE - angle) / turn)
    return angle + turn * min(most, max(least, round((near - angle) / turn)))


def _joints(flange: Frame, near: Joints) -> Joints:
    q = kinematics.inverse(flange, near)
    if q is None:
        raise OutOfReach("joints cannot follow the tool")
    return q


def _speed(before: Joints, after: Joints, period_s: float) -> Joints:
    return tuple((b - a) / period_s for a, b in zip(before, after, strict=True))


def _towards(present: Joints, target: Joints, change: float) -> Joints:
    """As far as the change allows, all numbers together."""
    whole = math.dist(present, target)
    if whole <= change:
        return target
    share = change / whole
    return tuple(a + share * (b - a) for a, b in zip(present, target, strict=True))
