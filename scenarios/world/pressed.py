"""One fingertip pressed on a fixed surface: where they touch, how hard, and how they move.

The pad faces down, the surface is a plane, a cylinder or a sphere. Finger, arm and wall are springs
in series, on which the pad hangs: how hard it is pressed follows from how far the tool has come
down, from what the pad meets there (texture, curvature, the slope of a surface that is not quite
level) and from its friction. The rest is the fingertip's own affair.

Tool frame: the tool points down, so its x runs along the base's x and its y against the base's y;
the pad's frame is the tool frame turned with the tool.
"""

import math

import numpy as np
from numpy.typing import NDArray

from scenarios.world.fingertip import Fingertips
from scenarios.world.fingertip_settings import FingertipSettings, Surface
from scenarios.world.press_settings import FixedSurface, PressSettings

Floats = NDArray[np.float64]
STEP_S = 0.015  # motion between two board samples, jitter included, is taken as straight
KNOCK_STEP_S = 0.001


class PressedPad:
    """The pad on its surface, advanced in the order of time."""

    def __init__(
        self, surface: FixedSurface, press: PressSettings, fingertip: FingertipSettings,
        rng: np.random.Generator, start_m: tuple[float, float, float], start_s: float,
    ) -> None:  # fmt: skip
        self._stiffness_npm = 1 / (
            1 / press.finger_stiffness_npm + 1 / press.arm_stiffness_npm
            + 1 / surface.wall_stiffness_npm
        )  # fmt: skip
        self._mount_npmm = np.array([1e-3 * self._stiffness_npm])
        self._slope = np.array([press.slope_x, press.slope_y])
        self._from_axis_m = np.array([press.axis_x_m, press.axis_y_m])
        self._start_m = np.array(start_m)
        self._apex_m = start_m[2] - press.gap_m
        self._off_apex_m = np.array([press.off_apex_x_m, press.off_apex_y_m])
        self.tips = Fingertips(fingertip, [_touched(surface)], rng)
        self._start_s = self._t_s = start_s
        self._motion_mm = np.zeros(2)
        self._at_m = np.zeros(2)
        self._height_m, self._angle_rad = start_m[2], 0.0
        self._knock = (math.inf, 1.0, 0.0)  # start, duration, impulse

    def knock(self, impulse_n_s: float, duration_s: float) -> None:
        """Something strikes the table now: a half sine added to the load, sideways nothing."""
        self._knock = (self._t_s, duration_s, impulse_n_s)

    def advance(
        self, t_s: float, position_m: tuple[float, float, float], angle_rad: float, moving: bool
    ) -> None:
        """To t_s, when the tool is there; it got there straight."""
        x, y, z = position_m
        at = np.array([x - self._start_m[0], self._start_m[1] - y])
        span = t_s - self._t_s
        if span <= 0.0:
            return
        knocked = self._knock[0] + self._knock[1] > self._t_s - KNOCK_STEP_S
        shaken = knocked and self._knock[2] > 0.0 and math.isfinite(self._knock[0])
        steps = math.ceil(span / (KNOCK_STEP_S if shaken else STEP_S) - 1e-6)
        from_at, from_z, from_angle, from_s = self._at_m, self._height_m, self._angle_rad, self._t_s
        for i in range(1, steps + 1):
            part = i / steps
            self._step(
                from_s + part * span, from_at + part * (at - from_at),
                from_z + part * (z - from_z), from_angle + part * (angle_rad - from_angle), moving,
            )  # fmt: skip

    def _step(self, t_s: float, at_m: Floats, height_m: float, angle: float, moving: bool) -> None:
        middle = 0.5 * (angle + self._angle_rad)
        arc = (angle - self._angle_rad) * _turned(self._from_axis_m, middle + 0.5 * math.pi)
        self._motion_mm = self._motion_mm - 1e3 * _turned(at_m - self._at_m + arc, -middle)
        self._at_m, self._height_m, self._angle_rad, self._t_s = at_m, height_m, angle, t_s
        turned = _turned(self._from_axis_m, angle) - self._from_axis_m
        off = at_m + turned + self._off_apex_m
        surface_m = self._apex_m + float(self._slope @ (off - self._off_apex_m))
        beyond = self._stiffness_npm * (surface_m - height_m) + self._struck(t_s)
        centre = _turned(-1e3 * off, -angle)
        self.tips.advance(
            t_s - self._start_s, np.array([beyond]), self._motion_mm[None, :],
            np.array([-angle]), centre[None, :], moving, self._mount_npmm,
        )  # fmt: skip

    @property
    def normal_n(self) -> float:
        """Load on the pad."""
        return float(self.tips.load_n[0])

    def _struck(self, t_s: float) -> float:
        start_s, duration_s, impulse_n_s = self._knock
        phase = (t_s - start_s) / duration_s
        if not 0.0 < phase < 1.0:
            return 0.0
        return 0.5 * math.pi * impulse_n_s / duration_s * math.sin(math.pi * phase)


def _touched(surface: FixedSurface) -> Surface:
    return Surface(
        curvature_per_mm=(
            1e-3 * _curvature(surface.radius_x_m), 1e-3 * _curvature(surface.radius_y_m)
        ),
        texture_rms_mm=surface.texture_rms_m * 1e3,
        texture_length_mm=surface.texture_length_m * 1e3,
        friction_static=surface.friction_kinetic * surface.friction_ratio,
        friction_kinetic=surface.friction_kinetic,
    )  # fmt: skip


def _curvature(radius_m: float) -> float:
    return 1.0 / radius_m if radius_m else 0.0


def _turned(vector: Floats, angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])
