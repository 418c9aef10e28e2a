"""Controller that presses one fingertip on a surface and strokes it, without clock or device.

The arm has no force sensor, so the fingertip estimates the force: the sum of its counts over a
calibration. A PID controls it by the speed along the surface normal. Strokes are trapezoids of
speed along the surface, back and forth, with pauses between them (paper, section III-B).
"""

import math
from enum import StrEnum
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigError
from drivers.interfaces import ArmState, Vector3
from scenarios.world.objects import within

TURNS = {"ccw": 1.0, "cw": -1.0}
DIRECTIONS = (*(str(angle) for angle in range(0, 360, 45)), *TURNS)


# All assumed, unless a source is named.
TOUCH_N = 0.5  # estimated force that counts as contact
INTEGRAL_MPS_PER_N_S = 0.0008
DERIVATIVE_M_PER_N = 0.00001
INTEGRAL_LIMIT_N_S = 3.0  # against windup
PRESS_MPS = 0.012  # maximum speed along the normal
CLEAR_M = 0.003  # height above the first contact after lifting off
SETTLE_S = 1.5  # pressing before the first stroke
STROKE_SCATTER = 0.15  # relative deviation of lengths
DRIVE_MPS2 = 4.0  # and rad/s2, acceleration of the arm: above that of the strokes


class PressControlSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of pressing and stroking."""

    force_n: Annotated[float, within(0.5, 15.0)] = 5.0  # target; the authors' recording: 3-12 N
    # calibration of this fingertip, sum of its taxels; 0: by pressing the simulated one. Required
    # on hardware
    counts_per_newton: Annotated[float, within(0.0, 5000.0)] = 0.0
    # load under which the rest counts are taken; 0 or less: in the air. Some of the authors'
    # recordings have 0-6 N, by their means
    residual_n: Annotated[float, within(-10.0, 10.0)] = 0.0
    approach_mps: Annotated[float, within(0.001, 0.05)] = 0.01  # down until contact; assumed
    # PID; default: 5 rad/s on 3.5 N/mm, real recording 3-10 rad/s
    proportional_mps_per_n: Annotated[float, within(0.0, 0.02)] = 0.0015
    # maximum depth below the first contact, at any estimated force; assumed
    depth_m: Annotated[float, within(0.0005, 0.01)] = 0.005
    # length of a stroke; assumed: with the acceleration it gives the 0.65 s of the real recording
    # and speeds up to 6 cm/s
    stroke_m: Annotated[float, within(0.001, 0.05)] = 0.017
    acceleration_mps2: Annotated[float, within(0.02, 2.0)] = 0.2
    # deceleration of a stroke over its acceleration; assumed, real recording: 0.25-0.8
    braking_share: Annotated[float, within(0.05, 1.0)] = 1.0
    # factor of the PID's gains from the first stroke on: a slow force loop lets the load vary
    # during a stroke, as in the real recording: 0.03-0.1
    stroking_share: Annotated[float, within(0.0, 1.0)] = 1.0
    turn_rad: Annotated[float, within(0.05, 2.0)] = 0.6  # angle of a rotation stroke; assumed
    turn_radps2: Annotated[float, within(0.2, 10.0)] = 3.5  # its acceleration; assumed
    # time of pauses over time of strokes; with the slow ends of strokes it gives the paper's
    # 143,584 static to 122,918 slip samples
    pause_share: Annotated[float, within(0.1, 20.0)] = 0.95
    # angle of the fingertip's x in the tool frame at the start; the tool points down
    fingertip_x_deg: Annotated[float, within(-180.0, 180.0)] = 0.0


class StrokeMotion(msgspec.Struct, frozen=True):
    """Direction and maximum speed of strokes; exactly one of the speeds is not 0."""

    direction: str
    speed_mps: float
    spin_radps: float

    @property
    def kind(self) -> Literal["primary", "oblique", "rotation"]:
        """Kind of motion in the paper's Table I."""
        if self.direction in TURNS:
            return "rotation"
        return "primary" if int(self.direction) % 90 == 0 else "oblique"


def motion(direction: str, speed_mps: float, spin_radps: float) -> StrokeMotion:
    """Motion in a direction of DIRECTIONS. Raises ConfigError for any other."""
    if direction not in DIRECTIONS:
        raise ConfigError("--direction", direction, "no such direction", ", ".join(DIRECTIONS))
    turns = direction in TURNS
    return StrokeMotion(direction, 0.0 if turns else speed_mps, spin_radps if turns else 0.0)


class PressPhase(StrEnum):
    """Phase of a session."""

    APPROACH = "approach"
    SETTLE = "settle"
    STROKE = "stroke"
    PAUSE = "pause"
    OFF = "off"


class Stroke(msgspec.Struct, frozen=True):
    """Trapezoid of speed over ``length``, metres or radians; ``braking`` is the deceleration."""

    start_s: float
    length: float
    speed: float
    acceleration: float
    sign: float
    braking: float

    @property
    def _ramps(self) -> float:
        """Length of both ramps over half of the squared peak speed."""
        return 1.0 / self.acceleration + 1.0 / self.braking

    @property
    def peak(self) -> float:
        return min(self.speed, math.sqrt(2.0 * self.length / self._ramps))

    @property
    def duration_s(self) -> float:
        return self.length / self.peak + 0.5 * self.peak * self._ramps

    def speed_at(self, t_s: float) -> float:
        t = t_s - self.start_s
        ramp = min(t * self.acceleration, (self.duration_s - t) * self.braking)
        return self.sign * max(0.0, min(self.peak, ramp))


class PressCommand(msgspec.Struct, frozen=True):
    """Command to the arm until the next sample, in the base frame."""

    velocity_mps: Vector3
    spin_radps: float


