"""Device interfaces of the controller: frozen states and the protocols of gripper, tactile sensor
and arm.

Times are integer nanoseconds of one monotonic clock and are always passed in. Fingers are ordered
A, B, C: finger A (the thumb) opposes B and C. Forces are newtons at a fingertip, by the gripper's
calibration. Positions are motor counts, 0 (open) to 255 (closed), as the hand reports them.
"""

from collections.abc import Callable
from enum import IntEnum
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

FINGER_NAMES = ("A", "B", "C")
FINGERS = len(FINGER_NAMES)
KIT_TAXELS = 6  # of a fingertip of the Robotiq kit; the setting `tactile.cells` may differ
OPEN_COUNTS = 20  # up to here a finger holds nothing; an opened hand rests at about 6
CODE_MAX = 1023  # of a taxel: ten bits
PERIOD_NS = 10_000_000  # of a tactile sample and a control step: 100 Hz, as in the paper
PERIOD_S = PERIOD_NS / 1e9
MIN_SPEED_FRACTION = 0.5  # of an arm's speed slider, to begin to move with; assumed

Counts3 = tuple[int, int, int]
Vector3 = tuple[float, float, float]
Vector6 = tuple[float, float, float, float, float, float]


class Detection(IntEnum):
    """Object detection of one finger (gDTA..gDTC; Robotiq manual, GRIPPER STATUS register)."""

    MOVING = 0
    CONTACT_OPENING = 1
    CONTACT_CLOSING = 2
    AT_TARGET = 3


class FingerState(msgspec.Struct, frozen=True):
    """State of one finger as the gripper reports it."""

    requested_counts: int  # echo of the last request that the gripper took up
    position_counts: int
    current_ma: int  # motor current; falls to 0 when the finger has stopped
    detection: Detection

    @property
    def min_closure_counts(self) -> int:
        """Lower bound of the closure: the smaller of position and target.

        One count beyond the target is accepted. A finger closes no farther: a position beyond that
        is an encoder error.
        """
        beyond = self.position_counts - self.requested_counts > 1
        return self.requested_counts if beyond else self.position_counts


class GripperState(msgspec.Struct, frozen=True):
    """Snapshot of the gripper's status registers.

    ``fresh`` is False from the moment a command is issued until the status is known to reflect it:
    the echo matches, or two register refreshes have passed for an unchanged request. Until then the
    detections still describe the previous motion.
    """

    t_ns: int  # when the status was requested
    seq: int
    active: bool  # activation complete: the gripper obeys motion commands
    fault: int  # gFLT, 0 = none
    fault_text: str  # empty when there is none
    fresh: bool
    fingers: tuple[FingerState, FingerState, FingerState]
    took_ns: int = 0  # duration of the exchange; the status was sampled within it
    written: str = ""  # bytes of the last write that the device acknowledged, in hex
    written_ns: int = 0  # when it acknowledged them; 0: no write is known

    def age_ns(self, now_ns: int) -> int:
        return now_ns - self.t_ns

    @property
    def at_rest(self) -> bool:
        """True when the status is fresh and no finger moves."""
        a, b, c = self.fingers
        return self.fresh and Detection.MOVING not in (a.detection, b.detection, c.detection)

    @property
    def is_open(self) -> bool:
        """Whether all fingers are stopped and too wide open to hold anything."""
        closing = (Detection.MOVING, Detection.CONTACT_CLOSING)
        stopped = all(f.detection not in closing for f in self.fingers)
        return stopped and max(self.positions) <= OPEN_COUNTS

    @property
    def thumb_latched(self) -> bool:
        """Whether finger A has stopped on contact while closing; it ignores further closing."""
        return self.fingers[0].detection is Detection.CONTACT_CLOSING

    @property
    def not_at_target(self) -> str:
        """Name of the first finger that is not at its target; empty if all are."""
        named = zip(FINGER_NAMES, self.fingers, strict=True)
        return next((name for name, f in named if f.detection is not Detection.AT_TARGET), "")

    @property
    def requested(self) -> Counts3:
        a, b, c = self.fingers
        return (a.requested_counts, b.requested_counts, c.requested_counts)

    @property
    def positions(self) -> Counts3:
        a, b, c = self.fingers
        return a.position_counts, b.position_counts, c.position_counts

    @property
    def min_closure_counts(self) -> Counts3:
        """Lower bound of the closure of each finger."""
        a, b, c = self.fingers
        return a.min_closure_counts, b.min_closure_counts, c.min_closure_counts


class Applied(msgspec.Struct, frozen=True):
    """Values that a gripper verb applied, after rounding to the device's units.

    ``force_n`` is the calibrated static force of the force byte that goes to the gripper.
    ``effective`` is False when the device will not move (latched contact); ``note`` gives the
    reason. A verb deferred by a busy device returns the requested values with a ``note``;
    ``GripperState.written`` shows what was written later.
    """

    targets_counts: Counts3
    speed_mps: float
    force_n: float
    effective: bool = True
    note: str = ""


