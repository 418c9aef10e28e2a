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
    """A pad whose inputs to the fingertip model are recorded."""

    def __init__(self, press: PressSettings = MOUNTED, **surface: float) -> None:
        made = FixedSurface(name="test", **surface)
        self.pad = PressedPad(made, press, QUIET, np.random.default_rng(0), START, 0.0)
        self.inputs: list[tuple[np.ndarray, ...]] = []
        self.pad.tips.advance = self._record  # type: ignore[method-assign]
        self.t_s = 0.0

    def _record(self, t_s, beyond_n, motion_mm, turn_rad, centre_mm, moves, mount):  # type: ignore[no-untyped-def]
        self.inputs.append((beyond_n, motion_mm, turn_rad, centre_mm, mount))

    def go(self, x: float = 0.0, y: float = 0.0, down: float = 0.006, angle: float = 0.0) -> float:
        """Load of the mount, N, with the pad's face at the surface's mean plane."""
        self.t_s += 0.01
        at = (START[0] + x, START[1] + y, START[2] - down)
        self.pad.advance(self.t_s, at, angle, moving=True)
        return float(self.inputs[-1][0][0])

    @property
    def motion_mm(self) -> np.ndarray:
        return self.inputs[-1][1][0]


def press_down(
    surface: FixedSurface, down_m: float, x_m: float = 0.0, **settings: float
) -> PressedPad:
    """Pad pressed down_m beyond the apex, x_m beside it, at rest."""
    merged = FingertipSettings(**{**STILL, **settings})  # type: ignore[arg-type]
    pad = PressedPad(surface, MOUNTED, merged, np.random.default_rng(0), START, 0.0)
    for k in range(1, 101):
        z = START[2] - GAP_M - down_m * min(1.0, k / 50)
        pad.advance(0.01 * k, (START[0] + x_m, START[1], z), 0.0, moving=False)
    return pad


SMOOTH = FixedSurface(name="plane", texture_rms_m=0.0)


def test_load_is_that_of_mount_and_pad_in_series() -> None:
    pad = press_down(SMOOTH, 0.001)
    approach_mm = pad.tips.approach_mm[0]
    assert 0.2 < approach_mm < 0.9
    assert pad.normal_n == pytest.approx(1e-3 * STIFFNESS * (1.0 - approach_mm), rel=1e-6)


def test_knock_delivers_its_impulse_and_no_motion() -> None:
    pressing = Pressing()
    load_before = pressing.go()
    pressing.pad.knock(0.02, 0.012)
    loads = []
    for _ in range(5):
        start = len(pressing.inputs)
        pressing.go()
        loads += [normal[0] - load_before for normal, *_ in pressing.inputs[start:]]
    assert sum(loads) * 0.001 == pytest.approx(0.02, rel=0.05)
    assert loads[-1] == 0.0
    assert pressing.motion_mm == pytest.approx([0.0, 0.0])
