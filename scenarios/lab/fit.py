"""From readings of a scale to figures with their spread: pure functions.

A reading that the others contradict is named, and data that do not support a figure are refused.
"""

import math
from collections.abc import Sequence
from statistics import fmean, median, stdev

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import UsageError
from scenarios.rigs.calibration import MANUAL, WEAK_PRESSES

ODD = 0.25  # a reading is odd that differs from what the others say by this share (assumed) ...
ODD_SIGMAS = 5.0  # ... by so many times their own spread ...
LEAST_ODD_N = 0.3  # ... and by more than a scale is read to; assumed
LEAST_POINTS = 5
SPAN = 3.0  # largest force over the least
MOST_BEND, LEAST_BEND_N = 0.15, 0.3  # by which counts may leave a straight line: share of range, N
LEAST_MOST_N = 0.5  # of the strongest reading: ten steps of a kitchen scale of 5 g; assumed
MOST_HALF = 0.25  # of the slope, by which it may be uncertain
WEIGHT = -1.5  # power of force: noise may be constant or grow with it
N_PER_G = 0.00980665
CREEP = 0.01  # of the slope: a loaded pad goes on to change, by its rubber; assumed
# Standard deviations of a sample above its mean below which 95 % of presses lie in 95 % of samples,
# by its size (the largest that is not above it), where presses scatter exponentially to the harder
# side: the longest tail of laws whose logarithm bends down (normal ones of ten need 2.9).
TOLERANCE = {
    4: 12.3, 5: 9.55, 6: 8.05, 8: 6.5, 10: 5.65, 12: 5.12, 15: 4.6, 20: 4.09, 30: 3.56, 50: 3.11,
    100: 2.73,
}  # fmt: skip
LEAST_SPREAD = 0.01  # no press repeats better than this; assumed
LEAST_PRESSES = 4

AGAIN = "look at what was typed, then take the readings again"


class Point(msgspec.Struct, frozen=True):
    """A reading of the scale and the counts measured with it."""

    force_n: float
    measured: float


class Line(msgspec.Struct, frozen=True):
    """Counts a newton with the 95 % interval, the worst distance of a point from it (N), and the
    range. ``offset_n``: by which the scale misses zero."""

    slope: float
    interval: tuple[float, float]
    worst_n: float
    least_n: float
    most_n: float
    points: int
    offset_n: float


class Presses(msgspec.Struct, frozen=True):
    """Presses of force byte 0: how many, mean, spread as measured and as used, and what 95 % of
    presses stay below with 95 % confidence."""

    count: int
    mean_n: float
    measured_spread_n: float
    spread_n: float
    bound_n: float


# Counts to newtons


def odd_one(points: Sequence[Point]) -> int | None:
    """Which reading the others contradict, by a power law through them: that without which they
    agree best. None: none."""
    if len(points) < LEAST_POINTS or any(p.force_n <= 0.0 or p.measured <= 0.0 for p in points):
        return None
    x = np.log([p.measured for p in points])
    y = np.log([p.force_n for p in points])

    def misses(i: int) -> tuple[float, NDArray[np.float64]]:
        """Of one reading and of the others, from the law through the others."""
        away = y - np.polyval(_line(np.delete(x, i), np.delete(y, i)), x)
        return float(away[i]), np.delete(away, i)

    odd = min(range(len(points)), key=lambda i: float((misses(i)[1] ** 2).sum()))
    miss, others = misses(odd)
    away_n = abs(points[odd].force_n - math.exp(y[odd] - miss))
    contradicted = abs(miss) > max(math.log1p(ODD), ODD_SIGMAS * _spread(others.tolist()))
    return odd if contradicted and away_n > LEAST_ODD_N else None


