"""A fingertip on its mount: load change by friction, and relaxation of the rubber."""

import numpy as np
import pytest

from scenarios.world.fingertip import Fingertips, Floats
from scenarios.world.settings import FingertipSettings, Surface

STILL = {
    "noise_counts": 0.0, "wander_mm": 0.0, "vibration_mm": 0.0, "sway_mm": 0.0,
    "warming_k": 0.0, "tilt_rad": 0.0, "relaxation_share": 0.0, "crown_radius_mm": 40.0,
    "relaxation_slow_share": 0.0, "shift_mm": 0.0, "rock_rad": 0.0, "lever_x": 0.0,
    "lateral_npmm": 0.0,
}  # fmt: skip
MU = 0.7
SMOOTH = Surface(texture_rms_mm=0.0, friction_static=MU, friction_kinetic=MU)
DEPTH_MM = 1.0


class Mounted:
    """Pad on a mount of stiffness mount_npmm, its base 1 mm beyond the surface's mean plane."""

    def __init__(self, surface: Surface = SMOOTH, mount_npmm: float = 4.0, **settings: float):
        merged = FingertipSettings(**{**STILL, **settings})  # type: ignore[arg-type]
        self.tips = Fingertips(merged, [surface], np.random.default_rng(3))
        self.mount = np.array([mount_npmm])
        self.t_s = 0.0
        self.at = np.zeros(2)

    def go(self, dx_mm: float = 0.0, dy_mm: float = 0.0, dt_s: float = 0.01) -> float:
        """Load, N, after the surface has moved by (dx_mm, dy_mm)."""
        self.t_s += dt_s
        self.at += (dx_mm, dy_mm)
        self.tips.advance(
            self.t_s, DEPTH_MM * self.mount, self.at[None, :].copy(), np.zeros(1),
            np.zeros((1, 2)), False, self.mount,
        )  # fmt: skip
        return float(self.tips.load_n[0])

    def slide(self, mm_per_sample: float, samples: int = 60) -> float:
        for _ in range(samples):
            load = self.go(mm_per_sample)
        return load

    def counts(self) -> Floats:
        out: Floats = (self.tips.codes()[0] - self.tips.rest)[0].astype(float)
        return out


@pytest.mark.parametrize("lever", [0.8])
def test_load_depends_on_the_stroke_direction_as_in_a_drum_brake(lever: float) -> None:
    """With a mount much softer than the pad, N = N0 / (1 +- lever mu)."""
    pad = Mounted(mount_npmm=0.8, foundation_n_per_mm3=1.0, lever_x=lever)
    pad.go()
    down, up = pad.slide(0.3), pad.slide(-0.3)
    assert up / down == pytest.approx((1 + lever * MU) / (1 - lever * MU), rel=0.15)
    at_rest = pad.go()
    assert at_rest == pytest.approx(up, rel=0.1)  # friction keeps the load at rest


@pytest.mark.parametrize(("share", "lost"), [(0.05, 0.076), (0.10, 0.153)])
def test_at_constant_depth_rubber_relaxes_in_log_time(share: float, lost: float) -> None:
    """Barometers in elastomer lose 7.8 % (plain) to 16.6 % (degassed) from 0.2 to 7 s."""
    pad = Mounted(
        mount_npmm=1e4, relaxation_share=share, relaxation_slow_share=share, relaxation_s=0.1
    )
    loads = [pad.go() for _ in range(700)]
    assert 1.0 - loads[699] / loads[19] == pytest.approx(lost, rel=0.15)
    decades = [loads[9] - loads[69], loads[69] - loads[499]]
    assert 0.5 < decades[1] / decades[0] < 2.0
