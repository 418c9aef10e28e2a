"""What a scene may add to a plain grasp: a pull on what is held, fingertips that have lost taxels
or gain. Off unless a trial asks for them."""

import math
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Codes = NDArray[np.int16]


class PullSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A downward force on the object once the arm stands still with it in the air."""

    force_n: Annotated[
        float, Meta(ge=0.0, le=200.0, description="downwards, beside the weight; 0: none")
    ] = 0.0
    after_s: Annotated[
        float, Meta(ge=0.0, le=60.0, description="the arm has stood in the air so long; assumed")
    ] = 0.2
    above_m: Annotated[
        float,
        Meta(
            ge=0.0, le=1.0,
            description="the object is so high then at least: off the table; more than an arm that "
            "pauses to answer slip has risen, where the top is meant",
        ),
    ] = 0.005  # fmt: skip
    ramp_s: Annotated[
        float, Meta(ge=0.001, le=10.0, description="from nothing to all, and back; assumed")
    ] = 0.1
    lasts_s: Annotated[
        float, Meta(ge=0.0, le=60.0, description="at its full strength; assumed")
    ] = 0.3


class Pull:
    """Tells when the pull of a trial begins; it does so once."""

    def __init__(self, settings: PullSettings, now_ns: int) -> None:
        self.settings = settings
        self._since_ns = now_ns
        self._over = settings.force_n == 0.0

    def begins(self, now_ns: int, height_m: float, rise_mps: float) -> bool:
        """Take how high the object is and how fast the arm rises now."""
        if self._over:
            return False
        if rise_mps != 0.0 or height_m < self.settings.above_m:
            self._since_ns = now_ns
        self._over = now_ns - self._since_ns >= self.settings.after_s * 1e9
        return self._over


class DamageSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is wrong with every fingertip from the beginning of a trial."""

    taxels_lost: Annotated[
        float,
        Meta(
            ge=0.0, le=1.0,
            description="share of each fingertip's taxels that say for ever what they said first; "
            "which, is drawn",
        ),
    ] = 0.0  # fmt: skip
    gain_lost: Annotated[
        float,
        Meta(
            ge=0.0, le=1.0,
            description="share of every change from rest that is not felt; the chips' own noise "
            "stays as it is",
        ),
    ] = 0.0  # fmt: skip


class Damage:
    """Changes what damaged fingertips read. Rest is taken for what they read first."""

    def __init__(
        self, settings: DamageSettings, noise_counts: float, rng: np.random.Generator
    ) -> None:
        self._settings = settings
        self._kept = 1.0 - settings.gain_lost
        self._noise_counts = noise_counts * math.sqrt(1.0 - self._kept**2)  # what scaling takes
        self._whole = settings == DamageSettings()
        self._rng = rng
        self._first: Codes | None = None
        self._lost: NDArray[np.bool_] | None = None

    def felt(self, codes: Codes) -> Codes:
        """Codes (F, T) as the damaged fingertips give them."""
        if self._whole:
            return codes
        if self._first is None or self._lost is None:
            self._first, self._lost = codes.copy(), self._draw(*codes.shape)
        noise = self._noise_counts * self._rng.standard_normal(codes.shape)
        out = np.rint(self._first + self._kept * (codes - self._first) + noise)
        return np.where(self._lost, self._first, out.astype(np.int16))

    def _draw(self, fingers: int, taxels: int) -> NDArray[np.bool_]:
        lost = np.arange(taxels) < round(self._settings.taxels_lost * taxels)
        return np.stack([self._rng.permutation(lost) for _ in range(fingers)])
