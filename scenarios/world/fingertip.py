"""Simulated fingertips: readings of barometers under rubber while a surface presses and slides.

The pad is a bed of springs with friction bristles (``fingertip_laws``) over a height field fixed to
the object. Load and displacement of the surface are inputs; the bed decides which part of the
patch sticks, and so how much shear reaches the barometers. Each spring's normal and shear load
reaches the sensing plane through the two kernels of an incompressible layer bonded to its board
(closed forms of the Hankel solution; both scale with the effective depth h as 1/h^2). Wander and
vibration of the press are added, and per taxel the rest code, warming, noise and ten-bit rounding.
docs/simulation.md has the equations and the sources of the values.

Pad frame: x along the three columns, y across the two rows; taxels 0 1 2 in the lower row, 5 4 3
in the upper. Lengths in this file are millimetres, as in the kernels' published form.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from scenarios.world import fingertip_laws as laws
from scenarios.world.settings import FingertipSettings, Surface

FIELD_POINTS = 256  # per side of the periodic height field; a power of two
FIELD_STEPS = 5.0  # grid points per correlation length
# All assumed: spacing of the barometers (6-8); half size of the spring bed; its tangential over its
# normal stiffness (layer theory, 0.4-0.6); damping of a held object on its pads, of critical
# (0.1-0.3); range of rest codes. Numerical: longest path of an inner step, and the duration below
# which a step is not divided.
PITCH_MM = 6.0
PAD_HALF_LENGTH_MM, PAD_HALF_WIDTH_MM = 10.0, 8.0
SHEAR_SHARE = 0.5
HELD_DAMPING = 0.2
REST_LOW, REST_HIGH = 420, 480
STEP_MM, STEP_S = 0.05, 0.001
COUNT_KPA = 0.1255  # MPL115A2, NXP AN3785: pressing lowers the code
CODE_MAX = 1023
FOLD = 1 << 9  # the authors' driver reads ten bits as signed and takes the absolute value
BLOCK = 256  # rows of random numbers drawn at a time, which is ten times faster than single rows
TEMPERATURE_CODE = 498  # 25 degrees
TEMPERATURE_CODES_PER_K = -5.35
PRESSURE_COUNTS_PER_K = 1.6
Floats = NDArray[np.float64]
Codes = NDArray[np.int16]


def taxel_positions(settings: FingertipSettings) -> Floats:
    """(taxels, 2) positions, mm, from the settings or else the kit's: serpentine, 0 1 2 in the
    lower row and 5 4 3 in the upper."""
    if settings.taxels_mm:
        return np.array(settings.taxels_mm)
    x = np.array([-1.0, 0.0, 1.0, 1.0, 0.0, -1.0])
    y = np.array([-0.5, -0.5, -0.5, 0.5, 0.5, 0.5])
    return PITCH_MM * np.stack([x, y], axis=1)


class Kernel(msgspec.Struct, frozen=True):
    """Counts under 1 N: normal peak exp(-r^2 / 2 width^2), shear towards the taxel peak r exp(...).
    A 10 mm layer has 4.3 kPa/N, 5.6 mm, 0.38 kPa/N/mm and 6 mm; other depths by similarity."""

    normal_peak: float
    normal_width_mm: float
    shear_peak_per_mm: float
    shear_width_mm: float


def kernel(depth_mm: float) -> Kernel:
    """Kernels of a layer of that depth."""
    thin = 10.0 / depth_mm
    return Kernel(4.3 * thin**2 / COUNT_KPA, 5.6 / thin, 0.38 * thin**3 / COUNT_KPA, 6.0 / thin)


def spring_positions(settings: FingertipSettings) -> Floats:
    """(S, 2) centres of the cells that fill the pad, sorted from its centre outwards."""
    x = _centres(_cells(PAD_HALF_LENGTH_MM, settings), PAD_HALF_LENGTH_MM)
    y = _centres(_cells(PAD_HALF_WIDTH_MM, settings), PAD_HALF_WIDTH_MM)
    at = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    out: Floats = at[np.argsort((at**2).sum(axis=1), kind="stable")]
    return out


def _cells(half_mm: float, settings: FingertipSettings) -> int:
    return max(2, round(2 * half_mm / settings.spring_mm))


def _centres(n: int, half_mm: float) -> Floats:
    """Centres of n equal cells that fill -half_mm..half_mm."""
    return np.linspace(-half_mm, half_mm, 2 * n + 1)[1::2]


def height_field(surface: Surface, rng: np.random.Generator) -> tuple[laws.Singles, float]:
    """Heights in mm on a periodic grid, Gaussian with the surface's rms and correlation length
    (decay to 1/e); and the grid's step, mm."""
    white = rng.standard_normal((FIELD_POINTS, FIELD_POINTS), np.float32)
    length = FIELD_STEPS  # in grid points
    fx = np.fft.fftfreq(FIELD_POINTS)[:, None]
    fy = np.fft.rfftfreq(FIELD_POINTS)[None, :]
    smooth = np.exp(-0.5 * (np.pi * length) ** 2 * (fx**2 + fy**2))
    field = np.fft.irfft2(np.fft.rfft2(white) * smooth, s=white.shape)
    out = field * (surface.texture_rms_mm / field.std())
    return out.astype(np.float32), surface.texture_length_mm / FIELD_STEPS


