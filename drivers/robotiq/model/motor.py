"""Finger motors and the scissor axis: starts, stops and the contact latch, with compiled dynamics.

Each finger has a speed reference with a lag and a stiff speed servo whose force is clamped by the
motor current. It drives an inertia at the fingertip through a self-locking screw. Position is
fingertip travel in metres from the mechanical opening stop. The step grid is aligned to absolute
time, so that one long call and many short ones give equal results.
"""

from math import floor, sqrt
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.numba_cache import compiled
from drivers.robotiq.model.hand import (
    FULL,
    MA_PER_COUNT,
    AxisStatus,
    HandSettings,
    Request,
    speed_mps,
)

SUBSTEP_NS: Final = 100_000
FINGERS: Final = 3

# Rows of the real state, one column a finger.
TRAVEL, VELOCITY, LAGGED, TARGET, SPEED, CLAMP, DRIVE = range(7)
REALS: Final = 7
# Rows of the integer state. DIRECTION 0: stopped. STALLED, AGE: substeps.
DIRECTION, DETECTION, STALLED, AGE = range(4)
INTEGERS: Final = 4
# Entries of the parameters.
MASS, OVERRIDE_N, OVERRIDE_STEPS, DEBOUNCE_STEPS, CLAMPED = range(5)

OPENING, CLOSING, AT_TARGET = 1, 2, 3  # gDT: contact while opening or closing; at the target
OPEN_LIMIT_COUNTS: Final = 6  # software limits; manual p. 74, 6 to 7; Franchi TR711
CLOSED_LIMIT_COUNTS: Final = 240
LAG_S: Final = 0.03  # of a motor's speed; assumed 20 to 50 ms
SCISSOR_COUNTS_PS: Final = 100.0  # assumed
_GAIN_NSPM: Final = 5000.0  # stiffness of the speed servo; assumed
_STALL_SPEED_MPS: Final = 0.001  # below it a motor stalls; assumed
_FULL_SPEED_MPS: Final = speed_mps(FULL)
_RUNNING_MA: Final = (110.0, 160.0)  # moving freely at 0 and at full speed; manual p. 68-73
_MA_PER_N: Final = 20.0  # rise with drive force; assumed
_STEP_S: Final = SUBSTEP_NS * 1e-9
_PUSHING: Final = 0.99  # share of the clamp from which the drive counts as saturated

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


