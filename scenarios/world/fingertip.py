"""What six barometers under rubber read while a surface presses, slides and turns.

The pad is a bed of springs with friction bristles (``spring_bed``) over a height field fixed to
the object. Load and displacement of the surface come from outside; the bed decides which part of
the patch holds on, and so what shear reaches the barometers. Each spring's normal and shear load
reaches the sensing plane through the two kernels of an incompressible layer bonded to its board
(closed forms of the Hankel solution; both scale with the effective depth h as 1/h^2). On top come
wander and vibration of the press, and of each taxel rest code, warming, noise, whole counts and ten
bits. docs/fingertip.md has the equations, their sources and the fit to a real recording.

Pad frame: x along the three columns, y across the two rows; taxels 0 1 2 in the lower row, 5 4 3
in the upper. Lengths in this file are millimetres, as in the kernels' published form.
"""

import math
from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from scenarios.world import spring_bed as bed

TAXELS = 6
SPRINGS_X, SPRINGS_Y = 10, 8
FIELD_POINTS = 256  # a power of two, of either side of the height field, which is periodic
FIELD_STEPS = 5.0  # grid points to a correlation length
COUNT_KPA = 0.1255  # MPL115A2, NXP AN3785: pressing lowers the code
CODE_MAX = 1023
FOLD = 1 << 9  # the authors' driver takes ten bits for a signed number, and its absolute value
TEMPERATURE_CODE = 498  # 25 degrees
TEMPERATURE_CODES_PER_K = -5.35
PRESSURE_COUNTS_PER_K = 1.6
Floats = NDArray[np.float64]
Codes = NDArray[np.int16]


