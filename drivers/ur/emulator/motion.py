"""Motions of URScript on the arm model, with the joints of a UR10.

The arm model moves the flange along lines that keep the tool's orientation, at the scale of the
speed slider, or at velocities that may spin the tool about its z axis. Nothing else is emulated.
The same model runs in virtual time.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager

import numpy as np

from drivers.interfaces import Vector3
from drivers.ur import kinematics
from drivers.ur.emulator.urscript import Thread
from drivers.ur.emulator.urscript_values import ScriptError
from drivers.ur.kinematics import ZERO_JOINTS, Frame, Joints, Pose, limit_violation, nearest_turns
from drivers.ur.model import ArmModel

_TURN_TOLERANCE_RAD = 1e-4  # a smaller rotation counts as none
_AT_TARGET_M = 1e-6
_OFF_AXIS = 0.01  # relative tolerance of a rotation about another axis
_ON_AXIS = 1e-6  # tolerance of the tool centre point, m; of a rotation, rad/s
_STEADY_NS = 500_000_000  # URScript manual: is_steady, at rest for 500 ms
_TOOL_DOWN = (math.pi, 0.0, 0.0)  # rotation vector of the flange at the start
_STOP_MPS2 = 5.0  # when a program ends during a motion; assumed

# beyond the limits of any arm, but results stay finite
_SPEEDS = (1e-6, 100.0)  # m/s, rad/s
_ACCELERATIONS = (1e-3, 1e4)


def _check(what: str, value: float, within: tuple[float, float]) -> None:
    least, most = within
    if not least <= value <= most:
        raise ScriptError(f"{what} {value:g} is not within {least:g} and {most:g}")


class RobotMotion:
    """The arm as the controller sees it, updated once per cycle by ``update``."""

    def __init__(
        self, period_s: float, arm: ArmModel, lock: AbstractContextManager[object], now_ns: int
    ) -> None:
        self._arm = arm
        self._lock = lock
        self._period_s = period_s
        self._start_rotation = kinematics.rotation(_TOOL_DOWN)
        self._rotation = self._start_rotation
        self._angle_offset_rad = 0.0  # the arm model's angle at the start rotation
        self._slider = 1.0
        self._owner: Thread | None = None
        self._target: Vector3 | None = None
        self._speed: tuple[Vector3, float, float] | None = None
        self._rest_since_ns = now_ns
        with lock:
            self._rest_position: Vector3 = arm.at(now_ns).position_m
        self._now_ns = now_ns
        self.moving = False
        self.angular_velocity: Vector3 = (0.0, 0.0, 0.0)
        self.set_tcp(ZERO_JOINTS)
        start = kinematics.inverse(self._flange_at(self._rest_position), kinematics.ELBOW_UP)
        if start is None:
            raise ValueError(f"no joint angles reach the start position {self._rest_position}")
        self.q: Joints = nearest_turns(start, kinematics.ELBOW_UP)
        self._home = self.q
        self.qd: Joints = ZERO_JOINTS
        self.update(now_ns)

    def update(self, now_ns: int) -> str:
        """Sample the arm; returns a problem that requires a protective stop, or ""."""
        with self._lock:
            sample = self._arm.read(now_ns)
        self._now_ns = now_ns
        self.position: Vector3 = sample.position_m
        self.velocity: Vector3 = sample.velocity_mps
        self.moving = sample.moving
        if self.position == self._rest_position and not self.moving:
            self.velocity = self.angular_velocity = (0.0, 0.0, 0.0)
            self.qd = ZERO_JOINTS
            return ""
        self._rest_position, self._rest_since_ns = self.position, now_ns
        if sample.angle_rad != self._angle_offset_rad or sample.spin_radps:
            turn = kinematics.rotation((0.0, 0.0, sample.angle_rad - self._angle_offset_rad))
            self._rotation = self._start_rotation @ turn
        x, y, z = (sample.spin_radps * self._rotation[:, 2]).tolist()
        self.angular_velocity = (x, y, z)
        return self._update_joints()

    def _update_joints(self) -> str:
        """Update the joints to the tool pose of the arm model; returns a problem, or ""."""
        # start value: the joints extrapolated at their present speeds
        near = [
            angle + speed * self._period_s for angle, speed in zip(self.q, self.qd, strict=True)
        ]
        q = kinematics.inverse(self.flange, near)
        if q is None:
            return "joints cannot follow the tool"
        self.q = q
        twist = np.array((*self.velocity, *self.angular_velocity))
        try:
            self.qd = tuple(np.linalg.solve(kinematics.jacobian(q), twist).tolist())
        except np.linalg.LinAlgError:
            return "joints cannot follow the tool: singular"
        return limit_violation(self.q, self.qd)

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
        """Angle between the present and the initial tool orientation; 0 when negligible."""
        turn = kinematics.angle_between(self.flange, kinematics.forward(self._home))
        return turn if turn > _TURN_TOLERANCE_RAD else 0.0

    @property
    def tcp_pose(self) -> Pose:
        return kinematics.pose(self.flange @ self._tcp)

    @property
    def tcp_speed(self) -> Pose:
        """Velocity of the tool centre point, including that by rotation."""
        if self.angular_velocity == (0.0, 0.0, 0.0):
            return (*self.velocity, *self.angular_velocity)
        arm = self._rotation @ self._tcp[:3, 3]
        swung = np.cross(np.array(self.angular_velocity), arm) + np.array(self.velocity)
        return (*swung.tolist(), *self.angular_velocity)

    @property
    def steady(self) -> bool:
        return not self.moving and self._now_ns - self._rest_since_ns >= _STEADY_NS

    @property
    def arrived(self) -> bool:
        """Whether the last commanded motion is complete."""
        if self.moving:
            return False
        return self._target is None or math.dist(self.position, self._target) <= _AT_TARGET_M

    def set_tcp(self, offset: Sequence[float]) -> None:
        """Set the tool centre point in the flange frame."""
        self.tcp_offset: Pose = tuple(offset)
        self._tcp = kinematics.frame(offset)
        self._tcp_back = kinematics.inverse_frame(self._tcp)

    def set_payload(self, mass_kg: float) -> None:
        with self._lock:
            self._arm.set_payload(mass_kg)

    def set_speed_slider(self, fraction: float) -> None:
        """Set the speed slider, which scales moves to a target."""
        if fraction != self._slider:
            self._slider = fraction
            self._command(lambda arm: arm.set_speed_slider(fraction, self._now_ns))

    def joints_for(self, pose: Sequence[float], near: Sequence[float] | None) -> Joints | None:
        """Joint angles within their range for a pose of the tool centre point; None if
        unreachable."""
        near = near or self.q
        q = kinematics.inverse(kinematics.frame(pose) @ self._tcp_back, near)
        return None if q is None else nearest_turns(q, near)

    def pose_of(self, q: Sequence[float], offset: Sequence[float] | None) -> Pose:
        tcp = self._tcp if offset is None else kinematics.frame(offset)
        return kinematics.pose(kinematics.forward(q) @ tcp)

    # commands

    def acquire(self, thread: Thread) -> None:
        """Give control of the arm to a thread; raises ScriptError while another one has it."""
        if self._owner is not None and self._owner is not thread:
            raise ScriptError("Another thread is already controlling the robot")
        self._owner = thread

    def release_thread(self, thread: Thread) -> None:
        if self._owner is thread:
            self._owner = None

    def brake_if_unowned(self) -> None:
        """Brake a motion whose thread or program has ended."""
        if self._owner is None and (self._target is not None or self._speed is not None):
            self.stop(_STOP_MPS2)

    def line(self, pose: Sequence[float], speed_mps: float, acceleration_mps2: float) -> None:
        """Straight line of the tool centre point to a pose. Raises ScriptError."""
        _check("speed", speed_mps, _SPEEDS)
        _check("acceleration", acceleration_mps2, _ACCELERATIONS)
        flange = kinematics.frame(pose) @ self._tcp_back
        if kinematics.inverse(flange, self.q) is None:
            raise ScriptError("target out of reach")
        if kinematics.angle_between(flange, self.flange) > _TURN_TOLERANCE_RAD:
            raise ScriptError("a line that turns the tool is not emulated")
        x, y, z = flange[:3, 3].tolist()
        self._speed, self._target = None, (x, y, z)
        self._command(lambda arm: arm.move_l((x, y, z), speed_mps, acceleration_mps2, self._now_ns))

    def speed_line(
        self, velocity: Vector3, angular_velocity: Vector3, acceleration_mps2: float
    ) -> None:
        """Keep this velocity (m/s; rad/s, base frame) until the next command. Raises
        ScriptError."""
        _check("acceleration", acceleration_mps2, _ACCELERATIONS)
        _check("speed", math.hypot(*velocity, *angular_velocity), (0.0, _SPEEDS[1]))
        spin = self._spin(angular_velocity)
        if spin is None:
            raise ScriptError("only rotation about the tool's z axis is emulated")
        if self._speed == (velocity, spin, acceleration_mps2):
            return
        self._command(lambda arm: arm.speed_l(velocity, spin, acceleration_mps2, self._now_ns))
        self._target, self._speed = None, (velocity, spin, acceleration_mps2)

    def _spin(self, angular_velocity: Vector3) -> float | None:
        """Spin about the flange's z axis, if the rotation is about that axis only and does not move
        the tool centre point; None otherwise. The axis keeps its direction during the spin."""
        axis = self._rotation[:, 2]
        spin = float(axis @ np.array(angular_velocity))
        if math.dist(angular_velocity, (spin * axis).tolist()) > _OFF_AXIS * abs(spin) + _ON_AXIS:
            return None
        if spin and max(map(abs, (*self.tcp_offset[:2], *self.tcp_offset[3:5]))) > _ON_AXIS:
            return None
        return spin

    def reset_rotation(self) -> None:
        """Reset the tool to its initial orientation, as an operator does at the pendant."""
        with self._lock:
            self._angle_offset_rad = self._arm.at(self._now_ns).angle_rad
        self._rotation = self._start_rotation = kinematics.forward(self._home)[:3, :3]
        q = kinematics.inverse(self.flange, self._home)
        self.q = self.q if q is None else nearest_turns(q, self._home)

    def stop(self, deceleration_mps2: float) -> None:
        """Brake. Raises ScriptError."""
        _check("deceleration", deceleration_mps2, _ACCELERATIONS)
        self._target = self._speed = None
        self._command(lambda arm: arm.stop_l(deceleration_mps2, self._now_ns))

    def trip(self) -> None:
        """Safety stop; the arm refuses to move until ``release``."""
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