def _parameters(s: HandSettings) -> Reals:
    """Settings of the hand as the parameter array of the compiled loop."""
    override_steps = s.override_s * 1e9 // SUBSTEP_NS
    debounce_steps = max(1.0, s.debounce_s * 1e9 // SUBSTEP_NS)
    clamped = float(s.current_clamp)
    return np.array([s.tip_mass_kg, s.override_n, override_steps, debounce_steps, clamped])


@compiled()
def _advance_motor(
    real: Reals, whole: Integers, p: Reals, steps: int, i: int,
    origin: float, force: float, stiffness: float,
) -> None:  # fmt: skip
    """Advance one moving finger by ``steps`` substeps, or until it stops; ``u`` and ``distance``
    count along its direction. Local variables hold the state: arrays in the loop are slower."""
    closing = whole[DIRECTION, i] > 0
    direction = 1.0 if closing else -1.0
    travel, velocity, lagged = real[TRAVEL, i], real[VELOCITY, i], real[LAGGED, i]
    target, speed, drive = real[TARGET, i], real[SPEED, i], real[DRIVE, i]
    stalled, age, detection = whole[STALLED, i], whole[AGE, i], -1
    for _ in range(steps):
        opposing = max(0.0, force + stiffness * (travel - origin)) if closing else 0.0
        u = direction * velocity
        distance = max(0.0, direction * (target - travel))
        clamp = real[CLAMP, i]
        if age < p[OVERRIDE_STEPS]:
            clamp = max(clamp, p[OVERRIDE_N])
        # Reference speed: lagged command, braked before the target, fast enough for the clamp.
        lagged += (speed - lagged) * min(1.0, _STEP_S / LAG_S)
        braking = sqrt(2.0 * (speed / LAG_S) * distance)
        reference = min(lagged, max(braking, 1.05 * clamp / _GAIN_NSPM))
        # The servo is stiffer than the step: implicit in its own term.
        rate = _STEP_S / p[MASS]
        after = (u + rate * (_GAIN_NSPM * reference - opposing)) / (1.0 + rate * _GAIN_NSPM)
        drive = _GAIN_NSPM * (reference - after)
        if p[CLAMPED] > 0.0 and abs(drive) > clamp:
            drive = clamp if drive > 0.0 else -clamp
            after = u + rate * (drive - opposing)
        if u >= 0.0 and after < 0.0:
            after = 0.0  # self-locking: a load stops the screw but does not turn it back
        velocity = direction * after
        travel += velocity * _STEP_S
        age += 1
        slow = after < _STALL_SPEED_MPS or p[CLAMPED] == 0.0
        stalled = stalled + 1 if drive >= _PUSHING * clamp and slow else 0
        if direction * (target - travel) <= 0.0:
            travel, detection = target, AT_TARGET
            break
        if stalled >= p[DEBOUNCE_STEPS]:
            detection = CLOSING if closing else OPENING
            break
    if detection >= 0:
        velocity, lagged, drive, stalled = 0.0, 0.0, 0.0, 0
        whole[DIRECTION, i], whole[DETECTION, i] = 0, detection
    real[TRAVEL, i], real[VELOCITY, i], real[LAGGED, i] = travel, velocity, lagged
    real[DRIVE, i] = drive
    whole[STALLED, i], whole[AGE, i] = stalled, age


@compiled()
def advance_motors(
    real: Reals, whole: Integers, p: Reals, steps: int,
    origin: Reals, force: Reals, stiffness: Reals,
) -> bool:  # fmt: skip
    """Advance all fingers by ``steps`` substeps; returns whether any still moves.

    Closing is opposed by max(0, force + stiffness x (travel - origin)), N and N/m.
    """
    moving = False
    for i in range(FINGERS):
        if whole[DIRECTION, i] != 0:
            _advance_motor(real, whole, p, steps, i, origin[i], force[i], stiffness[i])
        moving = moving or whole[DIRECTION, i] != 0
    return moving


Axes = tuple[Request, Request, Request]


class FingerLoads(msgspec.Struct, frozen=True):
    """Load on each finger, linearised about its travel x0 when the load is set.

    A closing finger is opposed by max(0, force_n + stiffness_npm * (x - x0)); a negative force is a
    gap. An opening finger has no load. Each is a (3,) float64 array.
    """

    force_n: NDArray[np.float64]
    stiffness_npm: NDArray[np.float64]


FREE: Final = FingerLoads(np.zeros(FINGERS), np.zeros(FINGERS))


class FingerMotion(msgspec.Struct, frozen=True):
    """A request on its way to the motors. ``retrigger``: rGTO rose, so it clears latches."""

    at_ns: int
    axes: Axes
    starts: tuple[bool, bool, bool] = (True, True, True)
    retrigger: bool = True
    stop: bool = False
    to_stops: bool = False  # to the mechanical stops, past the software limits


class Fingers:
    """State of the three finger motors. Positions in counts are encoder readings."""

    def __init__(self, settings: HandSettings, now_ns: int) -> None:
        self._settings = settings
        self.real = np.zeros((REALS, FINGERS))
        self._whole = np.zeros((INTEGERS, FINGERS), dtype=np.int64)
        self.real[TRAVEL] = OPEN_LIMIT_COUNTS * settings.m_per_count
        self._parameters = _parameters(settings)
        self._substep = now_ns // SUBSTEP_NS
        self._forces = [0] * FINGERS  # force byte that each motor last ran with
        self._loads = FREE
        self._origin = self.real[TRAVEL].copy()
        self.moving = True
        self.integrate(now_ns)  # compiles now, so that no later call waits for it

    def load(self, loads: FingerLoads) -> None:
        self._loads = loads
        self._origin[:] = self.real[TRAVEL]

    def integrate(self, until_ns: int) -> None:
        """Run the motors over the substeps that begin before ``until_ns``."""
        step = until_ns // SUBSTEP_NS
        if self.moving:
            self.moving = advance_motors(
                self.real, self._whole, self._parameters, step - self._substep,
                self._origin, self._loads.force_n, self._loads.stiffness_npm,
            )  # fmt: skip
        self._substep = step

    def stop(self) -> None:
        """Stop all motors at once; detections stay."""
        self.moving = False
        self._whole[DIRECTION] = 0
        self.real[VELOCITY : LAGGED + 1] = 0.0
        self.real[DRIVE] = 0.0

    def forget_detections(self) -> None:
        self._whole[DETECTION] = 0

    def mark_moving(self, i: int) -> None:
        """Report finger ``i`` as moving, since a request for it is under way."""
        self._whole[DETECTION, i] = 0

    def stronger_in_contact(self, i: int, force: int) -> bool:
        return self._whole[DETECTION, i] == CLOSING and force > self._forces[i]

    def may_start(self, i: int, axis: Request, retrigger: bool) -> bool:
        """The contact latch: opposite direction, higher force or a new rGTO only (manual p. 51)."""
        detection = self._whole[DETECTION, i]
        if retrigger or axis.force > self._forces[i]:
            return True
        return detection != CLOSING or axis.position < self.counts()[i]

    def execute(self, motion: FingerMotion) -> None:
        """Start the motors on a request, unless contact since its take-up has latched them."""
        if motion.stop:
            self.stop()
            return
        settings, whole = self._settings, self._whole
        for i, axis in enumerate(motion.axes):
            self.real[SPEED, i] = speed_mps(axis.speed)
            starts = motion.starts[i] and self.may_start(i, axis, motion.retrigger)
            if starts or whole[DIRECTION, i]:
                self._forces[i] = axis.force
                self.real[CLAMP, i] = settings.force_n(axis.force)
            if starts:
                self._start(i, axis.position, motion.to_stops)
        self.moving = bool(whole[DIRECTION].any())

    def _start(self, i: int, counts: int, to_stops: bool) -> None:
        """Start motor ``i``; software limits clip the request without notice (manual p. 74)."""
        low, high = (0, FULL) if to_stops else (OPEN_LIMIT_COUNTS, CLOSED_LIMIT_COUNTS)
        target = min(max(counts, low), high)
        real, whole = self.real, self._whole
        was = whole[DIRECTION, i]
        if not was and target == self.counts()[i]:
            whole[DETECTION, i] = AT_TARGET
            return
        real[TARGET, i] = target * HandSettings.m_per_count
        direction = 1 if real[TARGET, i] > real[TRAVEL, i] else -1
        whole[DETECTION, i] = whole[STALLED, i] = 0
        if direction != was:
            whole[DIRECTION, i] = direction
            whole[AGE, i] = 0
            real[LAGGED, i] = 0.0

    def counts(self) -> list[int]:
        """Position of each finger as its encoder reports it."""
        return [_counts(travel_m) for travel_m in self.real[TRAVEL].tolist()]

    def status(self, echoes: tuple[int, int, int]) -> list[AxisStatus]:
        """Status of each finger (gPR, gPO, gCU, gDT)."""
        real, whole = self.real.tolist(), self._whole.tolist()
        slow, fast = _RUNNING_MA
        status = []
        for i, echo in enumerate(echoes):
            current = 0
            if whole[DIRECTION][i]:
                speed, drive = abs(real[VELOCITY][i]), abs(real[DRIVE][i])
                running = slow + (fast - slow) * speed / _FULL_SPEED_MPS + _MA_PER_N * drive
                current = min(round(running / MA_PER_COUNT), 255)
            counts, detection = _counts(real[TRAVEL][i]), whole[DETECTION][i]
            status.append(AxisStatus(echo, counts, current, detection))
        return status


def _counts(travel_m: float) -> int:
    return min(max(floor(travel_m / HandSettings.m_per_count + 0.5), 0), FULL)


class Scissor:
    """Fourth motor, which spreads fingers B and C to the target: constant speed, no contact."""

    def __init__(self, counts: int) -> None:
        self._from = self.target = counts
        self._since_ns = 0

    def go(self, counts: int, now_ns: int) -> None:
        if counts != self.target:
            self._from, self.target, self._since_ns = self.counts(now_ns), counts, now_ns

    def counts(self, now_ns: int) -> int:
        travelled = int(SCISSOR_COUNTS_PS * (now_ns - self._since_ns) * 1e-9)
        if travelled >= abs(self.target - self._from):
            return self.target
        return self._from + (travelled if self.target > self._from else -travelled)
