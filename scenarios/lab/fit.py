"""Calibration figures with their uncertainty from readings of a scale: pure functions.

They name readings that contradict the others, and refuse insufficient data.
"""

import math
from collections.abc import Sequence
from statistics import fmean, median, stdev

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.errors import UsageError
from scenarios.rigs.calibration import MANUAL, WEAK_PRESSES

# A reading is an outlier if it differs from the prediction of the others by more than this share,
# this multiple of their standard deviation, and the resolution of a scale; assumed.
OUTLIER_SHARE, OUTLIER_SIGMAS, LEAST_OUTLIER_N = 0.25, 5.0, 0.3
LEAST_READINGS = 5
SPAN = 3.0  # required ratio of the largest force to the smallest
MOST_BEND, LEAST_BEND_N = 0.15, 0.3  # allowed distance from a straight line: share of range, N
LEAST_MOST_N = 0.5  # least force of the strongest reading: ten 5 g steps of a scale; assumed
MOST_HALF = 0.25  # allowed uncertainty of the slope, as a share
WEIGHT_POWER = -1.5  # of force: noise may be constant or proportional to force
N_PER_G = 0.00980665
CREEP = 0.01  # share of the slope by which rubber under load creeps; assumed
# Tolerance factors by sample size: mean plus factor times standard deviation bounds 95 % of presses
# with 95 % confidence, for exponentially distributed forces, the longest tail of a log-concave
# distribution (a normal one needs 2.9 for ten presses).
TOLERANCE = {
    4: 12.3, 5: 9.55, 6: 8.05, 8: 6.5, 10: 5.65, 12: 5.12, 15: 4.6, 20: 4.09, 30: 3.56, 50: 3.11,
    100: 2.73,
}  # fmt: skip
LEAST_SPREAD = 0.01  # least relative standard deviation of presses; assumed
LEAST_PRESSES = 4

CHECK_READINGS = "check the typed values, then repeat the readings"


class Reading(msgspec.Struct, frozen=True):
    """A reading of the scale and the counts measured with it."""

    force_n: float
    measured: float


class CountsFit(msgspec.Struct, frozen=True):
    """Counts per newton with the 95 % interval, the largest distance of a reading from the line
    (N), and the range. ``offset_n``: intercept, N."""

    slope: float
    interval: tuple[float, float]
    worst_n: float
    least_n: float
    most_n: float
    readings: int
    offset_n: float


class PressStatistics(msgspec.Struct, frozen=True):
    """Presses of force byte 0: number, mean, standard deviation as measured and as used, and the
    force below which 95 % of presses are, with 95 % confidence."""

    count: int
    mean_n: float
    measured_spread_n: float
    spread_n: float
    bound_n: float


# Counts to newtons


def outlier_reading(readings: Sequence[Reading]) -> int | None:
    """Index of the reading that contradicts a power law through the others: the one without which
    they agree best. None: no outlier."""
    few = len(readings) < LEAST_READINGS
    if few or any(r.force_n <= 0.0 or r.measured <= 0.0 for r in readings):
        return None
    x = np.log([r.measured for r in readings])
    y = np.log([r.force_n for r in readings])

    def residuals(i: int) -> tuple[float, NDArray[np.float64]]:
        """Residuals of one reading and of the others, from the law through the others."""
        deviations = y - np.polyval(_line(np.delete(x, i), np.delete(y, i)), x)
        return float(deviations[i]), np.delete(deviations, i)

    outlier = min(range(len(readings)), key=lambda i: float((residuals(i)[1] ** 2).sum()))
    residual, others = residuals(outlier)
    residual_n = abs(readings[outlier].force_n - math.exp(y[outlier] - residual))
    sigma = _robust_sigma(others.tolist())
    significant = abs(residual) > max(math.log1p(OUTLIER_SHARE), OUTLIER_SIGMAS * sigma)
    return outlier if significant and residual_n > LEAST_OUTLIER_N else None


