"""What six barometers under rubber read while a surface presses and slides: a first, simple form.

The pad is a bed of springs (Winkler) on a grid fixed to the pad. A height field fixed to the object
slides beneath it, so the pressure under each spring changes as its bump passes: this is what makes
slip audible. On a round object the contact centre migrates over the pad as the pad slides past the
widest point, and a pad that sticks carries its loads along as it shears. Each spring's normal and
shear load reaches the sensing plane through the two kernels of an incompressible layer bonded to
its board (closed forms, few per cent; both scale with the effective depth h as 1/h^2). The normal
load also wanders a little, and every taxel has rest count, temperature drift, noise, whole counts
and ten bits.

Fingertip frame: x along the three columns, y across the two rows; taxels 0 1 2 in the lower row,
5 4 3 in the upper. All lengths in this file are millimetres, as in the kernels' published form.
"""

import math
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numba import njit
from numpy.typing import NDArray

from scenarios.world.objects import GraspObject

FINGERS = 3
TAXELS = 6
GRID_X, GRID_Y = 10, 6  # springs along and across the slip
FIELD_STEP_MM = 0.25
FIELD_LENGTH = 1024  # 256 mm of surface before it repeats
COUNT_KPA = 0.1255  # MPL115A2, NXP AN3785: pressing lowers the code
CODE_MAX = 1023
TEMPERATURE_CODE = 498  # 25 degrees
TEMPERATURE_CODES_PER_K = -5.35
PRESSURE_COUNTS_PER_K = 1.6
Floats = NDArray[np.float64]
Codes = NDArray[np.int16]


class FingertipSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Geometry and noise of one fingertip."""

    pitch_mm: Annotated[
        float, Meta(ge=3.0, le=10.0, description="between barometers; assumed, 6-8 mm")
    ] = 6.0
    depth_mm: Annotated[
        float,
        Meta(ge=2.0, le=10.0, description="effective rubber depth; the authors' clip: 3.5-6 mm"),
    ] = 4.0
    pad_half_length_mm: Annotated[
        float, Meta(ge=3.0, le=20.0, description="of the spring bed, along the slip; assumed")
    ] = 10.0
    pad_half_width_mm: Annotated[
        float, Meta(ge=3.0, le=20.0, description="of the spring bed, across; assumed")
    ] = 8.0
    crown_radius_mm: Annotated[
        float, Meta(ge=20.0, le=1000.0, description="curvature of the pad's face; assumed")
    ] = 100.0
    foundation_n_per_mm3: Annotated[
        float, Meta(ge=0.02, le=1.0, description="spring bed; fitted to the clip, 0.08-0.2")
    ] = 0.14
    slip_direction_deg: Annotated[
        float,
        Meta(ge=-180.0, le=180.0, description="upward motion in the pad's frame, from x; assumed"),
    ] = 0.0
    centre_spread_mm: Annotated[
        float, Meta(ge=0.0, le=5.0, description="deviation of the patch centre; assumed")
    ] = 1.0
    wander_n: Annotated[
        float, Meta(ge=0.0, le=1.0, description="rms of normal load at rest; assumed, 0.02-0.3 N")
    ] = 0.05
    vibration_n: Annotated[
        float,
        Meta(ge=0.0, le=1.0, description="rms of load added while the arm moves; assumed, 0-0.3 N"),
    ] = 0.05
    wander_memory_s: Annotated[
        float, Meta(ge=0.005, le=1.0, description="of both; assumed, 10-100 ms")
    ] = 0.03
    noise_counts: Annotated[
        float, Meta(ge=0.0, le=5.0, description="before rounding; real clip 0.3")
    ] = 0.3
    rest_low: Annotated[int, Meta(ge=300, le=600, description="rest codes drawn from")] = 420
    rest_high: Annotated[int, Meta(ge=300, le=600, description="rest codes drawn to")] = 480
    drift_k_per_s: Annotated[
        float, Meta(ge=-1.0, le=1.0, description="warming of the board; assumed")
    ] = 0.005


def taxel_positions(pitch_mm: float) -> Floats:
    """(6, 2) positions in mm: serpentine, 0 1 2 below and 5 4 3 above."""
    x = pitch_mm * np.array([-1.0, 0.0, 1.0, 1.0, 0.0, -1.0])
    y = pitch_mm * np.array([-0.5, -0.5, -0.5, 0.5, 0.5, 0.5])
    return np.stack([x, y], axis=1)


def normal_kernel(r_mm: Floats, depth_mm: float) -> Floats:
    """Pressure under 1 N at distance r, kPa/N."""
    scale = 10.0 / depth_mm
    out: Floats = 4.3 * scale**2 * np.exp(-((r_mm * scale) ** 2) / (2 * 5.6**2))
    return out


def shear_kernel(r_mm: Floats, depth_mm: float) -> Floats:
    """Pressure of 1 N of traction towards the taxel at distance r, kPa/N (antisymmetric in r)."""
    scale = 10.0 / depth_mm
    r10 = r_mm * scale
    out: Floats = 0.38 * scale**2 * r10 * np.exp(-(r10**2) / (2 * 6.0**2))
    return out


class Pad:
    """Constant matrices of one fingertip: spring positions and kernels in the pad's frame."""

    def __init__(self, settings: FingertipSettings) -> None:
        s = settings
        along = _centres(GRID_X, s.pad_half_length_mm)
        across = _centres(GRID_Y, s.pad_half_width_mm)
        u, w = (m.ravel() for m in np.meshgrid(along, across, indexing="ij"))
        self.along_mm = u
        self.row = np.tile(np.arange(GRID_Y), GRID_X)
        self.gap_mm = (u**2 + w**2) / (2 * s.crown_radius_mm)
        area = 4 * s.pad_half_length_mm * s.pad_half_width_mm / (GRID_X * GRID_Y)
        self.spring_npmm = s.foundation_n_per_mm3 * area
        angle = math.radians(s.slip_direction_deg)
        self.direction = np.array([math.cos(angle), math.sin(angle)])
        self.springs_mm = np.outer(u, self.direction) + np.outer(
            w, [-self.direction[1], self.direction[0]]
        )

    def kernels(
        self, settings: FingertipSettings, centre_mm: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Counts per newton, (6, springs) each, for a pad whose middle sits at centre_mm: of normal
        load, of shear load, and the change of the first per millimetre that the load moves along.
        """
        away = taxel_positions(settings.pitch_mm)[:, None, :] - (self.springs_mm + centre_mm)
        r = np.hypot(away[..., 0], away[..., 1])
        ahead = away @ self.direction / np.maximum(r, 1e-9)
        normal = normal_kernel(r, settings.depth_mm) / COUNT_KPA
        shear = shear_kernel(r, settings.depth_mm) * ahead / COUNT_KPA
        width = 5.6 * settings.depth_mm / 10.0  # of the normal kernel's Gaussian
        moved = normal * (away @ self.direction) / width**2
        return normal, shear, moved


def _centres(n: int, half_mm: float) -> Floats:
    """Centres of n equal cells that fill -half_mm..half_mm."""
    return np.linspace(-half_mm, half_mm, 2 * n + 1)[1::2]


def vertical_curvature(body: GraspObject) -> float:
    """Of the object at its widest point, 1/mm; 0 for a straight body."""
    if body.shape == "straight":
        return 0.0
    return body.half_width_m / body.half_height_m**2 * 1e-3


def height_field(body: GraspObject, rng: np.random.Generator) -> Floats:
    """(rows, positions) heights in mm of the object's surface, periodic, with the stated rms."""
    white = rng.standard_normal((GRID_Y, FIELD_LENGTH))
    frequency = np.fft.rfftfreq(FIELD_LENGTH, FIELD_STEP_MM)
    length = body.texture_length_m * 1e3
    filtered = np.fft.rfft(white, axis=1) * np.exp(-0.5 * (np.pi * frequency * length) ** 2)
    field = np.fft.irfft(filtered, n=FIELD_LENGTH, axis=1)
    out: Floats = field / field.std() * body.texture_rms_m * 1e3
    return out


@njit(cache=True)
def spring_loads(
    force_n: float, slip_mm: float, centre_mm: float, curvature: float,
    along: Floats, row: NDArray[np.int64], gap: Floats, stiffness: float, field: Floats,
    out: Floats,
) -> None:  # fmt: skip
    """Load of each spring, N, so that they sum to force_n. Newton solves for the common approach:
    the sum rises piecewise linearly and convexly with it, so a few steps are exact."""
    n = along.shape[0]
    positions = field.shape[1]
    height = np.empty(n)
    for j in range(n):
        at = (along[j] + slip_mm) / FIELD_STEP_MM
        base = math.floor(at)
        left = int(base) % positions
        right = (left + 1) % positions
        part = at - base
        height[j] = field[row[j], left] * (1 - part) + field[row[j], right] * part - gap[j]
        height[j] -= 0.5 * curvature * (along[j] - centre_mm) ** 2
    approach = force_n / (stiffness * n) - height.min()  # all springs touch: never too shallow
    for _ in range(60):
        total = 0.0
        touching = 0
        for j in range(n):
            d = approach + height[j]
            if d > 0.0:
                total += d
                touching += 1
        change = (total - force_n / stiffness) / touching
        approach -= change
        if abs(change) < 1e-9:
            break
    for j in range(n):
        out[j] = stiffness * max(0.0, approach + height[j])


@njit(cache=True)
def pressures(
    normal_n: Floats, shear_n: Floats, slip_mm: float, stretch_mm: Floats, centre_mm: float,
    curvature: float, along: Floats, row: NDArray[np.int64], gap: Floats, stiffness: float,
    fields: Floats, k_normal: Floats, k_shear: Floats, k_moved: Floats, out: Floats,
) -> None:  # fmt: skip
    """Fall of each taxel's code, counts (3, 6), under the three fingers' loads."""
    springs = along.shape[0]
    load = np.empty(springs)
    for f in range(FINGERS):
        for i in range(TAXELS):
            out[f, i] = 0.0
        if normal_n[f] <= 0.0:
            continue
        # A pad that sticks holds its patch of surface: only what it has slid brings new texture.
        slid = slip_mm - stretch_mm[f]
        spring_loads(
            normal_n[f], slid, centre_mm, curvature, along, row, gap, stiffness, fields[f], load
        )
        traction = shear_n[f] / normal_n[f]
        shift = -stretch_mm[f]  # the object lags behind the finger and takes the load with it
        for j in range(springs):
            if load[j] > 0.0:
                for i in range(TAXELS):
                    gain = k_normal[f, i, j] + shift * k_moved[f, i, j]
                    out[f, i] += load[j] * (gain + traction * k_shear[f, i, j])


class Fingertips:
    """Three fingertips with their own textures, patch centres, rest codes and noise.

    ``sample`` must be called in the order of time; everything random comes from the generator, so
    equal seeds and equal call times give equal codes.
    """

    def __init__(
        self, settings: FingertipSettings, body: GraspObject, rng: np.random.Generator
    ) -> None:
        self._settings = settings
        self._pad = Pad(settings)
        self._fields = np.stack([height_field(body, rng) for _ in range(FINGERS)])
        centres = rng.normal(0.0, settings.centre_spread_mm, (FINGERS, 2))
        kernels = [self._pad.kernels(settings, c) for c in centres]
        self._k_normal = np.stack([k[0] for k in kernels])
        self._k_shear = np.stack([k[1] for k in kernels])
        self._k_moved = np.stack([k[2] for k in kernels])
        self._curvature = vertical_curvature(body)
        self.rest = rng.integers(
            settings.rest_low, settings.rest_high, (FINGERS, TAXELS), endpoint=True
        )
        self._rng = rng
        self._wander = np.zeros((2, FINGERS))  # of normal and shear load, unit variance
        self._t_s = 0.0
        self._fall = np.zeros((FINGERS, TAXELS))
        self._block = rng.standard_normal((0, 0))
        self._next = 0

    def _draw(self) -> Floats:
        """24 standard normal numbers; drawn in blocks, which costs a tenth of single draws."""
        if self._next >= len(self._block):
            self._block = self._rng.standard_normal((256, 2 * FINGERS + FINGERS * TAXELS))
            self._next = 0
        self._next += 1
        out: Floats = self._block[self._next - 1]
        return out

    def sample(
        self, t_s: float, normal_n: Floats, shear_n: Floats, slip_mm: float, stretch_mm: Floats,
        centre_mm: float, arm_moves: bool,
    ) -> tuple[Codes, Codes]:  # fmt: skip
        """Pressure and temperature codes (3, 6) int16 at time t_s.

        centre_mm: where on the pads the object's widest point is, along the slip.
        """
        s = self._settings
        noise = self._draw()
        keep = math.exp(-(t_s - self._t_s) / s.wander_memory_s)
        self._t_s = t_s
        self._wander *= keep
        self._wander += math.sqrt(1 - keep * keep) * noise[: 2 * FINGERS].reshape(2, FINGERS)
        rms = s.wander_n + (s.vibration_n if arm_moves else 0.0)
        touching = normal_n > 0.0
        normal = np.where(touching, np.maximum(normal_n + rms * self._wander[0], 1e-3), 0.0)
        pad = self._pad
        pressures(
            normal, shear_n + rms * self._wander[1], slip_mm, stretch_mm, centre_mm,
            self._curvature, pad.along_mm, pad.row, pad.gap_mm, pad.spring_npmm, self._fields,
            self._k_normal, self._k_shear, self._k_moved, self._fall,
        )  # fmt: skip
        warming = s.drift_k_per_s * t_s
        code = self.rest - self._fall + PRESSURE_COUNTS_PER_K * warming
        code += s.noise_counts * noise[2 * FINGERS :].reshape(FINGERS, TAXELS)
        temperature = round(TEMPERATURE_CODE + TEMPERATURE_CODES_PER_K * warming)
        return (
            np.rint(code).clip(0, CODE_MAX).astype(np.int16),
            np.full((FINGERS, TAXELS), temperature, np.int16),
        )
