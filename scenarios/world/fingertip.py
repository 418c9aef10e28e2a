"""What barometers under rubber read while a surface presses, slides and turns.

The pad is a bed of springs with friction bristles (``spring_bed``) over a height field fixed to
the object. Load and displacement of the surface come from outside; the bed decides which part of
the patch holds on, and so what shear reaches the barometers. Each spring's normal and shear load
reaches the sensing plane through the two kernels of an incompressible layer bonded to its board
(closed forms of the Hankel solution; both scale with the effective depth h as 1/h^2). On top come
wander and vibration of the press, and of each taxel rest code, warming, noise, whole counts and ten
bits. docs/simulation.md has the equations and the sources of the values.

Pad frame: x along the three columns, y across the two rows; taxels 0 1 2 in the lower row, 5 4 3
in the upper. Lengths in this file are millimetres, as in the kernels' published form.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from scenarios.world import pad_vibration
from scenarios.world import spring_bed as bed
from scenarios.world.settings import FingertipSettings, Surface

FIELD_POINTS = 256  # a power of two, of either side of the height field, which is periodic
FIELD_STEPS = 5.0  # grid points to a correlation length
# All assumed: between barometers (6-8); of the spring bed along x and y; its tangential stiffness
# over the normal one (layer theory, 0.4-0.6); damping of a held object on its pads, of critical
# (0.1-0.3); rest codes from and to; and, numerical, the longest path of an inner step, and the time
# below which none need be.
PITCH_MM = 6.0
PAD_HALF_LENGTH_MM, PAD_HALF_WIDTH_MM = 10.0, 8.0
SHEAR_SHARE = 0.5
HELD_DAMPING = 0.2
REST_LOW, REST_HIGH = 420, 480
STEP_MM, STEP_S = 0.05, 0.001
COUNT_KPA = 0.1255  # MPL115A2, NXP AN3785: pressing lowers the code
CODE_MAX = 1023
FOLD = 1 << 9  # the authors' driver takes ten bits for a signed number, and its absolute value
TEMPERATURE_CODE = 498  # 25 degrees
TEMPERATURE_CODES_PER_K = -5.35
PRESSURE_COUNTS_PER_K = 1.6
Floats = NDArray[np.float64]
Codes = NDArray[np.int16]


def taxel_positions(settings: FingertipSettings) -> Floats:
    """(taxels, 2) positions in mm; the kit's, unless the settings name others: serpentine, 0 1 2
    below and 5 4 3 above."""
    if settings.taxels_mm:
        return np.array(settings.taxels_mm)
    x = np.array([-1.0, 0.0, 1.0, 1.0, 0.0, -1.0])
    y = np.array([-0.5, -0.5, -0.5, 0.5, 0.5, 0.5])
    return PITCH_MM * np.stack([x, y], axis=1)


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
    return Kernel(4.3 * thin**2 / COUNT_KPA, 5.6 / thin, 0.38 * thin**3 / COUNT_KPA, 6.0 / thin)


def spring_positions(settings: FingertipSettings) -> Floats:
    """(S, 2) centres of the cells that fill the pad, from its middle outwards."""
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


class Held(msgspec.Struct, frozen=True):
    """A free object between the pads. sides (F,): +1 or -1, from which each presses it; radps: of
    its mass on all of them."""

    sides: Floats
    radps: float


class Fingertips:
    """One fingertip a surface, each with its own texture, tilt, rest codes and noise. What they
    touch is fixed, or all hold one object: then the hand shakes as one, the object follows with its
    inertia, and what friction adds by the fingers' levers balances on it.

    ``advance`` must be called in the order of time. Everything random comes from the generator, so
    equal seeds and equal call times give equal codes.
    """

    def __init__(
        self, settings: FingertipSettings, surfaces: Sequence[Surface], rng: np.random.Generator,
        held: Held | None = None,
    ) -> None:  # fmt: skip
        s, n = settings, len(surfaces)
        self._settings, self._rng, self._pads = s, rng, n
        self._held, self._shaken = held, n if held is None else 1
        self._at = spring_positions(s)
        self._taxels = taxel_positions(s)
        self._parameters = _parameters(s)
        self._disturbing = _disturbing(s, 0.0 if held is None else held.radps)
        fields = [height_field(surface, rng) for surface in surfaces]
        self._fields = np.stack([field for field, _ in fields])
        self._surfaces = np.array([
            (*x.curvature_per_mm, x.friction_static, x.friction_kinetic, step, field.max())
            for x, (field, step) in zip(surfaces, fields, strict=True)
        ])  # fmt: skip
        tilts = rng.normal((s.tilt_x_rad, s.tilt_y_rad), s.tilt_rad, (n, 2))
        crown = (self._at**2).sum(axis=1) / (2 * s.crown_radius_mm)
        gaps = crown + tilts @ self._at.T
        least = np.minimum.accumulate(gaps[:, ::-1], axis=1)[:, ::-1]
        self._gaps = np.stack([gaps, least], axis=1)
        angle = rng.uniform(0.0, 2 * math.pi, n)
        self._shaking = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        self.rest = rng.integers(REST_LOW, REST_HIGH, (n, len(self._taxels)), endpoint=True)
        self._states = np.zeros((n, bed.STATE))
        self._springs = np.zeros((n, bed.SPRING, len(self._at)))
        self._numbers = _Numbers(rng, (4 * self._shaken + 2 + n * len(self._taxels),))
        jitters = (self._shaken, pad_vibration.JITTERS, 2)
        jitter = rng.spawn(1)[0] if s.shift_mm > 0.0 or s.rock_rad > 0.0 else None
        self._jitter_numbers = _Numbers(jitter, jitters)
        self._t_s = 0.0
        self._disturbance = np.zeros((pad_vibration.DISTURBANCE, self._shaken))
        self._jitter = np.zeros(jitters)
        self._following = np.zeros((pad_vibration.WAYS, pad_vibration.FOLLOWING))
        self._totals, self._turn = np.zeros(n), np.zeros(n)
        self._rocked, self._motion, self._centre = (np.zeros((n, 2)) for _ in range(3))
        self._given = np.zeros(n)  # no mount: the load is what it is said to be
        self.slid = np.zeros((n, 3))  # sum of sliding, mm, mm and rad, where the load is
        self._noise = np.zeros((n, len(self._taxels)))
        self._pressed = np.zeros_like(self.rest)  # counts
        self._pressed_until_s = 0.0
        # columns of the state, as it stands
        self._stiffness = self._states[:, bed.STIFFNESS]
        self._pull = self._states[:, bed.PULL_X : bed.PULL_Y + 1]

    def advance(
        self, t_s: float, normal_n: Floats, motion_mm: Floats, turn_rad: Floats,
        centre_mm: Floats, arm_moves: bool, mount_npmm: Floats | None = None,
    ) -> None:  # fmt: skip
        """Bring all pads to t_s; everything given goes linearly from its last value to this one.

        normal_n (F,): load, 0 or less without contact. motion_mm (F, 2): integral of the velocity
        of the surface at the pad's middle, relative to the mount's base, in the pad's frame.
        turn_rad (F,): rotation of the surface about it. centre_mm (F, 2): where on the pad the
        widest point of a curved surface lies. arm_moves excites the arm's mode.

        With mount_npmm (F,), above 0, each pad hangs on a spring that is so stiff: then normal_n is
        its load if the pad's face were at the surface's mean plane (stiffness times how far the
        base has come beyond), and what the pad meets there and its friction decide the load. Not
        for pads that hold an object.
        """
        dt_s = t_s - self._t_s
        if dt_s <= 0.0:
            return
        row, n = self._numbers.draw(), self._pads
        self._noise = row[4 * self._shaken + 2 :].reshape(n, -1)
        mounts = self._given if mount_npmm is None else mount_npmm
        totals, motion, rocked = np.empty(n), np.empty((n, 2)), self._rocked
        shaker = (
            self._disturbing, dt_s, arm_moves, row, self._disturbance, self._jitter_numbers.draw(),
            self._jitter, normal_n,
        )  # fmt: skip
        if self._held is None:
            pad_vibration.shake(
                *shaker, mount_npmm is not None, mounts, self._stiffness, motion_mm,
                self._shaking, totals, motion, rocked,
            )  # fmt: skip
        else:
            pad_vibration.shake_held(
                *shaker, self._stiffness, self._pull, self._held.sides, self._following,
                motion_mm, self._shaking, totals, motion, rocked,
            )  # fmt: skip
        bed.advance(
            self._parameters, dt_s, self._totals, totals, mounts, motion - self._motion,
            turn_rad - self._turn, rocked, self._centre, centre_mm, self._surfaces, self._fields,
            self._at, self._gaps, self._states, self._springs,
        )  # fmt: skip
        self.slid = self.slid + dt_s * self._states[:, bed.SLIP_X : bed.SPIN + 1]
        self._t_s, self._totals, self._motion = t_s, totals, motion
        self._turn[:], self._centre[:] = turn_rad, centre_mm

    def press(self, pad: int, taxel: int, load_n: float, until_s: float) -> None:
        """A person's finger on the rubber over one taxel, until then or until the next press. Only
        the barometers feel it, as a point load: object and hand do not. Raises ValueError for a
        taxel that there is not."""
        if taxel >= len(self._taxels):
            raise ValueError(f"taxel {taxel}: from 0 to {len(self._taxels) - 1}")
        under = kernel(self._settings.depth_mm)
        far = ((self._taxels - self._taxels[taxel]) ** 2).sum(axis=1) / under.normal_width_mm**2
        self._pressed[:] = 0
        self._pressed[pad] = np.rint(load_n * under.normal_peak * np.exp(-0.5 * far))
        self._pressed_until_s = until_s

    def codes(self) -> tuple[Codes, Codes]:
        """Pressure and temperature codes (F, taxels) as of the last ``advance``."""
        s = self._settings
        rest = self.rest - self._pressed if self._t_s < self._pressed_until_s else self.rest
        pressure = np.empty(self.rest.shape, np.int16)
        warming = s.warming_k * -math.expm1(-self._t_s / s.warming_s)
        bed.read(
            self._parameters, self._states, self._springs, self._at, self._taxels, rest,
            PRESSURE_COUNTS_PER_K * warming, s.noise_counts, self._noise,
            CODE_MAX, FOLD if s.fold_above_512 else CODE_MAX, pressure,
        )  # fmt: skip
        temperature = np.empty(self.rest.shape, np.int16)
        temperature.fill(round(TEMPERATURE_CODE + TEMPERATURE_CODES_PER_K * warming))
        return pressure, temperature

    @property
    def load_n(self) -> Floats:
        """(F,) load that the springs carry."""
        return self._of_pads(bed.CARRIED)

    @property
    def approach_mm(self) -> Floats:
        """(F,) how far the pad's base has come towards the surface's mean plane: what it takes to
        carry the load on this spot. 0 or stale without contact."""
        return self._of_pads(bed.APPROACH)

    @property
    def sliding_share(self) -> Floats:
        """(F,) share of the load on springs that slide, at the end of the last step."""
        return self._of_pads(bed.SHARE)

    def _of_pads(self, column: int) -> Floats:
        out: Floats = self._states[:, column].copy()
        return out


class _Numbers:
    """Standard normal numbers in arrays of one shape; drawn in blocks, a tenth of the cost of
    singles. Without a generator they are zeros."""

    def __init__(self, rng: np.random.Generator | None, shape: tuple[int, ...]) -> None:
        self._rng, self._shape = rng, shape
        self._block, self._next = np.zeros((1, *shape)), 0 if rng is None else 1

    def draw(self) -> Floats:
        if self._rng is not None:
            if self._next >= len(self._block):
                self._block, self._next = self._rng.standard_normal((256, *self._shape)), 0
            self._next += 1
        out: Floats = self._block[self._next - 1]
        return out


def _parameters(s: FingertipSettings) -> Floats:
    cells = _cells(PAD_HALF_LENGTH_MM, s) * _cells(PAD_HALF_WIDTH_MM, s)
    stiffness = s.foundation_n_per_mm3 * 4 * PAD_HALF_LENGTH_MM * PAD_HALF_WIDTH_MM / cells
    out = np.empty(bed.PARAMETERS)
    out[:] = (
        stiffness, stiffness * SHEAR_SHARE, STEP_MM, STEP_S,
        *msgspec.structs.astuple(kernel(s.depth_mm)), s.lever_x, s.lever_y, s.lateral_npmm,
        2 * math.pi * s.lateral_hz, s.lateral_damping, PAD_HALF_LENGTH_MM, PAD_HALF_WIDTH_MM,
        s.relaxation_share, s.relaxation_slow_share, s.relaxation_slow_share,
        s.relaxation_s, 10.0 * s.relaxation_s, 100.0 * s.relaxation_s,
    )  # fmt: skip
    return out


def _disturbing(s: FingertipSettings, held_radps: float) -> Floats:
    return np.array([
        s.wander_mm, s.wander_fast_s, s.wander_slow_s, s.vibration_mm,
        2 * math.pi * s.vibration_hz, s.vibration_damping, s.sway_mm, s.lever_x, s.lever_y,
        s.shift_mm, s.rock_rad, s.jitter_s, held_radps, HELD_DAMPING,
    ])  # fmt: skip