class HeldObject(msgspec.Struct, frozen=True):
    """A free object between the pads. sides (F,): +1 or -1, the side of each pad; radps: natural
    frequency of its mass on all pads."""

    sides: Floats
    radps: float


class Fingertips:
    """Fingertips, one per surface, each with its own texture, tilt, rest codes and noise.

    The surfaces are fixed, or all belong to one held object. Then the hand shakes as a whole, the
    object follows with its inertia, and the load that friction adds through the fingers' levers is
    balanced on the object. Call ``advance`` in order of time. All random numbers come from the
    generator, so equal seeds and equal call times give equal codes.
    """

    def __init__(
        self, settings: FingertipSettings, surfaces: Sequence[Surface], rng: np.random.Generator,
        held: HeldObject | None = None,
    ) -> None:  # fmt: skip
        s, n = settings, len(surfaces)
        self._settings, self._rng, self._t_s = s, rng, 0.0
        at = spring_positions(s)
        self._parameters = _parameters(s, at, 0.0 if held is None else held.radps)
        self._at, self._taxels = np.ascontiguousarray(at.T), taxel_positions(s)
        fields = [height_field(surface, rng) for surface in surfaces]
        self._fields = np.stack([field for field, _ in fields])
        tilts = rng.normal((s.tilt_x_rad, s.tilt_y_rad), s.tilt_rad, (n, 2))
        crown = (at**2).sum(axis=1) / (2 * s.crown_radius_mm)
        gaps = crown + tilts @ at.T
        least = np.minimum.accumulate(gaps[:, ::-1], axis=1)[:, ::-1]
        self._gaps = np.stack([gaps, least], axis=1)
        angle = rng.uniform(0.0, 2 * math.pi, n)
        sides = np.zeros(n) if held is None else held.sides
        self._pads = np.array([
            (*x.curvature_per_mm, x.friction_static, x.friction_kinetic, step, field.max(),
             math.cos(angle[i]), math.sin(angle[i]), sides[i])
            for i, (x, (field, step)) in enumerate(zip(surfaces, fields, strict=True))
        ])  # fmt: skip
        self.rest = rng.integers(REST_LOW, REST_HIGH, (n, len(self._taxels)), endpoint=True)
        shaken = n if held is None else 1
        self._jitter_rng = rng.spawn(1)[0] if s.shift_mm > 0.0 or s.rock_rad > 0.0 else None
        self._normals = np.zeros((BLOCK, 4 * shaken + 2 + self.rest.size))
        self._jitter_normals = np.zeros((BLOCK, shaken, 2 * laws.JITTERS))
        self._row = BLOCK  # next of these; at the end both blocks are drawn again
        self._vibration = np.zeros((shaken, laws.VIBRATION))
        self._states = np.zeros((n, laws.STATE))
        self._springs = np.zeros((n, laws.SPRING, len(at)))
        self._contacts = np.zeros((n, 2, len(at)), np.int64)
        self._no_mount = np.zeros(n)  # mount stiffness 0: the load is an input
        self._pressed_rest, self._pressed_until_s = self.rest, 0.0
        self._pressure = self.rest.astype(np.int16)
        self._temperature_code = TEMPERATURE_CODE
        self._temperature = np.full_like(self._pressure, TEMPERATURE_CODE)

    def advance(
        self, t_s: float, normal_n: Floats, motion_mm: Floats, turn_rad: Floats,
        centre_mm: Floats, arm_moves: bool, mount_npmm: Floats | None = None,
    ) -> None:  # fmt: skip
        """Advance all pads to t_s; every input changes linearly from its previous value.

        normal_n (F,): load, 0 or less without contact. motion_mm (F, 2): integral of the surface's
        velocity at the pad's centre, relative to the mount's base, in the pad's frame. turn_rad
        (F,): rotation of the surface about that centre. centre_mm (F, 2): position of the widest
        point of a curved surface on the pad. arm_moves excites the arm's structural mode.

        mount_npmm (F,), above 0, is the stiffness of a spring that carries each pad. Then normal_n
        is the load with the pad's face at the surface's mean plane (stiffness times travel of the
        base beyond it); contact and friction determine the true load. Not for pads that hold an
        object.
        """
        dt_s = t_s - self._t_s
        if dt_s <= 0.0:
            return
        if self._row == BLOCK:
            self._draw_normals()
        self._t_s = t_s
        warming_k = self._settings.warming_k * -math.expm1(-t_s / self._settings.warming_s)
        laws.advance(
            self._parameters, dt_s, arm_moves, self._row, self._normals, self._jitter_normals,
            normal_n, motion_mm, turn_rad, centre_mm,
            self._no_mount if mount_npmm is None else mount_npmm, self._pads, self._fields,
            self._at, self._gaps, self._taxels,
            self._pressed_rest if t_s < self._pressed_until_s else self.rest,
            PRESSURE_COUNTS_PER_K * warming_k, self._vibration, self._states, self._springs,
            self._contacts, self._pressure,
        )  # fmt: skip
        self._row += 1
        temperature = round(TEMPERATURE_CODE + TEMPERATURE_CODES_PER_K * warming_k)
        if temperature != self._temperature_code:
            self._temperature_code = temperature
            self._temperature = np.full_like(self._pressure, temperature)

    def _draw_normals(self) -> None:
        """Draw the standard normal numbers of the next BLOCK steps."""
        self._rng.standard_normal(out=self._normals)
        if self._jitter_rng is not None:
            self._jitter_rng.standard_normal(out=self._jitter_normals)
        self._row = 0

    def press(self, pad: int, taxel: int, load_n: float, until_s: float) -> None:
        """Press the rubber over one taxel with a point load until until_s or the next press. Loads
        neither object nor hand. Raises ValueError for an unknown taxel."""
        if taxel >= len(self._taxels):
            raise ValueError(f"taxel {taxel} is unknown; allowed: 0 to {len(self._taxels) - 1}")
        under = kernel(self._settings.depth_mm)
        far = ((self._taxels - self._taxels[taxel]) ** 2).sum(axis=1) / under.normal_width_mm**2
        self._pressed_rest = self.rest.copy()
        counts = np.rint(load_n * under.normal_peak * np.exp(-0.5 * far))
        self._pressed_rest[pad] -= counts.astype(np.int64)
        self._pressed_until_s = until_s

    def codes(self) -> tuple[Codes, Codes]:
        """Pressure and temperature codes (F, taxels) as of the last ``advance``."""
        return self._pressure.copy(), self._temperature

    @property
    def slid(self) -> Floats:
        """(F, 3) accumulated sliding at the load's centre: mm, mm, rad."""
        out: Floats = self._states[:, laws.SLID_X : laws.SLID_TURN + 1].copy()
        return out

    @property
    def load_n(self) -> Floats:
        """(F,) load on the springs, N."""
        return self._state_column(laws.CARRIED)

    @property
    def approach_mm(self) -> Floats:
        """(F,) travel of the pad's base towards the surface's mean plane that carries the load, mm.
        0 or stale without contact."""
        return self._state_column(laws.APPROACH)

    @property
    def sliding_share(self) -> Floats:
        """(F,) share of the load on sliding springs at the end of the last step."""
        return self._state_column(laws.SHARE)

    def _state_column(self, column: int) -> Floats:
        out: Floats = self._states[:, column].copy()
        return out


