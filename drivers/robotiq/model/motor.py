"""Motors of the hand between two register refreshes: the compiled inner loop, and the scissor axis.

Each finger: a speed reference with a lag, a stiff speed servo whose force is clamped by the motor
current, an inertia at the fingertip, a self-locking screw. Position is fingertip travel in metres
from the mechanical opening stop. The step grid is aligned to absolute time, so that one long call
and many short ones do the same arithmetic.
"""

from math import sqrt
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from drivers.robotiq.model.hand import HandSettings

SUBSTEP_NS: Final = 100_000
FINGERS: Final = 3

# Rows of the real state, one column a finger.
TRAVEL, VELOCITY, LAGGED, TARGET, SPEED, CLAMP, DRIVE = range(7)
REALS: Final = 7
# Rows of the integer state. DIRECTION 0: stopped. STALLED, AGE: substeps.
DIRECTION, DETECTION, STALLED, AGE = range(4)
INTEGERS: Final = 4
# Entries of the parameters.
MASS, GAIN, LAG, STALL_SPEED, OVERRIDE_N, OVERRIDE_STEPS, DEBOUNCE_STEPS, CLAMPED = range(8)

_STEP_S: Final = SUBSTEP_NS * 1e-9
_PUSHING: Final = 0.99  # share of the clamp from which the drive counts as saturated

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


def parameters(s: HandSettings) -> Reals:
    """Settings of the hand as the compiled loop takes them."""
    override_steps = s.override_s * 1e9 // SUBSTEP_NS
    debounce_steps = max(1.0, s.debounce_s * 1e9 // SUBSTEP_NS)
    motion = (s.tip_mass_kg, s.servo_gain_nspm, s.speed_lag_s, s.stall_speed_mps)
    force = (s.override_n, override_steps, debounce_steps, float(s.current_clamp))
    return np.array([*motion, *force])


@numba.njit(cache=True)
def _stop(real: Reals, whole: Integers, i: int, detection: int) -> None:
    real[VELOCITY, i] = 0.0
    real[LAGGED, i] = 0.0
    real[DRIVE, i] = 0.0
    whole[DIRECTION, i] = 0
    whole[DETECTION, i] = detection
    whole[STALLED, i] = 0


@numba.njit(cache=True)
def _reference(real: Reals, p: Reals, i: int, distance: float, clamp: float) -> float:
    """Wanted speed: lagged command, braked before the target, never too slow to reach the clamp."""
    speed = real[SPEED, i]
    real[LAGGED, i] += (speed - real[LAGGED, i]) * min(1.0, _STEP_S / p[LAG])
    braking = sqrt(2.0 * (speed / p[LAG]) * distance)
    creep = 1.05 * clamp / p[GAIN]
    return float(min(real[LAGGED, i], max(braking, creep)))


@numba.njit(cache=True)
def _step(real: Reals, whole: Integers, p: Reals, i: int, opposing: float) -> None:
    """One substep of one moving finger; ``u`` and ``distance`` count along its direction."""
    direction = whole[DIRECTION, i]
    u = direction * real[VELOCITY, i]
    distance = max(0.0, direction * (real[TARGET, i] - real[TRAVEL, i]))
    clamp = real[CLAMP, i]
    if whole[AGE, i] < p[OVERRIDE_STEPS]:
        clamp = max(clamp, p[OVERRIDE_N])
    wanted = _reference(real, p, i, distance, clamp)
    # The servo is stiffer than the step: implicit in its own term.
    rate = _STEP_S / p[MASS]
    after = (u + rate * (p[GAIN] * wanted - opposing)) / (1.0 + rate * p[GAIN])
    drive = p[GAIN] * (wanted - after)
    if p[CLAMPED] > 0.0 and abs(drive) > clamp:
        drive = clamp if drive > 0.0 else -clamp
        after = u + rate * (drive - opposing)
    if u >= 0.0 and after < 0.0:
        after = 0.0  # self-locking: a load stops the screw but does not turn it back
    real[VELOCITY, i] = direction * after
    real[TRAVEL, i] += real[VELOCITY, i] * _STEP_S
    real[DRIVE, i] = drive
    whole[AGE, i] += 1
    stalled = after < p[STALL_SPEED] or p[CLAMPED] == 0.0
    whole[STALLED, i] = whole[STALLED, i] + 1 if drive >= _PUSHING * clamp and stalled else 0
    if direction * (real[TARGET, i] - real[TRAVEL, i]) <= 0.0:
        real[TRAVEL, i] = real[TARGET, i]
        _stop(real, whole, i, 3)
    elif whole[STALLED, i] >= p[DEBOUNCE_STEPS]:
        _stop(real, whole, i, 2 if direction > 0 else 1)


@numba.njit(cache=True)
def advance_motors(
    real: Reals,
    whole: Integers,
    p: Reals,
    steps: int,
    origin: Reals,
    force: Reals,
    stiffness: Reals,
    outside: Reals,
) -> bool:
    """Advance all fingers by ``steps`` substeps; returns whether any still moves.

    Closing is opposed by max(0, force + stiffness x (travel - origin)), N and N/m; opening by the
    constant ``outside``.
    """
    moving = False
    for i in range(FINGERS):
        for _ in range(steps):
            if whole[DIRECTION, i] == 0:
                break
            opposing = outside[i]
            if whole[DIRECTION, i] > 0:
                opposing = max(0.0, force[i] + stiffness[i] * (real[TRAVEL, i] - origin[i]))
            _step(real, whole, p, i, opposing)
        moving = moving or whole[DIRECTION, i] != 0
    return moving


class Scissor:
    """Fourth motor, which spreads fingers B and C: moves at one speed, meets nothing."""

    def __init__(self, counts: int, counts_per_s: float) -> None:
        self._from = self._to = counts
        self._since_ns = 0
        self._speed = counts_per_s

    def go(self, counts: int, now_ns: int) -> None:
        if counts != self._to:
            self._from, self._to, self._since_ns = self.counts(now_ns), counts, now_ns

    def counts(self, now_ns: int) -> int:
        travelled = int(self._speed * (now_ns - self._since_ns) * 1e-9)
        if travelled >= abs(self._to - self._from):
            return self._to
        return self._from + (travelled if self._to > self._from else -travelled)

    def at_rest(self, now_ns: int) -> bool:
        return self.counts(now_ns) == self._to