class Surface(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What one pad touches. All figures are assumed."""

    curvature_per_mm: Annotated[
        tuple[float, float],
        Meta(description="along x and y of the pad before anything turns; 0 is flat"),
    ] = (0.0, 0.0)
    texture_rms_mm: Annotated[
        float, Meta(ge=0.0, le=1.0, description="irregularity; felt 0.3-0.45, smooth 0.01-0.2")
    ] = 0.1
    texture_length_mm: Annotated[
        float, Meta(ge=0.2, le=10.0, description="its correlation length; 1-2 mm")
    ] = 1.5
    friction_static: Annotated[float, Meta(ge=0.0, le=3.0, description="of rubber on it")] = 0.85
    friction_kinetic: Annotated[float, Meta(ge=0.0, le=3.0, description="when it slides")] = 0.7


class FingertipSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Geometry, rubber and noise of one fingertip. FITTED: by `grasp world calibrate`, on the
    authors' clip; the range beside it is that searched, and the one to draw from in data sets."""

    pitch_mm: Annotated[
        float, Meta(ge=3.0, le=10.0, description="between barometers; assumed, 6-8")
    ] = 6.0
    depth_mm: Annotated[
        float, Meta(ge=2.0, le=10.0, description="effective depth of the rubber; FITTED, 3-8")
    ] = 3.23
    pad_half_length_mm: Annotated[
        float, Meta(ge=3.0, le=20.0, description="of the spring bed, along x; assumed")
    ] = 10.0
    pad_half_width_mm: Annotated[
        float, Meta(ge=3.0, le=20.0, description="of the spring bed, along y; assumed")
    ] = 8.0
    crown_radius_mm: Annotated[
        float, Meta(ge=20.0, le=1000.0, description="of the pad's face; FITTED, 40-400")
    ] = 65.8
    tilt_rad: Annotated[
        float, Meta(ge=0.0, le=0.2, description="deviation of each pad's tilt, both axes; "
                    "FITTED, 0.02-0.1")
    ] = 0.0854  # fmt: skip
    foundation_n_per_mm3: Annotated[
        float, Meta(ge=0.02, le=1.0, description="spring bed, normal; FITTED, 0.05-0.3")
    ] = 0.223
    shear_share: Annotated[
        float, Meta(ge=0.1, le=1.0, description="of it, tangential stiffness; assumed from layer "
                    "theory, 0.4-0.6")
    ] = 0.5  # fmt: skip
    relaxation_share: Annotated[
        float, Meta(ge=0.0, le=0.5, description="of a spring's load that relaxes; assumed, the "
                    "clip's 0.05-0.15")
    ] = 0.1  # fmt: skip
    relaxation_s: Annotated[
        float, Meta(ge=0.01, le=5.0, description="time constant of that; assumed, 0.1-0.3")
    ] = 0.2
    wander_mm: Annotated[
        float, Meta(ge=0.0, le=0.1, description="rms of how much deeper or shallower the pad is "
                    "held than asked for; FITTED, 0.001-0.04")
    ] = 0.0372  # fmt: skip
    wander_fast_s: Annotated[
        float, Meta(ge=0.005, le=1.0, description="memory of its fast half; FITTED, 0.01-0.1")
    ] = 0.0323
    wander_slow_s: Annotated[
        float, Meta(ge=0.05, le=10.0, description="memory of its slow half; FITTED, 0.1-1")
    ] = 0.212
    vibration_mm: Annotated[
        float, Meta(ge=0.0, le=0.1, description="likewise by the mode of an arm that moves; "
                    "FITTED, 0.0005-0.03")
    ] = 0.00831  # fmt: skip
    sway_mm: Annotated[
        float, Meta(ge=0.0, le=0.5, description="rms of that mode sideways; assumed, 0-0.05")
    ] = 0.01
    grasp_share: Annotated[
        float, Meta(ge=0.0, le=1.0, description="of wander and vibration that a grasped object "
                    "leaves: it rides on the arm with its pads; assumed, 0.05-0.5")
    ] = 0.2  # fmt: skip
    vibration_hz: Annotated[
        float, Meta(ge=2.0, le=45.0, description="frequency of that mode; FITTED, 10-25")
    ] = 18.7
    vibration_damping: Annotated[
        float, Meta(ge=0.005, le=1.0, description="of that mode; assumed, 0.04-0.15")
    ] = 0.08
    noise_counts: Annotated[
        float, Meta(ge=0.0, le=5.0, description="rms before rounding; assumed, unloaded "
                    "taxels of the clip 0.2-0.5")
    ] = 0.3  # fmt: skip
    rest_low: Annotated[int, Meta(ge=300, le=600, description="rest codes; assumed from")] = 420
    rest_high: Annotated[int, Meta(ge=300, le=600, description="rest codes; assumed to")] = 480
    warming_k: Annotated[
        float, Meta(ge=-20.0, le=20.0, description="of the board in the end; assumed, 0-10")
    ] = 5.0
    warming_s: Annotated[
        float, Meta(ge=10.0, le=10000.0, description="time constant of that; assumed")
    ] = 600.0
    fold_above_512: Annotated[
        bool,
        Meta(description="codes as the authors' driver read them: 512 + n comes out as 512 - n"),
    ] = False
    slip_direction_deg: Annotated[
        float,
        Meta(ge=-180.0, le=180.0, description="upwards in the pad's frame, from x; assumed"),
    ] = 0.0
    step_mm: Annotated[float, Meta(gt=0.0, le=1.0, description="longest path of an inner step")] = (
        0.05
    )
    step_s: Annotated[float, Meta(gt=0.0, le=0.01, description="no inner step need be shorter")] = (
        0.001
    )


def in_a_grasp(settings: FingertipSettings) -> FingertipSettings:
    """The same pads on an object that the hand holds, not the arm presses."""
    share = settings.grasp_share
    return msgspec.structs.replace(
        settings,
        wander_mm=share * settings.wander_mm,
        vibration_mm=share * settings.vibration_mm,
        sway_mm=share * settings.sway_mm,
    )


def taxel_positions(pitch_mm: float) -> Floats:
    """(6, 2) positions in mm: serpentine, 0 1 2 below and 5 4 3 above."""
    x = pitch_mm * np.array([-1.0, 0.0, 1.0, 1.0, 0.0, -1.0])
    y = pitch_mm * np.array([-0.5, -0.5, -0.5, 0.5, 0.5, 0.5])
    return np.stack([x, y], axis=1)


class Kernel(msgspec.Struct, frozen=True):
    """Counts under 1 N: normal peak exp(-r^2 / 2 width^2), shear towards the taxel peak r exp(...).
    Of a 10 mm layer 4.3 kPa/N, 5.6 mm, 0.38 kPa/N/mm and 6 mm; of depth h by similarity."""

    normal_peak: float
    normal_width_mm: float
    shear_peak_per_mm: float
    shear_width_mm: float


def kernel(depth_mm: float) -> Kernel:
    """Kernels of a layer of that depth."""
    thin = 10.0 / depth_mm
    return Kernel(
        4.3 * thin**2 / COUNT_KPA, 5.6 / thin, 0.38 * thin**3 / COUNT_KPA, 6.0 / thin
    )  # fmt: skip


def spring_positions(settings: FingertipSettings) -> Floats:
    """(S, 2) centres of the cells that fill the pad; the first has the least x and y."""
    x = _centres(SPRINGS_X, settings.pad_half_length_mm)
    y = _centres(SPRINGS_Y, settings.pad_half_width_mm)
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def _centres(n: int, half_mm: float) -> Floats:
    """Centres of n equal cells that fill -half_mm..half_mm."""
    return np.linspace(-half_mm, half_mm, 2 * n + 1)[1::2]


def height_field(surface: Surface, rng: np.random.Generator) -> tuple[bed.Singles, float]:
    """Heights in mm on a periodic grid, Gaussian with the stated rms and correlation length (of a
    fall to 1/e); and the grid's step, mm."""
    white = rng.standard_normal((FIELD_POINTS, FIELD_POINTS), np.float32)
    length = FIELD_STEPS  # in grid points
    fx = np.fft.fftfreq(FIELD_POINTS)[:, None]
    fy = np.fft.rfftfreq(FIELD_POINTS)[None, :]
    smooth = np.exp(-0.5 * (np.pi * length) ** 2 * (fx**2 + fy**2))
    field = np.fft.irfft2(np.fft.rfft2(white) * smooth, s=white.shape)
    out = field * (surface.texture_rms_mm / field.std())
    return out.astype(np.float32), surface.texture_length_mm / FIELD_STEPS


class Fingertips:
    """One fingertip a surface, each with its own texture, tilt, rest codes and noise.

    ``advance`` must be called in the order of time. Everything random comes from the generator, so
    equal seeds and equal call times give equal codes.
    """

    def __init__(
        self, settings: FingertipSettings, surfaces: Sequence[Surface], rng: np.random.Generator
    ) -> None:
        s, n = settings, len(surfaces)
        self._settings, self._rng, self._pads = s, rng, n
        self._at = spring_positions(s)
        self._taxels = taxel_positions(s.pitch_mm)
        self._parameters = _parameters(s)
        fields = [height_field(surface, rng) for surface in surfaces]
        self._fields = np.stack([field for field, _ in fields])
        self._surfaces = np.array([
            (*x.curvature_per_mm, x.friction_static, x.friction_kinetic, step)
            for x, (_, step) in zip(surfaces, fields, strict=True)
        ])  # fmt: skip
        tilts = rng.normal(0.0, s.tilt_rad, (n, 2))
        crown = (self._at**2).sum(axis=1) / (2 * s.crown_radius_mm)
        self._gaps = crown + tilts @ self._at.T
        angle = rng.uniform(0.0, 2 * math.pi, n)
        self._shaking = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        self.rest = rng.integers(s.rest_low, s.rest_high, (n, TAXELS), endpoint=True)
        self._states = np.zeros((n, bed.STATE))
        self._springs = np.zeros((n, bed.SPRING, len(self._at)))
        self._block, self._next = rng.standard_normal((0, 0)), 0
        self._begin(n)

    def _begin(self, n: int) -> None:
        self._t_s = 0.0
        self._disturbance = np.zeros((bed.DISTURBANCE, n))
        self._normal = np.zeros(n)
        self._motion = np.zeros((n, 2))
        self._turn = np.zeros(n)
        self._centre = np.zeros((n, 2))
        self._noise = np.zeros((n, TAXELS))

    def advance(
        self, t_s: float, normal_n: Floats, motion_mm: Floats, turn_rad: Floats,
        centre_mm: Floats, arm_moves: bool,
    ) -> None:  # fmt: skip
        """Bring all pads to t_s; everything given goes linearly from its last value to this one.

        normal_n (F,): load, 0 or less without contact. motion_mm (F, 2): integral of the velocity
        of the surface at the pad's middle, relative to the pad's base, in the pad's frame.
        turn_rad (F,): rotation of the surface about it. centre_mm (F, 2): where on the pad the
        widest point of a curved surface lies. arm_moves excites the arm's mode.
        """
        dt_s = t_s - self._t_s
        if dt_s <= 0.0:
            return
        row, n = self._draw(), self._pads
        self._noise = row[4 * n + 2 :].reshape(n, TAXELS)
        normal, motion = np.empty(n), np.empty((n, 2))
        bed.disturb(
            self._parameters, dt_s, arm_moves, normal_n, motion_mm, self._shaking, row,
            self._states, self._disturbance, normal, motion,
        )  # fmt: skip
        bed.advance(
            self._parameters, dt_s, self._normal, normal, motion - self._motion,
            turn_rad - self._turn, self._centre, centre_mm, self._surfaces, self._fields,
            self._at, self._gaps, self._states, self._springs,
        )  # fmt: skip
        self._t_s, self._normal, self._motion = t_s, normal, motion
        self._turn[:], self._centre[:] = turn_rad, centre_mm

    def _draw(self) -> Floats:
        """Standard normal numbers of one step; drawn in blocks, a tenth of the cost of singles."""
        if self._next >= len(self._block):
            self._block = self._rng.standard_normal((256, self._pads * (4 + TAXELS) + 2))
            self._next = 0
        self._next += 1
        out: Floats = self._block[self._next - 1]
        return out

    def codes(self) -> tuple[Codes, Codes]:
        """Pressure and temperature codes (F, 6) as of the last ``advance``."""
        s = self._settings
        fall = np.empty((self._pads, TAXELS))
        bed.kernel_sums(self._parameters, self._springs, self._at, self._taxels, fall)
        warming = s.warming_k * -math.expm1(-self._t_s / s.warming_s)
        exact = self.rest - fall + PRESSURE_COUNTS_PER_K * warming + s.noise_counts * self._noise
        pressure = np.minimum(np.maximum(np.rint(exact), 0.0), CODE_MAX)
        if s.fold_above_512:
            pressure = np.where(pressure > FOLD, 2 * FOLD - pressure, pressure)
        temperature = round(TEMPERATURE_CODE + TEMPERATURE_CODES_PER_K * warming)
        return (
            pressure.astype(np.int16),
            np.full((self._pads, TAXELS), temperature, np.int16),
        )

    @property
    def approach_mm(self) -> Floats:
        """(F,) how far the pad's base has come towards the surface's mean plane: what it takes to
        carry the load on this spot. 0 or stale without contact."""
        out: Floats = self._states[:, bed.APPROACH].copy()
        return out

    @property
    def slip_mps(self) -> Floats:
        """(F,) sliding speed of the surface over the pad at its middle, mean of the last step: of
        the rigid motion that fits the slip of all springs best, weighted by their load."""
        out: Floats = np.hypot(self._states[:, bed.SLIP_X], self._states[:, bed.SLIP_Y]) * 1e-3
        return out

    @property
    def turn_radps(self) -> Floats:
        """(F,) turning rate of that motion, either sign."""
        out: Floats = self._states[:, bed.SPIN].copy()
        return out

    @property
    def sliding_share(self) -> Floats:
        """(F,) share of the load on springs that slide, at the end of the last step."""
        out: Floats = self._states[:, bed.SHARE].copy()
        return out


def _parameters(s: FingertipSettings) -> Floats:
    area = 4 * s.pad_half_length_mm * s.pad_half_width_mm / (SPRINGS_X * SPRINGS_Y)
    out = np.empty(bed.PARAMETERS)
    stiffness = s.foundation_n_per_mm3 * area
    out[:] = (
        stiffness, stiffness * s.shear_share, s.relaxation_share, s.relaxation_s,
        s.step_mm, s.step_s, *msgspec.structs.astuple(kernel(s.depth_mm)),
        s.wander_mm, s.wander_fast_s, s.wander_slow_s, s.vibration_mm, s.sway_mm,
        2 * math.pi * s.vibration_hz, s.vibration_damping,
    )  # fmt: skip
    return out
