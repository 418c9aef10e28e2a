"""What the controller may know of a device: frozen states, physical units, three protocols.

Times are integer nanoseconds of one monotonic clock and are always passed in. Fingers are ordered
A, B, C: finger A (the thumb) opposes B and C. Forces are newtons at a fingertip, by the gripper's
calibration; positions are motor counts, 0 (open) to 255 (closed), which are the truth of this hand.
"""

from enum import IntEnum
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

FINGER_NAMES = ("A", "B", "C")
FINGERS = len(FINGER_NAMES)
KIT_TAXELS = 6  # of a fingertip of the Robotiq kit; a setting (`tactile.cells`) says how many
OPEN_COUNTS = 20  # a hand told to open rests at about 6; nothing is held so wide
CODE_MAX = 1023  # of a taxel: ten bits
PERIOD_NS = 10_000_000  # of a tactile sample and a control step: 100 Hz, as in the paper
PERIOD_S = PERIOD_NS / 1e9
LEAST_SPEED_FRACTION = 0.5  # of an arm's speed slider, to begin to move with; assumed

Counts3 = tuple[int, int, int]
Vector3 = tuple[float, float, float]


class Detection(IntEnum):
    """Object detection of one finger (gDTA..gDTC; Robotiq manual, GRIPPER STATUS register)."""

    MOVING = 0
    CONTACT_OPENING = 1
    CONTACT_CLOSING = 2
    AT_TARGET = 3


class FingerState(msgspec.Struct, frozen=True):
    """One finger as the gripper reports it."""

    requested_counts: int  # echo of the last request that the gripper took up
    position_counts: int
    current_ma: int  # motor current; falls to 0 when the finger has stopped
    detection: Detection

    @property
    def least_closed_counts(self) -> int:
        """How far it is closed at least: a finger goes no further than it was told, but for a count
        beside its target that it may rest at; what says more is an encoder that is off."""
        beyond = self.position_counts - self.requested_counts > 1
        return self.requested_counts if beyond else self.position_counts


class GripperState(msgspec.Struct, frozen=True):
    """Snapshot of the gripper's status registers.

    ``fresh`` is False from the moment a command is issued until the status is known to speak of
    that command (echo matches, or two register refreshes for an unchanged request): until then the
    detections still describe the motion before it.
    """

    t_ns: int  # when the status was asked for
    seq: int
    active: bool  # activation complete: the gripper obeys motion commands
    fault: int  # gFLT, 0 = none
    fault_text: str  # empty when there is none
    fresh: bool
    fingers: tuple[FingerState, FingerState, FingerState]
    took_ns: int = 0  # until it was there: a late one tells of a moment in between
    written: str = ""  # bytes of the last write that the device acknowledged, in hex
    written_ns: int = 0  # when it acknowledged them; 0: no write is known

    def age_ns(self, now_ns: int) -> int:
        return now_ns - self.t_ns

    @property
    def at_rest(self) -> bool:
        """True when the status is fresh and no finger moves."""
        return self.fresh and all(f.detection is not Detection.MOVING for f in self.fingers)

    @property
    def is_open(self) -> bool:
        """Whether all fingers stand so wide that they hold nothing."""
        closed = (Detection.MOVING, Detection.CONTACT_CLOSING)
        stand = all(f.detection not in closed for f in self.fingers)
        return stand and max(self.positions) <= OPEN_COUNTS

    @property
    def thumb_latched(self) -> bool:
        """Whether finger A has stopped on what it closed on: it obeys no further closing."""
        return self.fingers[0].detection is Detection.CONTACT_CLOSING

    @property
    def not_at_target(self) -> str:
        """Name of the first finger that did not end where it was told to; empty if all did."""
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
    def least_closed_counts(self) -> Counts3:
        """How far each finger is closed at least."""
        a, b, c = self.fingers
        return a.least_closed_counts, b.least_closed_counts, c.least_closed_counts


class Applied(msgspec.Struct, frozen=True):
    """What a gripper verb could really apply, after rounding to the device's own units.

    ``force_n`` is the calibrated static force of the force byte that goes to the gripper.
    ``effective`` is False when the device will do nothing (latched contact); ``note``
    says why. A verb that a busy device has not taken yet tells what it was asked, and says so in
    ``note``; ``GripperState.written`` shows what became of it.
    """

    targets_counts: Counts3
    speed_mps: float
    force_n: float
    effective: bool = True
    note: str = ""


class Gripper(Protocol):
    """A three-finger gripper. Verbs set intent; ``poll`` does one exchange with the device.

    Verbs raise ``Refused`` when the request cannot be made within the limits given; they never
    raise on link trouble, ``poll`` does (``LinkLost``).
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
        """Whether the device has answered the write of everything that was asked for."""
        ...

    def poll(self, now_ns: int) -> None: ...

    def activate(self, dropping: bool = False) -> Applied:
        """``dropping``: even if that drops what the fingers hold."""
        ...

    def open(self, speed_mps: float) -> Applied: ...

    def move_to(self, targets_counts: Counts3, speed_mps: float, force_n: float) -> Applied: ...

    def close_fast(
        self,
        force_cap_n: float,
        closing: tuple[bool, bool, bool],
        limits_counts: Counts3,
        speed_mps: float,
    ) -> Applied: ...

    def hold(self) -> Applied: ...


class TactileFrame(msgspec.Struct, frozen=True):
    """One sample of all fingertips on the 100 Hz grid.

    All arrays are (3, taxels) int16. counts: raw minus rest, pressing is negative. raw, rest:
    10-bit codes. temperature: raw temperature codes. A missed sample repeats the last frame with
    ``missed`` counting up; when ``stale`` is True (five or more missed) it must not be used.
    """

    t_ns: int  # grid time of this frame: when it was handed over
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

        ``poll`` raises ``Refused`` when a fingertip is loaded or unsteady meanwhile.
        """
        ...


class ArmState(msgspec.Struct, frozen=True):
    """Tool position and velocity in the base frame, as last reported by the controller.

    ``angle_rad`` is the turn about the tool's own axis (its z, right-handed) since the start.
    ``speed_fraction`` is where the speed slider stands: the share of the speed asked for, 0 to 1,
    that the arm moves at. ``sampled_ns`` is when, by the controller's own clock; None: it has none.
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

    def age_ns(self, now_ns: int) -> int:
        return now_ns - self.t_ns


class Arm(Protocol):
    """Moves along straight lines, or drives at a velocity that must be renewed.

    Verbs raise ``Refused`` outside their limits, before anything is sent.
    """

    @property
    def state(self) -> ArmState | None: ...

    def poll(self, now_ns: int) -> None: ...

    def move_to(self, position_m: Vector3, speed_mps: float, acceleration_mps2: float) -> None: ...

    def drive(self, velocity_mps: Vector3, spin_radps: float, acceleration_mps2: float) -> None:
        """Take up this velocity, and spin about the tool's own axis, at up to the acceleration
        (of the same number in rad/s2). A drive that is not renewed in time is stopped."""
        ...

    def stop(self, deceleration_mps2: float) -> None: ...

    def set_payload(self, mass_kg: float) -> None: ...