def fit_counts(points: Sequence[Point]) -> Line:
    """Counts a newton: the slope of a line that need not meet zero, for a scale that was not tared
    and a pad that was not at rest only shift it.

    Raises UsageError for too few or too narrow data, for a reading that does not fit, where counts
    are no straight line of force that begins near zero, and for a slope that is not known to a
    quarter.
    """
    forces = [p.force_n for p in points]
    if len(points) < LEAST_POINTS:
        raise UsageError(f"{len(points)} readings are too few", f"take {LEAST_POINTS} or more")
    if min(forces) <= 0.0 or max(forces) < SPAN * min(forces):
        raise UsageError(
            f"forces from {min(forces):.2f} to {max(forces):.2f} N are too much alike",
            f"the largest should be {SPAN:g} times the least",
        )
    if min(p.measured for p in points) <= 0.0:
        raise UsageError("a reading has no counts", "press the pad of the finger that was named")
    if max(forces) < LEAST_MOST_N:
        raise UsageError(
            f"forces up to {max(forces):.2f} N are too near to what a kitchen scale resolves",
            f"load {LEAST_MOST_N:g} N or more",
        )
    offset, slope = _weighed(points)
    if slope <= 0.0:
        raise UsageError("the counts do not rise with force", AGAIN)
    worst_n = max(abs(p.measured / slope - p.force_n) for p in points)
    if worst_n > max(LEAST_BEND_N, MOST_BEND * max(forces)):
        raise UsageError(
            f"the counts are no straight line of force through zero: up to {worst_n:.2f} N from it",
            "tare the scale, begin with nothing on the pad; else take readings up to a smaller "
            "force, --up-to",
        )
    half = _half(points)
    if half > MOST_HALF * slope:
        raise UsageError(
            f"{slope:.1f} counts a newton are uncertain by {half:.1f}, more than {MOST_HALF:.0%}",
            "take more readings, weak ones and strong ones",
        )
    half += CREEP * slope
    return Line(
        slope, (slope - half, slope + half), worst_n, min(forces), max(forces), len(points),
        offset / slope,
    )  # fmt: skip


def _half(points: Sequence[Point]) -> float:
    """Half of the 95 % interval of the slope, by leaving out each point in turn (jackknife): that
    needs no law of the noise."""
    count = len(points)
    slopes = [_weighed([*points[:i], *points[i + 1 :]])[1] for i in range(count)]
    spread = math.sqrt((count - 1) / count * sum((s - fmean(slopes)) ** 2 for s in slopes))
    freedom = count - 2
    student = 1.960 + 2.372 / freedom + 2.823 / freedom**2 + 2.556 / freedom**3  # 97.5 %, Fisher
    return student * spread


def _weighed(points: Sequence[Point]) -> tuple[float, float]:
    """Intercept and slope, neither ruled by the strongest readings."""
    forces = np.array([p.force_n for p in points])
    slope, offset = _line(forces, np.array([p.measured for p in points]), forces**WEIGHT)
    return offset, slope


# Force byte 0 to newtons


def odd_press(forces_n: Sequence[float]) -> int | None:
    """Which press the others contradict; None: none."""
    if len(forces_n) < LEAST_PRESSES:
        return None
    middle = median(forces_n)
    spread = _spread([f - middle for f in forces_n])
    worst = max(range(len(forces_n)), key=lambda i: abs(forces_n[i] - middle))
    away_n = abs(forces_n[worst] - middle)
    return worst if away_n > max(ODD * middle, ODD_SIGMAS * spread, LEAST_ODD_N) else None


def of_presses(forces_n: Sequence[float]) -> Presses:
    """Raises UsageError for too few, for one that does not fit, and for too few of a hand that
    would be weaker than the manual's."""
    count = len(forces_n)
    if count < LEAST_PRESSES:
        raise UsageError(f"{count} presses are too few", f"press {LEAST_PRESSES} times or more")
    if (odd := odd_press(forces_n)) is not None:
        told = f"press {odd + 1}: {forces_n[odd]:.2f} N contradicts the others"
        raise UsageError(told, AGAIN)
    mean, measured = fmean(forces_n), stdev(forces_n)
    spread = max(measured, LEAST_SPREAD * mean)
    sigmas = TOLERANCE[max(size for size in TOLERANCE if size <= count)]
    bound, manual_n = mean + sigmas * spread, MANUAL.least_force_n
    if bound < manual_n and count < WEAK_PRESSES:
        raise UsageError(
            f"byte 0 would be {bound:.1f} N, less than the manual's {manual_n:.3g}, by {count} "
            "presses alone", f"press {WEAK_PRESSES} times or more",
        )  # fmt: skip
    return Presses(count, mean, measured, spread, bound)


def _line(
    x: NDArray[np.float64], y: NDArray[np.float64], weights: NDArray[np.float64] | float = 1.0
) -> tuple[float, float]:
    """Slope and intercept, least squares; level where all x are the same."""
    mx, my = np.average(x, weights=weights + 0 * x), np.average(y, weights=weights + 0 * x)
    square = (weights * (x - mx) ** 2).sum()
    slope = float((weights * (x - mx) * (y - my)).sum() / square) if square else 0.0
    return slope, float(my - slope * mx)


def _spread(away: Sequence[float]) -> float:
    """A standard deviation that a wrong reading does not widen."""
    return 1.4826 * median(map(abs, away))
