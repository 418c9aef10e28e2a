"""The simulated fingertip: kernels, the spring bed, and what a slip does to the codes."""

import numpy as np
import pytest
from numpy.typing import NDArray

from scenarios.world import fingertip
from scenarios.world.fingertip import Fingertips, FingertipSettings
from tests.unit.world.test_contact import body

ZERO = np.zeros(3)
QUIET = {"noise_counts": 0.0, "wander_n": 0.0, "vibration_n": 0.0, "drift_k_per_s": 0.0}


def make(seed: int = 1, **settings: float) -> Fingertips:
    merged = FingertipSettings(**settings)  # type: ignore[arg-type]
    return Fingertips(merged, body(), np.random.default_rng(seed))


def codes(
    tips: Fingertips, t_s: float, force_n: float, slip_mm: float = 0.0, shear_n: float = 0.0
) -> NDArray[np.int16]:
    normal = np.array([force_n, force_n / 2, force_n / 2])
    shear = np.array([shear_n, 0.0, 0.0])
    pressure, _ = tips.sample(t_s, normal, shear, slip_mm, ZERO, 0.0, False)
    return pressure


def test_pressing_lowers_the_codes_from_rest() -> None:
    tips = make(**QUIET)
    assert (codes(tips, 0.01, 0.0) == tips.rest).all()
    pressed = codes(tips, 0.02, 3.0) - tips.rest
    assert (pressed <= 0).all()
    assert pressed.min() < -50


def test_kernels_at_ten_millimetres_match_the_exact_layer_solution() -> None:
    # Exact Hankel solution for a patch of 4 mm: 4.32, 3.32, 1.56, 0.48 kPa/N at 0, 4, 8, 12 mm.
    r = np.array([0.0, 4.0, 8.0, 12.0])
    assert fingertip.normal_kernel(r, 10.0) == pytest.approx([4.32, 3.32, 1.56, 0.48], abs=0.1)
    r = np.array([0.0, 2.0, 6.0, 10.0])
    assert fingertip.shear_kernel(r, 10.0) == pytest.approx([0.0, 0.71, 1.38, 1.08], abs=0.15)


def test_shear_raises_one_side_and_lowers_the_other() -> None:
    tips = make(**QUIET, centre_spread_mm=0.0)
    before = codes(tips, 0.01, 4.0)
    difference = codes(tips, 0.02, 4.0, shear_n=3.0) - before
    columns = difference[0, :3] + difference[0, 5:2:-1]
    assert columns[2] < 0 < columns[0]  # traction along +x presses what lies ahead


def test_spring_loads_sum_to_the_normal_force() -> None:
    pad = fingertip.Pad(FingertipSettings())
    field = fingertip.height_field(body(texture_rms_m=3e-4), np.random.default_rng(3))
    loads = np.empty(len(pad.along_mm))
    for force in (0.02, 0.5, 10.0):
        fingertip.spring_loads(
            force,
            17.3,
            2.0,
            0.016,
            pad.along_mm,
            pad.row,
            pad.gap_mm,
            pad.spring_npmm,
            field,
            loads,
        )
        assert loads.min() >= 0.0
        assert loads.sum() == pytest.approx(force, rel=1e-9)


def test_hard_press_saturates_at_code_zero() -> None:
    assert codes(make(**QUIET), 0.01, 30.0).min() == 0


def test_sliding_over_texture_is_louder_than_resting_and_grows_with_speed() -> None:
    def loudness(speed_mm_per_sample: float) -> float:
        tips = make()
        seen = np.array(
            [codes(tips, 0.01 * k, 4.0, slip_mm=speed_mm_per_sample * k) for k in range(1, 80)]
        )
        return float(np.abs(np.diff(seen[:, 0].astype(float), axis=0)).mean())

    assert loudness(0.0) < 1.5 < loudness(0.5) < loudness(1.0)


def test_pad_that_sticks_hears_its_load_move_but_no_new_texture() -> None:
    tips = make(**QUIET, centre_spread_mm=0.0)
    normal = np.array([3.0, 1.5, 1.5])
    at_rest, _ = tips.sample(0.01, normal, ZERO, 0.0, ZERO, 0.0, False)
    stretched, _ = tips.sample(0.02, normal, ZERO, 0.4, np.full(3, 0.4), 0.0, False)
    change = (stretched - at_rest)[0]
    assert change[[0, 5]].sum() < 0 < change[[2, 3]].sum()  # the load has moved towards -x
    smooth = Fingertips(
        FingertipSettings(**QUIET, centre_spread_mm=0.0), body(texture_rms_m=0.0),
        np.random.default_rng(1),
    )  # fmt: skip
    still, _ = smooth.sample(0.01, normal, ZERO, 0.0, ZERO, 0.0, False)
    moved, _ = smooth.sample(0.02, normal, ZERO, 0.4, np.full(3, 0.4), 0.0, False)
    assert abs((moved - still - change)[0]).max() < 12  # texture decides how much, not whether


def test_contact_centre_of_a_ball_migrates_over_the_columns() -> None:
    ball = body(shape="ellipsoid", half_width_m=0.06, half_height_m=0.06, texture_rms_m=0.0)
    tips = Fingertips(
        FingertipSettings(**QUIET, centre_spread_mm=0.0), ball, np.random.default_rng(1)
    )
    normal = np.array([2.0, 1.0, 1.0])
    deepest = []
    for k, centre in enumerate((-7.0, 0.0, 7.0)):
        pressure, _ = tips.sample(0.01 * (k + 1), normal, ZERO, 0.0, ZERO, centre, False)
        fall = (tips.rest - pressure)[0]
        deepest.append(int(np.argmax(fall[:3] + fall[5:2:-1])))
    assert deepest == [0, 1, 2]


def test_equal_seeds_give_equal_codes_and_other_seeds_do_not() -> None:
    first, again, other = make(5), make(5), make(6)
    series = [[codes(tips, 0.01 * k, 2.0, 0.3 * k).tolist() for k in range(1, 300)]
              for tips in (first, again, other)]  # fmt: skip
    assert series[0] == series[1]
    assert series[0] != series[2]


def test_noise_floor_of_an_untouched_taxel_is_half_a_count() -> None:
    tips = make()
    seen = np.array([codes(tips, 0.01 * k, 0.0) for k in range(1, 400)]).astype(float)
    deviation = seen.std(axis=0)
    assert 0.25 < np.median(deviation) < 0.6
