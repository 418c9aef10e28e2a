"""Three fingers and their motors: starts, stops and the contact latch, around the compiled loop."""

from math import floor
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.robotiq.model import motor
from drivers.robotiq.model.hand import HandSettings
from drivers.robotiq.model.motor import FINGERS, SUBSTEP_NS
from drivers.robotiq.model.registers import MA_PER_COUNT, AxisStatus, Request

OPENING, CLOSING, AT_TARGET = 1, 2, 3  # gDT

Axes = tuple[Request, Request, Request]


class FingerLoads(msgspec.Struct, frozen=True):
    """What opposes each finger, linearised about its travel x0 when it is handed over.

    A closing finger meets max(0, force_n + stiffness_npm * (x - x0)); a negative force is a gap.
    An opening finger meets the constant ``outside_n``. Each is a (3,) float64 array.
    """

    force_n: NDArray[np.float64]
    stiffness_npm: NDArray[np.float64]
    outside_n: NDArray[np.float64] = np.zeros(FINGERS)


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
    """State of the three finger motors. Positions in counts are what the encoders say."""

    def __init__(self, settings: HandSettings, now_ns: int) -> None:
        self._settings = settings
        self._real = np.zeros((motor.REALS, FINGERS))
        self._whole = np.zeros((motor.INTEGERS, FINGERS), dtype=np.int64)
        self._real[motor.TRAVEL] = settings.open_limit_counts * settings.m_per_count
        self._parameters = motor.parameters(settings)
        self._substep = now_ns // SUBSTEP_NS
        self._forces = [0] * FINGERS  # force byte that each motor last ran with
        self._loads = FREE
        self._origin = self._real[motor.TRAVEL].copy()
        self.moving = False
        self._run(0)  # compiled now, the first time on a machine: later a client waits

    @property
    def travel_m(self) -> NDArray[np.float64]:
        return np.array(self._real[motor.TRAVEL])

    @property
    def velocity_mps(self) -> NDArray[np.float64]:
        return np.array(self._real[motor.VELOCITY])

    def load(self, loads: FingerLoads) -> None:
        self._loads = loads
        self._origin[:] = self._real[motor.TRAVEL]

    def integrate(self, until_ns: int) -> None:
        """Run the motors over the substeps that begin before ``until_ns``."""
        step = until_ns // SUBSTEP_NS
        if self.moving and step > self._substep:
            self._run(step - self._substep)
        self._substep = step

    def _run(self, substeps: int) -> None:
        loads = self._loads
        self.moving = motor.advance_motors(
            self._real,
            self._whole,
            self._parameters,
            substeps,
            self._origin,
            loads.force_n,
            loads.stiffness_npm,
            loads.outside_n,
        )

    def stop(self) -> None:
        """Brake all motors where they are; what was detected stays."""
        self.moving = False
        self._whole[motor.DIRECTION] = 0
        self._real[motor.VELOCITY : motor.LAGGED + 1] = 0.0
        self._real[motor.DRIVE] = 0.0

    def forget_detections(self) -> None:
        self._whole[motor.DETECTION] = 0

    def expect(self, i: int) -> None:
        """A request for finger ``i`` is under way: it counts as moving."""
        self._whole[motor.DETECTION, i] = 0

    def stronger_in_contact(self, i: int, force: int) -> bool:
        return self._whole[motor.DETECTION, i] in (OPENING, CLOSING) and force > self._forces[i]

    def free_to_go(self, i: int, axis: Request, retrigger: bool) -> bool:
        """The contact latch: opposite direction, higher force or a new rGTO only (manual p. 51)."""
        detection = self._whole[motor.DETECTION, i]
        if retrigger or axis.force > self._forces[i]:
            return True
        if detection == CLOSING:
            return axis.position < self.counts(i)
        if detection == OPENING:
            return axis.position > self.counts(i)
        return True

    def execute(self, motion: FingerMotion) -> None:
        """Hand a request to the motors. Contact made since it was taken up latches it too."""
        if motion.stop:
            self.stop()
            return
        settings, whole = self._settings, self._whole
        for i, axis in enumerate(motion.axes):
            self._real[motor.SPEED, i] = settings.speed_mps(axis.speed)
            starts = motion.starts[i] and self.free_to_go(i, axis, motion.retrigger)
            if starts or whole[motor.DIRECTION, i]:
                self._forces[i] = axis.force
                self._real[motor.CLAMP, i] = settings.force_n(axis.force)
            if starts:
                self._start(i, axis.position, motion.to_stops)
        self.moving = bool(whole[motor.DIRECTION].any())

    def _start(self, i: int, counts: int, to_stops: bool) -> None:
        """Set motor ``i`` going; software limits replace the request, silently (manual p. 74)."""
        s = self._settings
        low, high = (0, 255) if to_stops else (s.open_limit_counts, s.closed_limit_counts)
        target = min(max(counts - s.offset_counts[i], low), high)
        real, whole = self._real, self._whole
        was = whole[motor.DIRECTION, i]
        if not was and target + s.offset_counts[i] == self.counts(i):
            whole[motor.DETECTION, i] = AT_TARGET
            return
        real[motor.TARGET, i] = target * s.m_per_count
        direction = 1 if real[motor.TARGET, i] > real[motor.TRAVEL, i] else -1
        whole[motor.DETECTION, i] = whole[motor.STALLED, i] = 0
        if direction != was:
            whole[motor.DIRECTION, i] = direction
            whole[motor.AGE, i] = 0
            real[motor.LAGGED, i] = 0.0

    def counts(self, i: int) -> int:
        """Position of finger ``i`` as its encoder reports it, rounded."""
        counts = float(self._real[motor.TRAVEL, i]) / self._settings.m_per_count
        return min(max(floor(counts + 0.5) + self._settings.offset_counts[i], 0), 255)

    def status(self, i: int, echo: int) -> AxisStatus:
        detection = int(self._whole[motor.DETECTION, i])
        if self._settings.misses_contact and detection in (OPENING, CLOSING):
            detection = AT_TARGET
        return AxisStatus(echo, self.counts(i), self._current(i), detection)

    def _current(self, i: int) -> int:
        if not self._whole[motor.DIRECTION, i]:
            return 0
        s, real = self._settings, self._real
        slow, fast = s.running_current_ma
        speed, drive = abs(float(real[motor.VELOCITY, i])), abs(float(real[motor.DRIVE, i]))
        current = slow + (fast - slow) * speed / s.speed_mps(255) + s.current_ma_per_n * drive
        return min(round(current / MA_PER_COUNT), 255)
