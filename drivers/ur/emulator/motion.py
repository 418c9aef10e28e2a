"""Joins the arm of the world to URScript's motions and to the joints of a UR10.

The arm model moves a point, the flange, and turns it about its own axis. Lines that keep the tool's
orientation, at the pace of the speed slider, and velocities that turn it about its axis alone, are
the model's own: the same that virtual time runs. Everything else is planned here, cycle by cycle
(`plans`), and the model follows with its point; how the tool is tilted is known here alone.
"""

import math
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager

import numpy as np

from drivers.interfaces import Vector3
from drivers.ur import kinematics
from drivers.ur.driver import ArmSample
from drivers.ur.emulator.plans import (
    STILL,
    JointMove,
    JointServo,
    JointSpeed,
    OutOfReach,
    Plan,
    ToolMove,
    ToolSpeed,
    beyond,
    in_range,
    where,
)
from drivers.ur.emulator.settings import EmulatorSettings
from drivers.ur.emulator.urscript.parse import ScriptError
from drivers.ur.emulator.urscript.run import Thread
from drivers.ur.kinematics import Frame, Joints, Pose
from drivers.ur.model import ArmModel

_TURN_TOLERANCE_RAD = 1e-4  # what is turned by less keeps its orientation
_AT_TARGET_M = 1e-6
_OFF_AXIS = 0.01  # of a turn: direction of another axis
_ON_AXIS = 1e-6  # of the tool centre point, m; of a turn, rad/s
_STEADY_NS = 500_000_000  # URScript manual: is_steady, standing still for 500 ms


# no arm moves faster, or changes its speed more slowly; what follows from them stays finite
_SPEEDS = (1e-6, 100.0)  # m/s, rad/s
_ACCELERATIONS = (1e-3, 1e4)
_LOOKAHEADS_S = (0.03, 0.2)  # URScript manual: servoj


def _check(what: str, value: float, within: tuple[float, float]) -> None:
    least, most = within
    if not least <= value <= most:
        raise ScriptError(f"{what} {value:g} is not within {least:g} and {most:g}")