class PressController:
    """Controller of one session: call ``step`` once a sample. Without a motion it only presses."""

    def __init__(
        self, settings: PressControlSettings, counts_per_newton: float, motion: StrokeMotion | None,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self._settings = settings
        self.counts_per_newton = counts_per_newton
        self._motion = motion
        self._rng = rng
        self.phase = PressPhase.APPROACH
        self.target_n = settings.force_n
        self.zero_n = 0.0  # load at which the counts are zero
        self.force_n = 0.0
        self._touch_m: Vector3 | None = None
        self._phase_end_s = math.inf
        self._stroke: Stroke | None = None
        self._side = 1.0  # end of the next stroke, relative to the first contact
        self._integral_n_s = 0.0
        self._error_n = 0.0
        self._t_s: float | None = None

    def lift_off(self) -> None:
        """Lift off, then press again."""
        self.phase, self._stroke = PressPhase.OFF, None

    def step(self, t_s: float, counts: NDArray[np.int16], arm: ArmState) -> PressCommand:
        """Command from the fingertip's counts (taxels,), raw minus rest, and the arm's state."""
        dt_s = t_s - self._t_s if self._t_s is not None else 0.0
        self._t_s = t_s
        self.force_n = max(0.0, self.zero_n - float(counts.sum()) / self.counts_per_newton)
        self._follow_script(t_s, arm)
        if self.phase in (PressPhase.APPROACH, PressPhase.OFF):
            up = 1.0 if self.phase is PressPhase.OFF else -1.0
            return PressCommand((0.0, 0.0, up * self._settings.approach_mps), 0.0)
        along = self._stroke.speed_at(t_s) if self._stroke is not None else 0.0
        press = self._press(dt_s, arm.position_m[2])
        if self._motion is None:
            return PressCommand((0.0, 0.0, press), 0.0)
        if self._motion.direction in TURNS:
            return PressCommand((0.0, 0.0, press), along * TURNS[self._motion.direction])
        u, v = _heading(self._motion, self._settings)
        return PressCommand((along * u, along * v, press), 0.0)

    def _follow_script(self, t_s: float, arm: ArmState) -> None:
        if self.phase is PressPhase.APPROACH:
            if self.force_n >= TOUCH_N:
                self.phase, self._phase_end_s = PressPhase.SETTLE, t_s + SETTLE_S
                self._touch_m, self._integral_n_s = arm.position_m, 0.0
        elif self.phase is PressPhase.OFF:
            if self._touch_m is None or arm.position_m[2] > self._touch_m[2] + CLEAR_M:
                self.phase = PressPhase.APPROACH
        elif self._motion is not None and t_s >= self._phase_end_s:
            if self.phase is PressPhase.STROKE:
                self._pause(t_s)
            else:
                self._begin_stroke(t_s, arm, self._motion)

    def _begin_stroke(self, t_s: float, arm: ArmState, motion: StrokeMotion) -> None:
        """Start a stroke to half of its length on the other side of the first contact."""
        s, turns = self._settings, motion.direction in TURNS
        scatter = 1.0 + STROKE_SCATTER * float(np.clip(self._rng.standard_normal(), -2.0, 2.0))
        distance = self._side * 0.5 * (s.turn_rad if turns else s.stroke_m) * scatter
        distance -= self._travelled(arm, motion)
        self._side = -self._side
        speed = motion.spin_radps if turns else motion.speed_mps
        acceleration = s.turn_radps2 if turns else s.acceleration_mps2
        self._stroke = Stroke(
            t_s, abs(distance), speed, acceleration, math.copysign(1.0, distance),
            s.braking_share * acceleration,
        )  # fmt: skip
        self.phase, self._phase_end_s = PressPhase.STROKE, t_s + self._stroke.duration_s

    def _travelled(self, arm: ArmState, motion: StrokeMotion) -> float:
        """Distance from the first contact along the direction of strokes: metres, or radians."""
        if motion.direction in TURNS:
            return arm.angle_rad * TURNS[motion.direction]
        start = self._touch_m or arm.position_m
        u, v = _heading(motion, self._settings)
        return u * (arm.position_m[0] - start[0]) + v * (arm.position_m[1] - start[1])

    def _pause(self, t_s: float) -> None:
        stroke_s = self._stroke.duration_s if self._stroke is not None else 0.0
        share = self._settings.pause_share * float(self._rng.uniform(0.4, 1.6))
        self._stroke = None
        self.phase, self._phase_end_s = PressPhase.PAUSE, t_s + stroke_s * share

    def _press(self, dt_s: float, height_m: float) -> float:
        """Speed along z, m/s, that controls the estimated force."""
        s = self._settings
        error = self.target_n - self.force_n
        change = (error - self._error_n) / dt_s if dt_s > 0.0 else 0.0
        self._error_n = error
        windup = self._integral_n_s + error * dt_s
        self._integral_n_s = min(max(windup, -INTEGRAL_LIMIT_N_S), INTEGRAL_LIMIT_N_S)
        down = (
            s.proportional_mps_per_n * error + INTEGRAL_MPS_PER_N_S * self._integral_n_s
            + DERIVATIVE_M_PER_N * change
        )  # fmt: skip
        if self.phase in (PressPhase.STROKE, PressPhase.PAUSE):
            down *= s.stroking_share
        down = min(max(down, -PRESS_MPS), PRESS_MPS)
        too_deep = self._touch_m is not None and height_m < self._touch_m[2] - s.depth_m
        return -min(down, 0.0) if too_deep else -down


def _heading(motion: StrokeMotion, settings: PressControlSettings) -> tuple[float, float]:
    """Unit vector of a translation in the base frame; the tool's y is opposite to the base's."""
    angle = math.radians(float(motion.direction) + settings.fingertip_x_deg)
    return math.cos(angle), -math.sin(angle)
