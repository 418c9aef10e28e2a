"""Simulated recordings like the authors' clip: one fingertip slid there and back over a fixed
surface, stroke by stroke, under an arm that holds its force by a slow loop."""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import PERIOD_S
from scenarios.world.fingertip import Fingertips
from scenarios.world.settings import GROSS_SLIP_MPS, FingertipSettings, Surface

ZEROING = 20  # samples
SETTLED = 50  # samples at rest before the first one that counts
Floats = NDArray[np.float64]


class StrokeSettings(msgspec.Struct, frozen=True):
    """What arm and surface did while the clip was recorded. Where FITTED these are nuisances of
    the calibration: the clip does not say how fast it slid, how hard, or on what."""

    strokes: int = 4  # there and back; the clip's
    stroke_s: float = 0.6  # of motion above 3 mm/s; the clip's mean
    pause_s: float = 0.25  # between strokes; the clip's mean
    rest_s: float = 0.9  # after the last; the clip's
    peak_mps: float = 0.0599  # fastest; FITTED, 0.015-0.08
    skew: float = 2.49  # speed ~ s^2 (1 - s)^skew; FITTED, 1.2-5
    force_n: float = 1.99  # mean; FITTED, 1.2-8
    force_spread: float = 0.3  # between clips, relative; assumed
    zero_load_n: float = 1.29  # on the pad while it was zeroed; FITTED, 0-6
    arm_npmm: float = 5.0  # arm and mount, along the press; assumed, 3-10
    # corner of the arm's force loop; assumed: the clip's load recovers at less than 0.4 /s
    force_loop_radps: float = 0.2
    texture_rms_mm: float = 0.444  # FITTED, 0.1-0.6
    texture_length_mm: float = 1.14  # FITTED, 1-3
    friction: float = 0.737  # kinetic; FITTED, 0.4-1.2
    static_share: float = 1.2  # static over kinetic; assumed, 1.1-1.5


class Clips(msgspec.Struct, frozen=True):
    """Recordings of equal motion: (n,) times and labels; (clips, n, taxels) counts over rest."""

    t_s: Floats
    slip: NDArray[np.bool_]
    counts: NDArray[np.int16]
    force_n: Floats  # (clips, n) true normal load on the pads


def stroke_speeds(settings: StrokeSettings) -> tuple[Floats, Floats]:
    """Times and speed of the fingertip in m/s (n,), from the first sample that counts."""
    s = settings
    part = np.linspace(0.0, 1.0, 501)
    bell = part**2 * (1 - part) ** s.skew
    bell /= bell.max()
    whole_s = s.stroke_s / (bell * s.peak_mps > GROSS_SLIP_MPS).mean()
    period_s = max(s.stroke_s + s.pause_s, whole_s + PERIOD_S)
    n = round((s.pause_s + s.strokes * period_s + s.rest_s) / PERIOD_S)
    t = np.arange(n) * PERIOD_S
    stroke = np.floor((t - s.pause_s) / period_s)
    phase = (t - s.pause_s - stroke * period_s) / whole_s
    speed = s.peak_mps * np.interp(phase, part, bell)
    speed[(stroke < 0) | (stroke >= s.strokes) | (phase >= 1.0)] = 0.0
    return t, np.where(stroke % 2 == 0, speed, -speed)


class Press:
    """Arm and mount pressing several fingertips, each by itself: a spring whose base a slow loop
    moves until the load is right. Within a stroke it is stiff: what lifts the pad loads it."""

    def __init__(self, settings: StrokeSettings, target_n: Floats, slope: Floats) -> None:
        self._settings, self._target, self._slope = settings, target_n, slope
        self._base_mm = np.zeros(len(target_n))
        self.mount_npmm = np.full(len(target_n), settings.arm_npmm)

    def begin(self, approach_mm: Floats) -> None:
        """Take up the pads' position as that of the wanted load."""
        self._base_mm = self._target / self._settings.arm_npmm + approach_mm

    def step(self, load_n: Floats, x_mm: float) -> Floats:
        """One period: the load (clips,) that the mount has at approach zero, the surface sloping;
        from the load that the pads have."""
        s = self._settings
        self._base_mm += s.force_loop_radps * (self._target - load_n) / s.arm_npmm * PERIOD_S
        out: Floats = s.arm_npmm * (self._base_mm - self._slope * x_mm)
        return out


def simulate(
    fingertip: FingertipSettings, settings: StrokeSettings, clips: int, seed: int
) -> Clips:
    """As many clips as asked for, each with its own surface, tilt, direction, force and rest."""
    rng = np.random.default_rng(seed)
    s = settings
    surface = Surface(
        texture_rms_mm=s.texture_rms_mm, texture_length_mm=s.texture_length_mm,
        friction_static=s.static_share * s.friction, friction_kinetic=s.friction,
    )  # fmt: skip
    angle = rng.uniform(0.0, 2 * math.pi, clips)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    target = s.force_n * np.exp(s.force_spread * rng.standard_normal(clips))
    press = Press(s, target, rng.normal(0.0, fingertip.tilt_rad, clips))
    tips = Fingertips(fingertip, [surface] * clips, rng)
    t, speed = stroke_speeds(s)
    x = np.concatenate([np.zeros(SETTLED), np.cumsum(speed) * PERIOD_S * 1e3])
    still, middle = np.zeros(clips), np.zeros((clips, 2))
    counts = np.empty((clips, len(t), tips.rest.shape[1]), np.int16)
    force = np.empty((clips, len(t)))
    zero = _zero(tips, np.full(clips, s.zero_load_n), still, middle)
    tips.advance((ZEROING + 1) * PERIOD_S, target, middle, still, middle, True)
    press.begin(tips.approach_mm)
    for k in range(1, len(x)):
        # its force loop never lets the arm rest
        beyond = press.step(tips.load_n, x[k])
        t_s = (ZEROING + k + 1) * PERIOD_S
        tips.advance(t_s, beyond, x[k] * along, still, middle, True, press.mount_npmm)
        if k >= SETTLED:
            counts[:, k - SETTLED] = tips.codes()[0] - zero
            force[:, k - SETTLED] = tips.load_n
    return Clips(t, np.abs(speed) > GROSS_SLIP_MPS, counts, force)


def _zero(tips: Fingertips, load_n: Floats, still: Floats, middle: Floats) -> NDArray[np.int16]:
    """Codes (clips, taxels) that pass for rest, though a load may have lain on the pads."""
    for k in range(ZEROING):
        tips.advance((k + 1) * PERIOD_S, load_n, middle, still, middle, False)
    return tips.codes()[0]
