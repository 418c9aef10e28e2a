"""A pad pressed on a fixed surface: load, geometry of the contact, frames."""

import numpy as np
import pytest

from scenarios.world.pressed_cell import GAP_M, PressedPad
from scenarios.world.settings import FingertipSettings, FixedSurface, PressSettings

START = (0.5, 0.1, 0.3)
QUIET = FingertipSettings(crown_radius_mm=100.0)
MOUNTED = PressSettings()
STIFFNESS = 1 / (1 / 5000 + 1 / 40000 + 1 / 1e6)
STILL: dict[str, float] = {
    "wander_mm": 0.0, "vibration_mm": 0.0, "sway_mm": 0.0, "tilt_rad": 0.0,
    "relaxation_share": 0.0, "noise_counts": 0.0, "warming_k": 0.0, "relaxation_slow_share": 0.0,
    "shift_mm": 0.0, "rock_rad": 0.0,
}  # fmt: skip


class Pressing:
    """A pad, and what it is told to feel."""

    def __init__(self, press: PressSettings = MOUNTED, **surface: float) -> None:
        made = FixedSurface(name="test", **surface)
        self.pad = PressedPad(made, press, QUIET, np.random.default_rng(0), START, 0.0)
        self.felt: list[tuple[np.ndarray, ...]] = []
        self.pad.tips.advance = self._feel  # type: ignore[method-assign]
        self.t_s = 0.0

    def _feel(self, t_s, beyond_n, motion_mm, turn_rad, centre_mm, moves, mount):  # type: ignore[no-untyped-def]
        self.felt.append((beyond_n, motion_mm, turn_rad, centre_mm, mount))

    def go(self, x: float = 0.0, y: float = 0.0, down: float = 0.006, angle: float = 0.0) -> float:
        """The load, N, that the mount would have if the pad's face did not meet anything."""
        self.t_s += 0.01
        at = (START[0] + x, START[1] + y, START[2] - down)
        self.pad.advance(self.t_s, at, angle, moving=True)
        return float(self.felt[-1][0][0])

    @property
    def motion_mm(self) -> np.ndarray:
        return self.felt[-1][1][0]

    @property
    def centre_mm(self) -> np.ndarray:
        return self.felt[-1][3][0]


def press_down(
    surface: FixedSurface, down_m: float, x_m: float = 0.0, **settings: float
) -> PressedPad:
    """A pad that has come down so far beyond the apex, x_m beside it, and rests there."""
    merged = FingertipSettings(**{**STILL, **settings})  # type: ignore[arg-type]
    pad = PressedPad(surface, MOUNTED, merged, np.random.default_rng(0), START, 0.0)
    for k in range(1, 101):
        z = START[2] - GAP_M - down_m * min(1.0, k / 50)
        pad.advance(0.01 * k, (START[0] + x_m, START[1], z), 0.0, moving=False)
    return pad


SMOOTH = FixedSurface(name="plane", texture_rms_m=0.0)


def test_load_is_what_mount_and_pad_in_series_give() -> None:
    pad = press_down(SMOOTH, 0.001)
    taken_mm = pad.tips.approach_mm[0]
    assert 0.2 < taken_mm < 0.9
    assert pad.normal_n == pytest.approx(1e-3 * STIFFNESS * (1.0 - taken_mm), rel=1e-6)


def test_a_knock_carries_its_impulse_and_moves_nothing() -> None:
    pressing = Pressing()
    still = pressing.go()
    pressing.pad.knock(0.02, 0.012)
    loads = []
    for _ in range(5):
        begun = len(pressing.felt)
        pressing.go()
        loads += [normal[0] - still for normal, *_ in pressing.felt[begun:]]
    assert sum(loads) * 0.001 == pytest.approx(0.02, rel=0.05)
    assert loads[-1] == 0.0
    assert pressing.motion_mm == pytest.approx([0.0, 0.0])
