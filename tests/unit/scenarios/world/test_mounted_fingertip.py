"""A fingertip on its mount: friction that loads and unloads it, sway, rubber that relaxes."""

import math

import numpy as np
import pytest

from scenarios.world.fingertip import Fingertips, Floats, Held
from scenarios.world.fingertip_settings import FingertipSettings, Surface

STILL = {
    "noise_counts": 0.0, "wander_mm": 0.0, "vibration_mm": 0.0, "sway_mm": 0.0,
    "warming_k": 0.0, "tilt_rad": 0.0, "relaxation_share": 0.0, "crown_radius_mm": 40.0,
    "relaxation_slow_share": 0.0, "shift_mm": 0.0, "rock_rad": 0.0, "lever_x": 0.0,
    "lateral_npmm": 0.0,
}  # fmt: skip
MU = 0.7
SMOOTH = Surface(texture_rms_mm=0.0, friction_static=MU, friction_kinetic=MU)
ROUGH = Surface(texture_rms_mm=0.2, friction_static=MU, friction_kinetic=MU)
DEPTH_MM = 1.0


class Mounted:
    """One pad on a mount of so many N/mm, its base 1 mm beyond the surface's mean plane."""

    def __init__(self, surface: Surface = SMOOTH, mount_npmm: float = 4.0, **settings: float):
        merged = FingertipSettings(**{**STILL, **settings})  # type: ignore[arg-type]
        self.tips = Fingertips(merged, [surface], np.random.default_rng(3))
        self.mount = np.array([mount_npmm])
        self.t_s = 0.0
        self.at = np.zeros(2)

    def go(self, dx_mm: float = 0.0, dy_mm: float = 0.0, dt_s: float = 0.01) -> float:
        """The load after the surface has gone so far."""
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
def test_load_follows_the_stroke_as_that_of_a_drum_brakes_shoes(lever: float) -> None:
    """A mount that is soft beside the pad: N = N0 / (1 +- lever mu)."""
    pad = Mounted(mount_npmm=0.8, foundation_n_per_mm3=1.0, lever_x=lever)
    pad.go()
    down, up = pad.slide(0.3), pad.slide(-0.3)
    assert up / down == pytest.approx((1 + lever * MU) / (1 - lever * MU), rel=0.15)
    standing = pad.go()
    assert standing == pytest.approx(up, rel=0.1)  # friction keeps it while it stands


@pytest.mark.parametrize(("npmm", "hz"), [(0.001, 40.0), (3.0, 8.0)])
def test_a_swinging_mount_comes_to_rest_however_soft_it_is(npmm: float, hz: float) -> None:
    pad = Mounted(ROUGH, lateral_npmm=npmm, lateral_hz=hz, foundation_n_per_mm3=1.0)
    pad.go()
    pad.slide(0.3, 30)
    for _ in range(150):
        pad.go()
    assert pad.tips.slip_mps[0] < 1e-6
    assert abs(pad.tips.slid[0, :2]).max() < 10.0  # of 9 mm that the surface went


@pytest.mark.parametrize(("share", "lost"), [(0.05, 0.076), (0.10, 0.153)])
def test_at_constant_depth_rubber_relaxes_in_log_time(share: float, lost: float) -> None:
    """Real barometers in elastomer lose 7.8 % (plain) to 16.6 % (degassed) from 0.2 to 7 s."""
    pad = Mounted(
        mount_npmm=1e4, relaxation_share=share, relaxation_slow_share=share, relaxation_s=0.1
    )
    loads = [pad.go() for _ in range(700)]
    assert 1.0 - loads[699] / loads[19] == pytest.approx(lost, rel=0.15)
    decades = [loads[9] - loads[69], loads[69] - loads[499]]
    assert 0.5 < decades[1] / decades[0] < 2.0


SIDES, GRIP_N = np.array([1.0, -1.0, -1.0]), np.array([4.0, 2.0, 2.0])


def held_loads(lever: float, pull_mm: float) -> Floats:
    """(3,) loads of pads that hold an object with 4, 2 and 2 N, pulled along x."""
    settings = FingertipSettings(**{**STILL, "lever_x": lever})  # type: ignore[arg-type]
    tips = Fingertips(settings, [SMOOTH] * 3, np.random.default_rng(3), Held(SIDES, 120.0))
    still, middle = np.zeros(3), np.zeros((3, 2))
    for k in range(60):
        motion = np.tile([pull_mm * k / 60, 0.0], (3, 1))
        tips.advance(0.01 * (k + 1), GRIP_N, motion, still, middle, False)
    return tips.load_n


def test_weight_that_hangs_on_held_pads_loads_or_unloads_them_alike_by_its_direction() -> None:
    still, up, down = (held_loads(0.5, pull) for pull in (0.0, 3.0, -3.0))
    assert still == pytest.approx(GRIP_N)
    assert (up < 0.8 * still).all()
    assert (down > 1.2 * still).all()
    for loads in (up, down):
        assert SIDES @ loads == pytest.approx(0.0, abs=0.05)
    assert held_loads(0.0, 3.0) == pytest.approx(still)


HELD_HZ, DAMPING, PERIOD_S = 20.0, 0.2, 0.01


def restless_loads(held: Held | None, **settings: float) -> Floats:
    """(n, 3) loads of pads that hold with 4, 2 and 2 N, while nothing but the hand is restless."""
    merged = FingertipSettings(**{**STILL, "wander_mm": 0.004, **settings})  # type: ignore[arg-type]
    tips = Fingertips(merged, [SMOOTH] * 3, np.random.default_rng(5), held)
    still, middle, out = np.zeros(3), np.zeros((3, 2)), []
    for k in range(1500):
        tips.advance(PERIOD_S * (k + 1), GRIP_N, middle, still, middle, False)
        out.append(tips.load_n)
    return np.array(out)


def test_a_hand_that_shakes_loads_one_side_as_it_unloads_the_other() -> None:
    change = restless_loads(Held(SIDES, 2 * math.pi * HELD_HZ)) - GRIP_N
    assert np.corrcoef(change[:, 0], change[:, 1])[0, 1] < -0.95
    assert np.corrcoef(change[:, 1], change[:, 2])[0, 1] > 0.95