def _parameters(s: FingertipSettings, at: Floats, held_object_radps: float) -> Floats:
    area_mm2 = 4 * PAD_HALF_LENGTH_MM * PAD_HALF_WIDTH_MM
    stiffness = s.foundation_n_per_mm3 * area_mm2 / len(at)
    out = np.empty(laws.PARAMETERS)
    out[:] = (
        stiffness, stiffness * SHEAR_SHARE, STEP_MM, STEP_S,
        *msgspec.structs.astuple(kernel(s.depth_mm)), s.lever_x, s.lever_y, s.lateral_npmm,
        2 * math.pi * s.lateral_hz, s.lateral_damping, PAD_HALF_LENGTH_MM, PAD_HALF_WIDTH_MM,
        at[:, 0].max(), s.wander_mm, s.wander_fast_s, s.wander_slow_s,
        s.vibration_mm, 2 * math.pi * s.vibration_hz, s.vibration_damping, s.sway_mm, s.shift_mm,
        s.rock_rad, s.jitter_s, held_object_radps, HELD_DAMPING, s.noise_counts, CODE_MAX,
        FOLD if s.fold_above_512 else CODE_MAX, s.relaxation_share, s.relaxation_slow_share,
        s.relaxation_slow_share, s.relaxation_s, 10.0 * s.relaxation_s, 100.0 * s.relaxation_s,
    )  # fmt: skip
    return out
