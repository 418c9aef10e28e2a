"""Joins the arm of the world to URScript's motions and to the joints of a UR10.

The arm model moves a point, the flange, and turns it about its own axis: lines that keep the tool's
orientation, at the pace of the speed slider, and velocities that turn it about its axis alone, the
same that virtual time runs. Nothing else is emulated.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager

import numpy as np

from drivers.interfaces import Vector3
from drivers.ur import kinematics
from drivers.ur.emulator.urscript import ScriptError, Thread
from drivers.ur.kinematics import STILL, Frame, Joints, Pose, beyond, in_range
from drivers.ur.model import ArmModel

_TURN_TOLERANCE_RAD = 1e-4  # what is turned by less keeps its orientation
_AT_TARGET_M = 1e-6
_OFF_AXIS = 0.01  # of a turn: direction of another axis
_ON_AXIS = 1e-6  # of the tool centre point, m; of a turn, rad/s
_STEADY_NS = 500_000_000  # URScript manual: is_steady, standing still for 500 ms
_TOOL_DOWN = (math.pi, 0.0, 0.0)  # rotation vector of the flange at the start
_STOP_MPS2 = 5.0  # when a program ends in motion; assumed

# no arm moves faster, or changes its speed more slowly; what follows from them stays finite
_SPEEDS = (1e-6, 100.0)  # m/s, rad/s
_ACCELERATIONS = (1e-3, 1e4)


def _check(what: str, value: float, within: tuple[float, float]) -> None:
    least, most = within
    if not least <= value <= most:
        raise ScriptError(f"{what} {value:g} is not within {least:g} and {most:g}")


class RobotMotion:
    """The arm as the controller sees it, renewed once per cycle by ``update``."""

    def __init__(
        self, period_s: float, arm: ArmModel, lock: AbstractContextManager[object], now_ns: int
    ) -> None:
        self._arm = arm
        self._lock = lock
        self._period_s = period_s
        self._start_rotation = kinematics.rotation(_TOOL_DOWN)
        self._rotation = self._start_rotation
        self._turned_rad = 0.0  # the arm model's angle at the start rotation
        self._slider = 1.0
        self._owner: Thread | None = None
        self._target: Vector3 | None = None
        self._speed: tuple[Vector3, float, float] | None = None
        self._still_since_ns = now_ns
        with lock:
            self._still_at: Vector3 = arm.position(now_ns)
        self._now_ns = now_ns
        self.moving = False
        self.turning: Vector3 = (0.0, 0.0, 0.0)
        self.set_tcp(STILL)
        start = kinematics.inverse(self._flange_at(self._still_at), kinematics.ELBOW_UP)
        if start is None:
            raise ValueError(f"no joint angles reach the start position {self._still_at}")
        self.q: Joints = in_range(start, kinematics.ELBOW_UP)
        self._home = self.q
        self.qd: Joints = STILL
        self.update(now_ns)

    def update(self, now_ns: int) -> str:
        """Sample the arm; returns what must not go on, or ""."""
        with self._lock:
            sample = self._arm.read(now_ns)
        self._now_ns = now_ns
        self.position: Vector3 = sample.position_m
        self.velocity: Vector3 = sample.velocity_mps
        self.moving = sample.moving
        if self.position == self._still_at and not self.moving:
            self.velocity = self.turning = (0.0, 0.0, 0.0)
            self.qd = STILL
            return ""
        self._still_at, self._still_since_ns = self.position, now_ns
        if sample.angle_rad != self._turned_rad or sample.spin_radps:
            turn = kinematics.rotation((0.0, 0.0, sample.angle_rad - self._turned_rad))
            self._rotation = self._start_rotation @ turn
        x, y, z = (sample.spin_radps * self._rotation[:, 2]).tolist()
        self.turning = (x, y, z)
        return self._follow()

    def _follow(self) -> str:
        """Joints of a tool that the arm model moves by itself."""
        # where the joints get at their present speeds is nearly the answer
        near = [
            angle + speed * self._period_s for angle, speed in zip(self.q, self.qd, strict=True)
        ]
        q = kinematics.inverse(self.flange, near)
        if q is None:
            return "joints cannot follow the tool"
        self.q = q
        twist = np.array((*self.velocity, *self.turning))
        try:
            self.qd = tuple(np.linalg.solve(kinematics.jacobian(q), twist).tolist())
        except np.linalg.LinAlgError:
            return "joints cannot follow the tool: singular"
        return beyond(self.q, self.qd)

    # state

    def _flange_at(self, position: Sequence[float]) -> Frame:
        frame = np.eye(4)
        frame[:3, :3] = self._rotation
        frame[:3, 3] = position
        return frame

    @property
    def flange(self) -> Frame:
        return self._flange_at(self.position)

    @property
    def turned_rad(self) -> float:
        """How far the tool is turned from how it began; nought where that is next to nothing."""
        turn = kinematics.turn_between(self.flange, kinematics.forward(self._home))
        return turn if turn > _TURN_TOLERANCE_RAD else 0.0

    @property
    def tcp_pose(self) -> Pose:
        return kinematics.pose(self.flange @ self._tcp)

    @property
    def tcp_speed(self) -> Pose:
        """Of the tool centre point, which a turn moves too."""
        if self.turning == (0.0, 0.0, 0.0):
            return (*self.velocity, *self.turning)
        arm = self._rotation @ self._tcp[:3, 3]
        swung = np.cross(np.array(self.turning), arm) + np.array(self.velocity)
        return (*swung.tolist(), *self.turning)

    @property
    def steady(self) -> bool:
        return not self.moving and self._now_ns - self._still_since_ns >= _STEADY_NS

    @property
    def arrived(self) -> bool:
        """The last motion that was commanded has come to its end."""
        if self.moving:
            return False
        return self._target is None or math.dist(self.position, self._target) <= _AT_TARGET_M

    def set_tcp(self, offset: Sequence[float]) -> None:
        """The tool centre point in the flange frame."""
        self.tcp_offset: Pose = tuple(offset)
        self._tcp = kinematics.frame(offset)
        self._tcp_back = kinematics.inverted(self._tcp)

    def set_payload(self, mass_kg: float) -> None:
        with self._lock:
            self._arm.set_payload(mass_kg)

    def turn_slider(self, fraction: float) -> None:
        """The speed slider stands there: what moves to a place goes at so much of its pace."""
        if fraction != self._slider:
            self._slider = fraction
            self._command(lambda arm: arm.turn_slider(fraction, self._now_ns))

    def joints_for(self, pose: Sequence[float], near: Sequence[float] | None) -> Joints | None:
        """Joint angles within their range that bring the tool centre point to a pose."""
        near = near or self.q
        q = kinematics.inverse(kinematics.frame(pose) @ self._tcp_back, near)
        return None if q is None else in_range(q, near)

    def pose_of(self, q: Sequence[float], offset: Sequence[float] | None) -> Pose:
        tcp = self._tcp if offset is None else kinematics.frame(offset)
        return kinematics.pose(kinematics.forward(q) @ tcp)

    # commands

    def take(self, thread: Thread) -> None:
        """From here on this thread moves the arm; raises ScriptError while another one does."""
        if self._owner is not None and self._owner is not thread:
            raise ScriptError("Another thread is already controlling the robot")
        self._owner = thread

    def let_go(self, thread: Thread) -> None:
        if self._owner is thread:
            self._owner = None

    def brake_if_unowned(self) -> None:
        """A motion whose thread or program has ended is braked."""
        if self._owner is None and (self._target is not None or self._speed is not None):
            self.stop(_STOP_MPS2)

    def line(self, pose: Sequence[float], speed_mps: float, acceleration_mps2: float) -> None:
        """Straight line of the tool centre point to a pose. Raises ScriptError."""
        _check("speed", speed_mps, _SPEEDS)
        _check("acceleration", acceleration_mps2, _ACCELERATIONS)
        flange = kinematics.frame(pose) @ self._tcp_back
        if kinematics.inverse(flange, self.q) is None:
            raise ScriptError("target out of reach")
        if kinematics.turn_between(flange, self.flange) > _TURN_TOLERANCE_RAD:
            raise ScriptError("a line that turns the tool is not emulated")
        x, y, z = flange[:3, 3].tolist()
        self._speed, self._target = None, (x, y, z)
        self._command(lambda arm: arm.move_l((x, y, z), speed_mps, acceleration_mps2, self._now_ns))

    def speed_line(self, velocity: Vector3, turning: Vector3, acceleration_mps2: float) -> None:
        """Keep this velocity (m/s; rad/s, base frame) until told otherwise. Raises ScriptError."""
        _check("acceleration", acceleration_mps2, _ACCELERATIONS)
        _check("speed", math.hypot(*velocity, *turning), (0.0, _SPEEDS[1]))
        spin = self._spin(turning)
        if spin is None:
            raise ScriptError("a turn about another axis than the tool's own is not emulated")
        if self._speed == (velocity, spin, acceleration_mps2):
            return
        self._command(lambda arm: arm.speed_l(velocity, spin, acceleration_mps2, self._now_ns))
        self._target, self._speed = None, (velocity, spin, acceleration_mps2)

    def _spin(self, turning: Vector3) -> float | None:
        """About the flange's axis, where that does not move the tool centre point; None for every
        other turn. The axis itself turns with the flange, so it stays the same."""
        axis = self._rotation[:, 2]
        spin = float(axis @ np.array(turning))
        if math.dist(turning, (spin * axis).tolist()) > _OFF_AXIS * abs(spin) + _ON_AXIS:
            return None
        if spin and max(map(abs, (*self.tcp_offset[:2], *self.tcp_offset[3:5]))) > _ON_AXIS:
            return None
        return spin

    def turn_home(self) -> None:
        """The tool turned as it began, as somebody at the pendant does it."""
        with self._lock:
            self._turned_rad = self._arm.angle(self._now_ns)
        self._rotation = self._start_rotation = kinematics.forward(self._home)[:3, :3]
        q = kinematics.inverse(self.flange, self._home)
        self.q = self.q if q is None else in_range(q, self._home)

    def stop(self, deceleration_mps2: float) -> None:
        """Brake. Raises ScriptError."""
        _check("deceleration", deceleration_mps2, _ACCELERATIONS)
        self._target = self._speed = None
        self._command(lambda arm: arm.stop_l(deceleration_mps2, self._now_ns))

    def trip(self) -> None:
        """Stop by safety; the arm refuses to move until ``release``."""
        self._target = self._speed = None
        self._command(lambda arm: arm.trip(self._now_ns))

    def release(self) -> None:
        self._command(lambda arm: arm.release())

    @property
    def tripped(self) -> bool:
        with self._lock:
            return self._arm.protective_stop

    def _command(self, command: Callable[[ArmModel], object]) -> None:
        with self._lock:
            command(self._arm)