def fit_counts(readings: Sequence[Reading]) -> CountsFit:
    """Counts per newton: the slope of a line with an intercept, because an offset of the scale or
    of the pad's rest codes only shifts it.

    Raises UsageError for too few or too similar forces, an invalid reading, counts that are not a
    straight line through about zero, and a slope with an uncertainty above a quarter.
    """
    forces = [p.force_n for p in readings]
    if len(readings) < LEAST_READINGS:
        raise UsageError(f"{len(readings)} readings are too few", f"take {LEAST_READINGS} or more")
    if min(forces) <= 0.0 or max(forces) < SPAN * min(forces):
        raise UsageError(
            f"forces from {min(forces):.2f} to {max(forces):.2f} N are too similar",
            f"the largest must be at least {SPAN:g} times the smallest",
        )
    if min(p.measured for p in readings) <= 0.0:
        raise UsageError("a reading has no counts", "load the pad of the named finger")
    if max(forces) < LEAST_MOST_N:
        raise UsageError(
            f"forces up to {max(forces):.2f} N are too close to the resolution of a kitchen scale",
            f"load {LEAST_MOST_N:g} N or more",
        )
    offset, slope = _weighted_line(readings)
    if slope <= 0.0:
        raise UsageError("the counts do not increase with force", CHECK_READINGS)
    worst_n = max(abs(p.measured / slope - p.force_n) for p in readings)
    if worst_n > max(LEAST_BEND_N, MOST_BEND * max(forces)):
        raise UsageError(
            f"the readings differ by up to {worst_n:.2f} N from a straight line through zero",
            "tare the scale and start with an unloaded pad, or limit the force by a smaller "
            "--up-to",
        )
    half_interval = _half_interval(readings)
    if half_interval > MOST_HALF * slope:
        raise UsageError(
            f"{slope:.1f} counts/N are uncertain by {half_interval:.1f}, more than {MOST_HALF:.0%}",
            "take more readings at small and large forces",
        )
    half_interval += CREEP * slope
    return CountsFit(
        slope, (slope - half_interval, slope + half_interval), worst_n, min(forces), max(forces),
        len(readings), offset / slope,
    )  # fmt: skip


def _half_interval(readings: Sequence[Reading]) -> float:
    """Half of the slope's 95 % interval by the jackknife, which assumes no distribution of the
    noise."""
    count = len(readings)
    slopes = [_weighted_line([*readings[:i], *readings[i + 1 :]])[1] for i in range(count)]
    spread = math.sqrt((count - 1) / count * sum((s - fmean(slopes)) ** 2 for s in slopes))
    freedom = count - 2
    student = 1.960 + 2.372 / freedom + 2.823 / freedom**2 + 2.556 / freedom**3  # 97.5 %, Fisher
    return student * spread


def _weighted_line(readings: Sequence[Reading]) -> tuple[float, float]:
    """Intercept and slope, weighted so that the strongest readings do not dominate."""
    forces = np.array([p.force_n for p in readings])
    slope, offset = _line(forces, np.array([p.measured for p in readings]), forces**WEIGHT_POWER)
    return offset, slope


# Force byte 0 to newtons


def outlier_press(forces_n: Sequence[float]) -> int | None:
    """Index of the press that contradicts the others; None: no outlier."""
    if len(forces_n) < LEAST_PRESSES:
        return None
    middle = median(forces_n)
    spread = _robust_sigma([f - middle for f in forces_n])
    worst = max(range(len(forces_n)), key=lambda i: abs(forces_n[i] - middle))
    allowed_n = max(OUTLIER_SHARE * middle, OUTLIER_SIGMAS * spread, LEAST_OUTLIER_N)
    return worst if abs(forces_n[worst] - middle) > allowed_n else None


def press_statistics(forces_n: Sequence[float]) -> PressStatistics:
    """Statistics of the presses. Raises UsageError for too few presses, for an outlier, and for too
    few of a hand weaker than the manual's."""
    count = len(forces_n)
    if count < LEAST_PRESSES:
        raise UsageError(f"{count} presses are too few", f"press {LEAST_PRESSES} times or more")
    if (outlier := outlier_press(forces_n)) is not None:
        problem = f"press {outlier + 1}: {forces_n[outlier]:.2f} N contradicts the others"
        raise UsageError(problem, CHECK_READINGS)
    mean, measured = fmean(forces_n), stdev(forces_n)
    spread = max(measured, LEAST_SPREAD * mean)
    sigmas = TOLERANCE[max(size for size in TOLERANCE if size <= count)]
    bound, manual_n = mean + sigmas * spread, MANUAL.least_force_n
    if bound < manual_n and count < WEAK_PRESSES:
        raise UsageError(
            f"byte 0 would be {bound:.1f} N, less than the manual's {manual_n:.3g} N, by only "
            f"{count} presses", f"press {WEAK_PRESSES} times or more",
        )  # fmt: skip
    return PressStatistics(count, mean, measured, spread, bound)


def _line(
    x: NDArray[np.float64], y: NDArray[np.float64], weights: NDArray[np.float64] | float = 1.0
) -> tuple[float, float]:
    """Slope and intercept by least squares; slope 0 if all x are equal."""
    mx, my = np.average(x, weights=weights + 0 * x), np.average(y, weights=weights + 0 * x)
    square = (weights * (x - mx) ** 2).sum()
    slope = float((weights * (x - mx) * (y - my)).sum() / square) if square else 0.0
    return slope, float(my - slope * mx)


def _robust_sigma(deviations: Sequence[float]) -> float:
    """Standard deviation from the median of the absolute deviations, robust to one wrong
    reading."""
    return 1.4826 * median(map(abs, deviations))
