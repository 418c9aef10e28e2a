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
    law_of,
    odd_one,
    odd_press,
    of_byte,
)
from scenarios.rigs.calibration import FAR, MANUAL, WEAK_PRESSES, check_claim

WEIGHTS_N = (0.49, 0.98, 1.96, 2.94, 3.92, 4.9, 6.86, 9.81)


def pad(force_n: float, rng: random.Random, exponent: float = 0.95) -> float:
    """Counts of a pad that creeps, sticks and bends: no straight line, no even noise."""
    hysteresis = rng.choice((-1.0, 1.0)) * 0.02 * force_n
    return 143.0 * (force_n + hysteresis) ** exponent * rng.lognormvariate(0.0, 0.02)


def scale(force_n: float, rng: random.Random) -> float:
    """What a kitchen scale shows: 5 g steps, a gain of its own within half a per cent."""
    return round(force_n * (1 + rng.uniform(-0.005, 0.005)) / 0.049) * 0.049


def hand(byte: int, rng: random.Random, bend: float = 0.6) -> float:
    """A motor with friction: a law of its own, and now and then a harder press."""
    law = 11.0 + 52.0 * (byte / 255) ** bend
    return law * (1 + rng.gammavariate(2.0, 0.015))


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


# Bytes to newtons


@pytest.mark.parametrize("bend", [0.5, 1.0, 1.6])
@pytest.mark.parametrize("bytes_", [(0,), (0, 64, 128, 255)])
def test_law_is_above_the_mean_press_of_every_byte_pressed_or_not(
    bend: float, bytes_: tuple[int, ...]
) -> None:
    for seed in range(20):
        rng = random.Random(seed)
        law = law_of([of_byte(b, [hand(b, rng, bend) for _ in range(10)]) for b in bytes_])
        for byte in range(256):
            mean_n = (11.0 + 52.0 * (byte / 255) ** bend) * 1.03
            if 255 not in bytes_ or byte in bytes_ or bend == 1.0:
                assert law.force_n(byte) >= mean_n, (seed, byte)


def test_byte_weaker_than_the_manual_s_needs_ten_presses() -> None:
    rng = random.Random(0)
    presses = [hand(0, rng) for _ in range(WEAK_PRESSES)]
    with pytest.raises(UsageError, match="less than the manual's 15"):
        of_byte(0, presses[:9])
    assert of_byte(0, presses).bound_n < 15.0
    strong = of_byte(0, [16.0, 16.2, 16.1, 16.3])  # as strong as the manual says
    assert strong.bound_n > 16.3


@pytest.mark.parametrize("bend", [0.5, 2.5])
@pytest.mark.parametrize("bytes_", [(0,), (0, 100), (0, 255)])
def test_file_of_a_hand_however_weak_is_one_that_a_run_takes(
    bend: float, bytes_: tuple[int, ...]
) -> None:
    """Beyond the bytes that were pressed no less is believed than what needs no presses."""
    for least_n, most_n in ((1.2, 15.0), (3.0, 16.0), (4.9, 30.0), (12.0, 58.0)):
        forces_n = {b: least_n + (most_n - least_n) * (b / 255) ** bend for b in bytes_}
        known = [of_byte(b, [n * (1 + 0.001 * i) for i in range(10)]) for b, n in forces_n.items()]
        far = {b: "a hand with weak springs" for b, n in forces_n.items()
               if n < MANUAL.force_n(b) / FAR}  # fmt: skip
        text = hand_file("A", known, law_of(known), far)
        table = tomllib.loads(text)["calibration"]
        check_claim(msgspec.convert({**table, "name": "own"}, GripperCalibration))


def test_mistyped_press_is_named() -> None:
    rng = random.Random(1)
    presses = [hand(0, rng) for _ in range(6)]
    assert odd_press(presses) is None
    presses[3] /= 9.81
    assert odd_press(presses) == 3
    with pytest.raises(UsageError, match="press 4"):
        of_byte(0, presses)


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