class Gripper(Protocol):
    """A gripper with exactly three fingers, A opposite B and C; no other number is supported. Verbs
    set intent; ``poll`` does one exchange with the device.

    Verbs raise ``Refused`` when the request cannot be met within the given limits. Link errors
    (``LinkLost``) are raised by ``poll`` only.
    """

    @property
    def state(self) -> GripperState | None: ...

    @property
    def least_force_n(self) -> float:
        """Calibrated static force of the smallest force setting."""
        ...

    @property
    def m_per_count(self) -> float:
        """Fingertip travel of one motor count, by the position calibration."""
        ...

    @property
    def acknowledged(self) -> bool:
        """Whether the device has acknowledged the write of everything requested."""
        ...

    def poll(self, now_ns: int) -> None: ...

    def set_fallback(self, command: "Callable[[Gripper], Applied] | None", text: str) -> None:
        """Set the command that a driver with its own thread sends if the program hangs, that is if
        neither ``poll`` nor a verb is called for a second; any other driver does nothing. ``text``
        describes the command."""
        ...

    def activate(self, dropping: bool = False) -> Applied:
        """Activate the hand; ``dropping``: even if that drops an object."""
        ...

    def open(self, speed_mps: float) -> Applied: ...

    def move_to(self, targets_counts: Counts3, speed_mps: float, force_n: float) -> Applied: ...

    def close_to_limit(
        self,
        force_limit_n: float,
        closing: tuple[bool, bool, bool],
        ends_counts: Counts3,
        speed_mps: float,
    ) -> Applied: ...

    def hold(self) -> Applied: ...


class TactileFrame(msgspec.Struct, frozen=True):
    """Sample of all fingertips on the 100 Hz grid.

    All arrays are (3, taxels) int16. counts: raw minus rest, pressing is negative. raw, rest:
    10-bit codes. temperature: raw temperature codes. A missed sample repeats the last frame with
    ``missed`` counting up; when ``stale`` is True (five or more missed) it must not be used.
    """

    t_ns: int  # grid time of this frame: when it was delivered
    sampled_ns: int  # best estimate of when the pressures were converted
    seq: int
    counts: NDArray[np.int16]
    raw: NDArray[np.int16]
    rest: NDArray[np.int16]
    temperature: NDArray[np.int16]
    missed: int = 0
    stale: bool = False


class TactileSensor(Protocol):
    """Fingertips sampled at 100 Hz; ``poll`` reads one sample, ``frame`` is the latest one."""

    @property
    def frame(self) -> TactileFrame | None:
        """Latest frame; None before the rest counts have been taken."""
        ...

    @property
    def rest_taken(self) -> bool: ...

    def poll(self, now_ns: int) -> None: ...

    def begin_rest(self) -> None:
        """Start taking rest counts from the next samples; ``rest_taken`` turns True when done.
        ``poll`` raises ``Refused`` when a fingertip is loaded or unsteady during that time."""
        ...


class ArmState(msgspec.Struct, frozen=True):
    """Tool position and velocity in the base frame, as last reported by the controller.

    ``angle_rad`` is the rotation about the tool's z axis (right-handed) since the start.
    ``speed_fraction`` is the speed slider: the fraction of the commanded speed, 0 to 1, at which
    the arm moves. ``sampled_ns`` is the controller's own timestamp; None if it has none.
    ``joints_rad`` are the joint angles of the same sample, base first; None if they are not known.
    """

    t_ns: int
    seq: int
    position_m: Vector3
    velocity_mps: Vector3
    moving: bool
    stopped_by_safety: bool = False  # protective or emergency stop
    angle_rad: float = 0.0
    spin_radps: float = 0.0
    speed_fraction: float = 1.0
    sampled_ns: int | None = None
    joints_rad: Vector6 | None = None

    def age_ns(self, now_ns: int) -> int:
        return now_ns - self.t_ns


class Arm(Protocol):
    """An arm that moves along straight lines, or drives at a velocity that must be renewed.

    Verbs raise ``Refused`` outside their limits, before anything is sent.
    """

    @property
    def state(self) -> ArmState | None: ...

    def poll(self, now_ns: int) -> None: ...

    def move_to(self, position_m: Vector3, speed_mps: float, acceleration_mps2: float) -> None: ...

    def drive(self, velocity_mps: Vector3, spin_radps: float, acceleration_mps2: float) -> None:
        """Drive at this velocity and spin about the tool's z axis, within the acceleration (the
        same number in rad/s2 for the spin). A drive that is not renewed in time is stopped."""
        ...

    def stop(self, deceleration_mps2: float) -> None: ...

    def set_payload(self, mass_kg: float) -> None: ...
