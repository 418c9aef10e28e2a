"""Calibrations recovered from scales whose law and noise are none of our model's, with the spread
that they state; and data that support nothing refused."""

import random
import tomllib

import msgspec
import pytest

from drivers.errors import UsageError
from drivers.robotiq.calibration import GripperCalibration
from scenarios.lab.calibrate import hand_file
from scenarios.lab.fit import (
    LEAST_ODD_N,
    LEAST_POINTS,
    Point,
    fit_counts,
    odd_one,
    odd_press,
    of_presses,
)
from scenarios.rigs.calibration import WEAK_PRESSES, check_weak_claim

WEIGHTS_N = (0.49, 0.98, 1.96, 2.94, 3.92, 4.9, 6.86, 9.81)


def pad(force_n: float, rng: random.Random, exponent: float = 0.95) -> float:
    """Counts of a pad that creeps, sticks and bends: no straight line, no even noise."""
    hysteresis = rng.choice((-1.0, 1.0)) * 0.02 * force_n
    return 143.0 * (force_n + hysteresis) ** exponent * rng.lognormvariate(0.0, 0.02)


def scale(force_n: float, rng: random.Random) -> float:
    """What a kitchen scale shows: 5 g steps, a gain of its own within half a per cent."""
    return round(force_n * (1 + rng.uniform(-0.005, 0.005)) / 0.049) * 0.049


def hand(rng: random.Random) -> float:
    """A motor with friction: now and then a harder press."""
    return 11.0 * (1 + rng.gammavariate(2.0, 0.015))


# Counts to newtons


def readings(seed: int, exponent: float = 0.95) -> list[Point]:
    rng = random.Random(seed)
    return [Point(scale(f, rng), pad(f, rng, exponent)) for f in WEIGHTS_N]


@pytest.mark.parametrize(
    ("points", "why"),
    [
        (readings(0)[:4], "too few"),
        ([Point(5.0 + i / 10, 700.0) for i in range(8)], "too much alike"),
        ([Point(f, 100 * f**0.5) for f in WEIGHTS_N], "no straight line"),
        ([Point(f, -10.0) for f in WEIGHTS_N], "no counts"),
        ([Point(f, 200.0 - 10 * f) for f in WEIGHTS_N], "do not rise"),
        ([Point(f / 40, 3 * f) for f in WEIGHTS_N], "a kitchen scale resolves"),
        (
            [Point(f, c) for f, c in ((0.5, 60), (1, 90), (1.5, 170), (2, 180), (2.5, 270))],
            "uncertain by",
        ),
        ([Point(f, 100 * (f + 0.8)) for f in WEIGHTS_N if f < 4], "through zero"),
    ],
)
def test_data_that_support_no_line_are_refused(points: list[Point], why: str) -> None:
    with pytest.raises(UsageError, match=why):
        fit_counts(points)


@pytest.mark.parametrize("slip", [10.0, 0.5, 9.81])
def test_mistyped_weight_is_named(slip: float) -> None:
    """A digit too many, a wrong unit, one for another; whichever it is of the eight."""
    caught = 0
    for seed in range(40):
        points = readings(seed)
        i = seed % len(points)
        points[i] = Point(points[i].force_n * slip, points[i].measured)
        by_n = abs(points[i].force_n * (1 - 1 / slip))
        caught += odd_one(points) == i or by_n < LEAST_ODD_N
    assert caught == 40


def test_readings_rightly_typed_are_not_doubted() -> None:
    for seed in range(200):
        few = random.Random(seed).sample(readings(seed), LEAST_POINTS)
        assert odd_one(few) is None
    for exponent in (0.8, 0.95, 1.0, 1.2):
        assert [s for s in range(200) if odd_one(readings(s, exponent)) is not None] == []


# Force byte 0 to newtons


def test_bound_is_above_the_mean_press() -> None:
    for seed in range(20):
        rng = random.Random(seed)
        assert of_presses([hand(rng) for _ in range(10)]).bound_n >= 11.0 * 1.03


def test_hand_weaker_than_the_manual_s_needs_ten_presses() -> None:
    rng = random.Random(0)
    presses = [hand(rng) for _ in range(WEAK_PRESSES)]
    with pytest.raises(UsageError, match="less than the manual's 15"):
        of_presses(presses[:9])
    assert of_presses(presses).bound_n < 15.0
    strong = of_presses([16.0, 16.2, 16.1, 16.3])  # as strong as the manual says
    assert strong.bound_n > 16.3


@pytest.mark.parametrize("least_n", [5.1, 12.0])
def test_file_of_a_hand_however_weak_is_one_that_a_run_takes(least_n: float) -> None:
    known = of_presses([least_n * (1 + 0.001 * i) for i in range(10)])
    table = tomllib.loads(hand_file("A", known))["calibration"]
    check_weak_claim(msgspec.convert({**table, "name": "own"}, GripperCalibration))


def test_mistyped_press_is_named() -> None:
    rng = random.Random(1)
    presses = [hand(rng) for _ in range(6)]
    assert odd_press(presses) is None
    presses[3] /= 9.81
    assert odd_press(presses) == 3
    with pytest.raises(UsageError, match="press 4"):
        of_presses(presses)


def test_force_told_by_counts_is_within_what_the_calibration_states() -> None:
    """Of other presses of the same pad, within its range."""
    within = tried = 0
    for seed in range(200):
        line = fit_counts(readings(seed))
        rng = random.Random(1000 + seed)
        for _ in range(5):
            force_n = rng.uniform(line.least_n, line.most_n)
            tried += 1
            within += abs(pad(force_n, rng) / line.slope - force_n) <= 2 * line.worst_n
    assert within / tried > 0.95
