"""The cell of data acquisition: an arm, a board, and one fingertip pressed on a fixed surface.

The pad faces down; the surface is a plane, a cylinder or a sphere. Finger, arm and wall are springs
in series that carry the pad. Its load follows from the tool's height, from texture, curvature and
slope of the surface, and from friction.

Tool frame: the tool points down, so its x runs along the base's x and its y against the base's y;
the pad's frame is the tool frame turned with the tool.
"""

import math
from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGERS, PERIOD_NS
from drivers.takktile.model.board import BoardModel
from drivers.takktile.settings import BoardModelSettings
from drivers.ur.model import ArmModel
from drivers.ur.settings import ArmModelSettings
from scenarios.world.fingertip import REST_HIGH, REST_LOW, Fingertips
from scenarios.world.settings import (
    WALL_STIFFNESS_NPM,
    FingertipSettings,
    FixedSurface,
    PressSettings,
    Surface,
)
from scenarios.world.truth import PressedTruth

STROKE_MPS, STROKE_RADPS = 0.001, 0.02  # faster motion excites the arm's mode
SPAN_S = 0.005  # least averaging time of a speed; a step to a sample may take a microsecond
STEP_S = 0.015  # motion is linear within it: the time between two board samples with jitter
KNOCK_STEP_S = 0.001
GAP_M = 0.006  # height of the start above the apex; assumed
Floats = NDArray[np.float64]
Codes = NDArray[np.int16]


class PressedCellSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of all parts of the cell."""

    surface: FixedSurface
    press: PressSettings
    fingertip: FingertipSettings
    board: BoardModelSettings
    arm: ArmModelSettings
    finger: int  # index of the pressed finger


class PressedCell:
    """Arm, board and pad on one time line. The two fingertips that touch nothing are at rest."""

    def __init__(
        self, settings: PressedCellSettings, rng: np.random.Generator, start_ns: int = 0
    ) -> None:
        self.arm = ArmModel(settings.arm, start_ns)
        self.pad = PressedPad(
            settings.surface, settings.press, settings.fingertip, rng, settings.arm.start_m,
            start_ns * 1e-9,
        )  # fmt: skip
        self._rest = rng.integers(
            REST_LOW, REST_HIGH, (FINGERS, self.pad.tips.rest.shape[1]), endpoint=True,
        ).astype(np.int16)  # fmt: skip
        self._finger = settings.finger
        self.shaken = False  # an external disturbance shakes the arm
        self._now_ns = self._since_ns = start_ns
        self._slid, self._sliding = np.zeros(3), np.zeros(3)
        self.board = BoardModel(settings.board, self._sample)

    def advance(self, now_ns: int) -> None:
        """Advance everything to now_ns."""
        self._now_ns = max(self._now_ns, now_ns)
        t = self._now_ns
        self.arm.advance(t)
        arm = self.arm.at(t)
        x, y, _ = arm.velocity_mps
        strokes = math.hypot(x, y) > STROKE_MPS or abs(arm.spin_radps) > STROKE_RADPS
        self.pad.advance(t * 1e-9, arm.position_m, arm.angle_rad, strokes or self.shaken)
        span_s = (t - self._since_ns) * 1e-9
        if span_s >= SPAN_S:
            slid = self.pad.tips.slid[0]
            self._sliding = (slid - self._slid) / span_s
            self._slid, self._since_ns = slid, t

    def _sample(self, t_ns: int) -> Callable[[], tuple[Codes, Codes]]:
        self.advance(t_ns)
        pressure, temperature = self.pad.tips.codes()
        codes = self._rest.copy()
        codes[self._finger] = pressure[0]
        sample = codes.ravel(), np.broadcast_to(temperature, codes.shape).ravel()
        return lambda: sample

    def compile(self) -> None:
        """Run every compiled function once, as ``SimulatedCell.compile``."""
        self._sample(self._now_ns + PERIOD_NS)

    def truth(self) -> PressedTruth:
        """The state of the contact at the time that it was last advanced to."""
        tips = self.pad.tips
        return PressedTruth(
            t_ns=self._now_ns,
            normal_n=self.pad.normal_n,
            contact_speed_mps=1e-3 * math.hypot(self._sliding[0], self._sliding[1]),
            contact_turn_radps=float(abs(self._sliding[2])),
            sliding_share=float(tips.sliding_share[0]),
        )


class PressedPad:
    """The pad on its surface, advanced in the order of time."""

    def __init__(
        self, surface: FixedSurface, press: PressSettings, fingertip: FingertipSettings,
        rng: np.random.Generator, start_m: tuple[float, float, float], start_s: float,
    ) -> None:  # fmt: skip
        self._stiffness_npm = 1 / (
            1 / press.finger_stiffness_npm + 1 / press.arm_stiffness_npm
            + 1 / WALL_STIFFNESS_NPM
        )  # fmt: skip
        self._mount_npmm = np.array([1e-3 * self._stiffness_npm])
        self._slope = np.array([press.slope_x, press.slope_y])
        self._from_axis_m = np.array([press.axis_x_m, press.axis_y_m])
        self._start_m = np.array(start_m)
        self._apex_m = start_m[2] - GAP_M
        self._off_apex_m = np.array([press.off_apex_x_m, press.off_apex_y_m])
        self.tips = Fingertips(fingertip, [_pad_surface(surface)], rng)
        self._start_s = self._t_s = start_s
        self._motion_mm = np.zeros(2)
        self._at_m = np.zeros(2)
        self._height_m, self._angle_rad = start_m[2], 0.0
        self._knock = (-math.inf, 1.0, 0.0)  # start, duration, impulse

    def knock(self, impulse_n_s: float, duration_s: float) -> None:
        """Add the half-sine load of a knock on the table, now and along the normal only."""
        self._knock = (self._t_s, duration_s, impulse_n_s)

    def advance(
        self, t_s: float, position_m: tuple[float, float, float], angle_rad: float, moving: bool
    ) -> None:
        """Advance to t_s, along a straight line to the tool's new pose."""
        x, y, z = position_m
        at = np.array([x - self._start_m[0], self._start_m[1] - y])
        span = t_s - self._t_s
        if span <= 0.0:
            return
        knocked = self._knock[0] + self._knock[1] > self._t_s - KNOCK_STEP_S
        steps = math.ceil(span / (KNOCK_STEP_S if knocked else STEP_S) - 1e-6)
        from_at, from_z, from_angle, from_s = self._at_m, self._height_m, self._angle_rad, self._t_s
        for i in range(1, steps + 1):
            part = i / steps
            self._step(
                from_s + part * span, from_at + part * (at - from_at),
                from_z + part * (z - from_z), from_angle + part * (angle_rad - from_angle), moving,
            )  # fmt: skip

    def _step(self, t_s: float, at_m: Floats, height_m: float, angle: float, moving: bool) -> None:
        middle = 0.5 * (angle + self._angle_rad)
        arc = (angle - self._angle_rad) * _rotated(self._from_axis_m, middle + 0.5 * math.pi)
        self._motion_mm = self._motion_mm - 1e3 * _rotated(at_m - self._at_m + arc, -middle)
        self._at_m, self._height_m, self._angle_rad, self._t_s = at_m, height_m, angle, t_s
        turned = _rotated(self._from_axis_m, angle) - self._from_axis_m
        off = at_m + turned + self._off_apex_m
        surface_m = self._apex_m + float(self._slope @ (off - self._off_apex_m))
        beyond = self._stiffness_npm * (surface_m - height_m) + self._knock_force_n(t_s)
        centre = _rotated(-1e3 * off, -angle)
        self.tips.advance(
            t_s - self._start_s, np.array([beyond]), self._motion_mm[None, :],
            np.array([-angle]), centre[None, :], moving, self._mount_npmm,
        )  # fmt: skip

    @property
    def normal_n(self) -> float:
        """Load on the pad."""
        return float(self.tips.load_n[0])

    def _knock_force_n(self, t_s: float) -> float:
        start_s, duration_s, impulse_n_s = self._knock
        phase = (t_s - start_s) / duration_s
        if not 0.0 < phase < 1.0:
            return 0.0
        return 0.5 * math.pi * impulse_n_s / duration_s * math.sin(math.pi * phase)


def _pad_surface(surface: FixedSurface) -> Surface:
    return Surface(
        curvature_per_mm=(_per_mm(surface.radius_x_m), _per_mm(surface.radius_y_m)),
        texture_rms_mm=surface.texture_rms_m * 1e3,
        texture_length_mm=surface.texture_length_m * 1e3,
        friction_static=surface.friction_kinetic * surface.friction_ratio,
        friction_kinetic=surface.friction_kinetic,
    )  # fmt: skip


def _per_mm(radius_m: float) -> float:
    return 1e-3 * (1.0 / radius_m) if radius_m else 0.0


def _rotated(vector: Floats, angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])
