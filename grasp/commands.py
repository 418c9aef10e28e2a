"""What a control step may ask of the devices: intents in physical units, no protocol."""

import msgspec

from drivers.interfaces import Counts3, Vector3


class MoveFingers(msgspec.Struct, frozen=True, tag=True):
    """Each finger to its own position; a finger that meets ``force_n`` on the way stops there."""

    targets_counts: Counts3
    speed_mps: float
    force_n: float


class CloseFast(msgspec.Struct, frozen=True, tag=True):
    """The marked fingers close until ``force_cap_n`` or their count limit; the others hold."""

    force_cap_n: float
    closing: tuple[bool, bool, bool]
    limits_counts: Counts3
    speed_mps: float


class OpenFingers(msgspec.Struct, frozen=True, tag=True):
    """All fingers open fully."""

    speed_mps: float


class HoldFingers(msgspec.Struct, frozen=True, tag=True):
    """All fingers stay where they are, closed."""


class BeginRest(msgspec.Struct, frozen=True, tag=True):
    """Take the fingertips' rest counts from the coming samples."""


class MoveArm(msgspec.Struct, frozen=True, tag=True):
    """Straight line of the tool to a position in the base frame."""

    position_m: Vector3
    speed_mps: float
    acceleration_mps2: float


class StopArm(msgspec.Struct, frozen=True, tag=True):
    """Brake on the present line."""

    deceleration_mps2: float


GripperCommand = MoveFingers | CloseFast | OpenFingers | HoldFingers
Command = GripperCommand | BeginRest | MoveArm | StopArm
