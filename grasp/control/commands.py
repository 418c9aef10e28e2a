"""Commands to the devices, in physical units and independent of protocols."""

import msgspec

from drivers.interfaces import FINGER_NAMES, Counts3, Vector3


class MoveFingers(msgspec.Struct, frozen=True, tag=True):
    """Each finger moves to its own position and stops earlier where it meets ``force_n``."""

    targets_counts: Counts3
    speed_mps: float
    force_n: float


class CloseToLimit(msgspec.Struct, frozen=True, tag=True):
    """The marked fingers close until ``force_limit_n`` or the position ``ends_counts``; the others
    hold. ``first_stage``: it ends below the force limit; a second stage follows when the hand
    rests."""

    force_limit_n: float
    closing: tuple[bool, bool, bool]
    ends_counts: Counts3
    speed_mps: float
    first_stage: bool = False


class OpenFingers(msgspec.Struct, frozen=True, tag=True):
    """All fingers open fully."""

    speed_mps: float


class HoldFingers(msgspec.Struct, frozen=True, tag=True):
    """All fingers stay where they are, closed."""


class BeginRest(msgspec.Struct, frozen=True, tag=True):
    """Take the fingertips' rest counts from the next samples."""


class MoveArm(msgspec.Struct, frozen=True, tag=True):
    """The tool moves in a straight line to a position in the base frame."""

    position_m: Vector3
    speed_mps: float
    acceleration_mps2: float


class StopArm(msgspec.Struct, frozen=True, tag=True):
    """The arm brakes on its present line."""

    deceleration_mps2: float


GripperCommand = MoveFingers | CloseToLimit | OpenFingers | HoldFingers
Command = GripperCommand | BeginRest | MoveArm | StopArm


def describe(command: Command) -> str:
    """Describe a command in one line."""
    match command:
        case MoveFingers(targets, speed, force):
            return f"fingers to {targets} counts at {speed * 1e3:.0f} mm/s, at most {force:g} N"
        case CloseToLimit(cap, closing, limits, speed, first_stage):
            fingers = "".join(n for n, c in zip(FINGER_NAMES, closing, strict=True) if c)
            to = f" to {limits} counts" if first_stage else ""
            return f"close {fingers}{to} at {speed * 1e3:.0f} mm/s, at most {cap:g} N"
        case OpenFingers():
            return "open all fingers"
        case HoldFingers():
            return "hold all fingers"
        case BeginRest():
            return "take rest counts"
        case MoveArm((x, y, z), speed, _):
            return f"arm to ({x:.3f}, {y:.3f}, {z:.3f}) m at {speed * 1e3:.0f} mm/s"
        case StopArm():
            return "stop the arm"
