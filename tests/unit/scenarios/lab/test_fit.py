"""Calibrations from readings whose law and noise differ from the model's, with their stated
uncertainty; insufficient data are refused."""

import random
import tomllib

import msgspec
import pytest

from drivers.errors import UsageError
from drivers.robotiq.calibration import GripperCalibration
from scenarios.lab.calibrate import hand_file
from scenarios.lab.fit import (
    LEAST_OUTLIER_N,
    LEAST_READINGS,
    Reading,
    fit_counts,
    outlier_press,
    outlier_reading,
    press_statistics,
)
from scenarios.rigs.calibration import WEAK_PRESSES, check_weak_claim

WEIGHTS_N = (0.49, 0.98, 1.96, 2.94, 3.92, 4.9, 6.86, 9.81)


def pad(force_n: float, rng: random.Random, exponent: float = 0.95) -> float:
    """Counts of a pad with creep, hysteresis and a nonlinear law; noise proportional to force."""
    hysteresis = rng.choice((-1.0, 1.0)) * 0.02 * force_n
    return 143.0 * (force_n + hysteresis) ** exponent * rng.lognormvariate(0.0, 0.02)


def scale(force_n: float, rng: random.Random) -> float:
    """Reading of a kitchen scale: 5 g steps, gain error within half a per cent."""
    return round(force_n * (1 + rng.uniform(-0.005, 0.005)) / 0.049) * 0.049


def hand(rng: random.Random) -> float:
    """Force of a motor with friction: some presses are harder."""
    return 11.0 * (1 + rng.gammavariate(2.0, 0.015))


# Counts to newtons


def readings(seed: int, exponent: float = 0.95) -> list[Reading]:
    rng = random.Random(seed)
    return [Reading(scale(f, rng), pad(f, rng, exponent)) for f in WEIGHTS_N]


@pytest.mark.parametrize(
    ("taken", "problem"),
    [
        (readings(0)[:4], "too few"),
        ([Reading(5.0 + i / 10, 700.0) for i in range(8)], "too similar"),
        ([Reading(f, 100 * f**0.5) for f in WEIGHTS_N], "straight line"),
        ([Reading(f, -10.0) for f in WEIGHTS_N], "no counts"),
        ([Reading(f, 200.0 - 10 * f) for f in WEIGHTS_N], "do not increase"),
        ([Reading(f / 40, 3 * f) for f in WEIGHTS_N], "resolution of a kitchen scale"),
        (
            [Reading(f, c) for f, c in ((0.5, 60), (1, 90), (1.5, 170), (2, 180), (2.5, 270))],
            "uncertain by",
        ),
        ([Reading(f, 100 * (f + 0.8)) for f in WEIGHTS_N if f < 4], "through zero"),
    ],
)
def test_readings_without_a_valid_line_are_refused(taken: list[Reading], problem: str) -> None:
    with pytest.raises(UsageError, match=problem):
        fit_counts(taken)


@pytest.mark.parametrize("factor", [10.0, 0.5, 9.81])
def test_mistyped_weight_is_detected(factor: float) -> None:
    """An extra digit, a wrong weight, or a wrong unit, at any of the eight readings."""
    detected = 0
    for seed in range(40):
        taken = readings(seed)
        i = seed % len(taken)
        taken[i] = Reading(taken[i].force_n * factor, taken[i].measured)
        error_n = abs(taken[i].force_n * (1 - 1 / factor))
        detected += outlier_reading(taken) == i or error_n < LEAST_OUTLIER_N
    assert detected == 40


def test_correct_readings_are_not_outliers() -> None:
    for seed in range(200):
        few = random.Random(seed).sample(readings(seed), LEAST_READINGS)
        assert outlier_reading(few) is None
    for exponent in (0.8, 0.95, 1.0, 1.2):
        assert [s for s in range(200) if outlier_reading(readings(s, exponent)) is not None] == []


# Force byte 0 to newtons


def test_bound_is_above_the_mean_press() -> None:
    for seed in range(20):
        rng = random.Random(seed)
        assert press_statistics([hand(rng) for _ in range(10)]).bound_n >= 11.0 * 1.03


def test_force_below_the_manuals_needs_ten_presses() -> None:
    rng = random.Random(0)
    presses = [hand(rng) for _ in range(WEAK_PRESSES)]
    with pytest.raises(UsageError, match="less than the manual's 15"):
        press_statistics(presses[:9])
    assert press_statistics(presses).bound_n < 15.0
    strong = press_statistics([16.0, 16.2, 16.1, 16.3])  # above the manual's force
    assert strong.bound_n > 16.3


@pytest.mark.parametrize("least_n", [5.1, 12.0])
def test_calibration_file_of_a_weak_hand_is_accepted_by_a_run(least_n: float) -> None:
    known = press_statistics([least_n * (1 + 0.001 * i) for i in range(10)])
    table = tomllib.loads(hand_file("A", known))["calibration"]
    check_weak_claim(msgspec.convert({**table, "name": "weak"}, GripperCalibration))


def test_mistyped_press_is_detected() -> None:
    rng = random.Random(1)
    presses = [hand(rng) for _ in range(6)]
    assert outlier_press(presses) is None
    presses[3] /= 9.81
    assert outlier_press(presses) == 3
    with pytest.raises(UsageError, match="press 4"):
        press_statistics(presses)


def test_force_estimated_from_counts_is_within_the_stated_uncertainty() -> None:
    """Tested on other presses of the same pad within the calibrated range."""
    within = tried = 0
    for seed in range(200):
        line = fit_counts(readings(seed))
        rng = random.Random(1000 + seed)
        for _ in range(5):
            force_n = rng.uniform(line.least_n, line.most_n)
            tried += 1
            within += abs(pad(force_n, rng) / line.slope - force_n) <= 2 * line.worst_n
    assert within / tried > 0.95