class RobotMotion:
    """The arm as the controller sees it, renewed once per cycle by ``update``."""

    def __init__(
        self,
        settings: EmulatorSettings,
        arm: ArmModel,
        lock: AbstractContextManager[object],
        now_ns: int,
    ) -> None:
        self._arm = arm
        self._lock = lock
        self._period_s = settings.controller.period_ns * 1e-9
        self._stop_mps2 = settings.stop_deceleration_mps2
        self._start_rotation = kinematics.rotation(settings.tool_rotation_rad)
        self._rotation = self._start_rotation
        self._turned_rad = 0.0  # the arm model's angle at the start rotation
        self._slider = 1.0
        self._owner: Thread | None = None
        self._plan: Plan | None = None
        self._planned: deque[tuple[int, Joints, Joints]] = deque()  # when the arm is there; q, qd
        self._to_its_end = False  # the plan, though no program owns it
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
        """Sample the arm, and go on with what is planned; returns what must not go on, or ""."""
        with self._lock:
            sample = self._arm.read(now_ns)
        self._now_ns = now_ns
        self.position: Vector3 = sample.position_m
        self.velocity: Vector3 = sample.velocity_mps
        trouble = self._go_on(sample) if self.planned else ""
        self.moving = sample.moving or self.planned
        if self.planned:
            self._still_at, self._still_since_ns = self.position, now_ns
            return trouble
        if self.position == self._still_at and not self.moving:
            self.velocity = self.turning = (0.0, 0.0, 0.0)
            self.qd = STILL
            return trouble
        self._still_at, self._still_since_ns = self.position, now_ns
        if sample.angle_rad != self._turned_rad or sample.spin_radps:
            turn = kinematics.rotation((0.0, 0.0, sample.angle_rad - self._turned_rad))
            self._rotation = self._start_rotation @ turn
        x, y, z = (sample.spin_radps * self._rotation[:, 2]).tolist()
        self.turning = (x, y, z)
        return trouble or self._follow()

    @property
    def planned(self) -> bool:
        """The tool is where a plan of this class leads it, not the arm model by itself."""
        return self._plan is not None or bool(self._planned)

    def _go_on(self, sample: ArmSample) -> str:
        """One cycle of the plan; the arm is told now, and its sample shows it later. In a cycle
        that is made up for, behind the world, the arm stands as it did there, its plan with it."""
        plan, trouble = self._plan, ""
        with self._lock:
            stands = self._arm.behind(self._now_ns)
        if plan is not None and not stands:
            try:
                with self._lock:
                    pace = self._arm.pace(self._now_ns)
                plan.step(self._period_s, pace)
                trouble = where(beyond(plan.q, plan.qd), plan.q)
            except OutOfReach as error:
                trouble = str(error)
            x, y, z = kinematics.forward(plan.q)[:3, 3].tolist()
            with self._lock:
                there_ns = self._arm.follow((x, y, z), self._now_ns)
            self._planned.append((there_ns, plan.q, STILL if plan.done else plan.qd))
            if plan.done or trouble:
                self._plan = None
        while self._planned and self._planned[0][0] <= self._now_ns:
            _, self.q, self.qd = self._planned.popleft()
        if stands and not self._planned:
            self.qd = STILL
        self._turn_to(kinematics.forward(self.q)[:3, :3], sample.angle_rad)
        twist = kinematics.jacobian(self.q) @ np.array(self.qd)
        x, y, z, rx, ry, rz = twist.tolist()
        self.velocity, self.turning = (x, y, z), (rx, ry, rz)
        return trouble

    def _turn_to(self, rotation: Frame, angle_rad: float) -> None:
        """The tool is turned like this, while the arm model counts so much about its axis."""
        self._rotation = self._start_rotation = rotation
        self._turned_rad = angle_rad

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
        return where(beyond(self.q, self.qd), self.q)

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
        if self.moving or self.planned:
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

    def joints_for(
        self, pose: Sequence[float], near: Sequence[float] | None
    ) -> Generator[None, None, Joints | None]:
        """Joint angles within their range that bring the tool centre point to a pose; pauses as
        ``kinematics.approach``."""
        near = near or self.q
        q = yield from kinematics.approach(kinematics.frame(pose) @ self._tcp_back, near)
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
        goes_on = self._plan is not None and not (self._plan.ends and self._to_its_end)
        if self._owner is None and (self._target is not None or self._speed is not None or goes_on):
            self.stop(self._stop_mps2)

    def line(
        self, pose: Sequence[float], speed_mps: float, acceleration_mps2: float, seconds: float = 0
    ) -> None:
        """Straight line of the tool centre point to a pose; in so many seconds, where they are
        given. Raises ScriptError."""
        _check("speed", speed_mps, _SPEEDS)
        _check("acceleration", acceleration_mps2, _ACCELERATIONS)
        target = kinematics.frame(pose)
        flange = target @ self._tcp_back
        turns = kinematics.turn_between(flange, self.flange) > _TURN_TOLERANCE_RAD
        if kinematics.inverse(flange, self.q) is None:
            raise ScriptError("target out of reach")
        if turns or seconds or self.planned:
            self._begin(
                ToolMove(self._last_q, target, self._tcp, speed_mps, acceleration_mps2, seconds)
            )
            return
        x, y, z = flange[:3, 3].tolist()
        self._speed, self._target = None, (x, y, z)
        self._command(lambda arm: arm.move_l((x, y, z), speed_mps, acceleration_mps2, self._now_ns))

    def to_joints(
        self, q: Joints, speed_radps: float, acceleration_radps2: float, seconds: float = 0
    ) -> None:
        """To joint angles, all joints together. Raises ScriptError."""
        _check("speed", speed_radps, _SPEEDS)
        _check("acceleration", acceleration_radps2, _ACCELERATIONS)
        if far := beyond(q, STILL):
            raise ScriptError(f"target out of reach: {far}")
        self._begin(JointMove(self._last_q, q, speed_radps, acceleration_radps2, seconds))

    def speed_line(self, velocity: Vector3, turning: Vector3, acceleration_mps2: float) -> None:
        """Keep this velocity (m/s; rad/s, base frame) until told otherwise. Raises ScriptError."""
        _check("acceleration", acceleration_mps2, _ACCELERATIONS)
        _check("speed", math.hypot(*velocity, *turning), (0.0, _SPEEDS[1]))
        spin = self._spin(turning)
        twist = (*velocity, *turning)
        if spin is None or self.planned:
            plan = self._plan
            if not (isinstance(plan, ToolSpeed) and plan.target == twist):
                present = self.tcp_speed
                self._begin(ToolSpeed(self._last_q, present, twist, self._tcp, acceleration_mps2))
            return
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

    def speed_joints(self, qd: Joints, acceleration_radps2: float) -> None:
        """Keep these joint speeds, rad/s, until told otherwise. Raises ScriptError."""
        _check("acceleration", acceleration_radps2, _ACCELERATIONS)
        plan = self._plan
        if not (isinstance(plan, JointSpeed) and plan.target == qd):
            self._begin(JointSpeed(self._last_q, self._last_qd, qd, acceleration_radps2))

    def servo_joints(self, q: Joints, lookahead_s: float) -> None:
        """Follow this joint target until told otherwise. Raises ScriptError."""
        _check("look-ahead time", lookahead_s, _LOOKAHEADS_S)
        if far := beyond(q, STILL):
            raise ScriptError(f"target out of reach: {far}")
        plan = self._plan
        if not isinstance(plan, JointServo):
            plan = JointServo(self._last_q, self._last_qd)
            self._begin(plan)
        plan.target, plan.lookahead_s = q, lookahead_s

    @property
    def _last_q(self) -> Joints:
        """Where the arm has been told to go; it is there in one or two cycles."""
        return self._planned[-1][1] if self._planned else self.q

    @property
    def _last_qd(self) -> Joints:
        """Joint speeds that the arm has been told last."""
        return self._plan.qd if self._plan is not None else self.qd

    def turn_home(self, speed_radps: float, acceleration_radps2: float) -> None:
        """To the joint angles of the start, as somebody at the pendant does: no program owns it."""
        home = JointMove(self._last_q, self._home, speed_radps, acceleration_radps2)
        self._begin(home, to_its_end=True)

    def _begin(self, plan: Plan, to_its_end: bool = False) -> None:
        """Put a plan in the place of every other motion."""
        self._target = self._speed = None
        self._plan, self._to_its_end = plan, to_its_end

    def stop(self, deceleration_mps2: float) -> None:
        """Brake. Raises ScriptError."""
        _check("deceleration", deceleration_mps2, _ACCELERATIONS)
        if self.planned:
            plan = JointSpeed(self._last_q, self._last_qd, STILL, deceleration_mps2)
            self._begin(plan, to_its_end=True)
            return
        self._target = self._speed = None
        self._command(lambda arm: arm.stop_l(deceleration_mps2, self._now_ns))

    def trip(self) -> None:
        """Stop by safety; the arm refuses to move until ``release``. A tool that turns stands at
        once, and its point brakes."""
        self._target = self._speed = self._plan = None
        self._planned.clear()
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
