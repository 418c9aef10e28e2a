"""The simulated fingertip: kernels, the spring bed, and the codes during slip."""

import numpy as np
import pytest
from numpy.typing import NDArray

from scenarios.world import fingertip_laws as laws
from scenarios.world.fingertip import Fingertips, Floats
from scenarios.world.settings import FingertipSettings, Surface

QUIET = {
    "noise_counts": 0.0, "wander_mm": 0.0, "vibration_mm": 0.0, "sway_mm": 0.0,
    "warming_k": 0.0, "tilt_rad": 0.0, "shift_mm": 0.0, "rock_rad": 0.0, "lateral_npmm": 0.0,
}  # fmt: skip
SMOOTH = Surface(texture_rms_mm=0.0)
ROUGH = Surface(texture_rms_mm=0.3)


def make(surface: Surface = ROUGH, seed: int = 1, **settings: float) -> Fingertips:
    merged = FingertipSettings(**settings)  # type: ignore[arg-type]
    return Fingertips(merged, [surface], np.random.default_rng(seed))


def move(
    tips: Fingertips, t_s: float, force_n: float, x_mm: float = 0.0, y_mm: float = 0.0,
    turn: float = 0.0, centre_mm: tuple[float, float] = (0.0, 0.0), arm_moves: bool = False,
) -> NDArray[np.int16]:  # fmt: skip
    """(6,) counts over rest."""
    tips.advance(
        t_s, np.array([force_n]), np.array([[x_mm, y_mm]]), np.array([turn]),
        np.array([centre_mm]), arm_moves,
    )  # fmt: skip
    return (tips.codes()[0] - tips.rest)[0].astype(np.int16)


def slide(tips: Fingertips, mm_per_sample: float, samples: int, force_n: float = 4.0) -> Floats:
    """(samples, 6) counts of a slide along x at 100 Hz, after 0.2 s of rest."""
    for k in range(20):
        move(tips, 0.01 * (k + 1), force_n)
    return np.array(
        [move(tips, 0.2 + 0.01 * k, force_n, mm_per_sample * k) for k in range(1, samples + 1)],
        dtype=np.float64,
    )


def loads(tips: Fingertips) -> Floats:
    return tips._springs[0, laws.LOAD]


def test_pressing_lowers_the_codes_from_rest() -> None:
    tips = make(SMOOTH, **QUIET)
    assert (move(tips, 0.01, 0.0) == 0).all()
    pressed = move(tips, 0.02, 3.0)
    assert (pressed <= 0).all()
    assert pressed.min() < -50


def test_exponential_of_the_codes_is_exact_to_ten_digits() -> None:
    x = np.linspace(laws.NEGLIGIBLE, 0.0, 1000)
    assert laws.fast_exp.py_func(x) == pytest.approx(np.exp(x), rel=1e-10)


def test_spring_loads_sum_to_the_normal_force() -> None:
    tips = make(**QUIET)
    for k, force in enumerate((0.02, 0.5, 10.0, 0.1)):
        move(tips, 0.01 * (k + 1), force, x_mm=1.7 * k, centre_mm=(2.0, 0.0))
        assert loads(tips).min() >= 0.0
        assert loads(tips).sum() == pytest.approx(force, rel=1e-9)


def test_signal_over_texture_is_stronger_in_motion_and_grows_with_speed() -> None:
    def mean_change(speed_mm_per_sample: float) -> float:
        quiet = {"wander_mm": 0.0}
        return float(np.abs(np.diff(slide(make(**quiet), speed_mm_per_sample, 80), axis=0)).mean())

    assert mean_change(0.0) < 1.5 < mean_change(0.3) < mean_change(0.6)


def test_patch_slides_from_its_rim_inwards() -> None:
    tips = make(SMOOTH, **QUIET)
    move(tips, 0.01, 4.0)
    shares = []
    for k in range(60):
        move(tips, 0.02 + 0.01 * k, 4.0, x_mm=0.02 * k)
        shares.append(float(tips.sliding_share[0]))
        slides, load = tips._springs[0, laws.SLIDES] > 0, loads(tips)
        if 0.1 < shares[-1] < 0.9:
            assert load[slides].max() < load[(load > 0) & ~slides].max()
    assert shares[0] == 0.0
    assert any(0.1 < s < 0.9 for s in shares)
    assert shares[-1] == pytest.approx(1.0)


def test_equal_seeds_give_equal_codes_and_other_seeds_do_not() -> None:
    first, again, other = (slide(make(seed=seed), 0.3, 300) for seed in (5, 5, 6))
    assert (first == again).all()
    assert (first != other).any()
