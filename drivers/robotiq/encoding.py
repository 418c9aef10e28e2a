"""From status to fingers, from requests to register images: pure functions of the driver."""

from collections.abc import Sequence

import msgspec

from drivers.errors import Refused
from drivers.interfaces import FINGERS, Applied, Counts3, Detection, FingerState
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.protocol import (
    FULL_BYTE,
    SCISSOR,
    AxisCommand,
    AxisStatus,
    CommandRegisters,
    StatusRegisters,
)

_DETECTIONS = tuple(Detection)
_MOVING = Detection.MOVING
MISREAD_COUNTS = 16  # by which a position is off at most; who was told back further, opens

LATCHED = "contact is latched: a close at no higher force does nothing"
THERE = "already there"


def finger_states(status: StatusRegisters) -> tuple[FingerState, FingerState, FingerState]:
    """All fingers of a status. In scissor mode B and C are moved by a motor of their own, too."""
    a, b, c = (finger_state(axis, status) for axis in status.fingers)
    if status.mode == SCISSOR and status.go_to and _DETECTIONS[status.scissor.detection] is _MOVING:
        b, c = (msgspec.structs.replace(finger, detection=_MOVING) for finger in (b, c))
    return a, b, c


def finger_state(axis: AxisStatus, status: StatusRegisters) -> FingerState:
    """One finger of a status. gDT = 0 means moving only while gGTO is set (manual, gDT): a hand
    without it stands still, ready or reset, unless it is activating or changing its mode.
    """
    detection = _DETECTIONS[axis.detection]
    busy = status.go_to or status.initialization in (1, 2)
    if detection is _MOVING and not busy:
        detection = Detection.AT_TARGET
    return FingerState(axis.echo, axis.position, axis.current_ma, detection)


def pinches(status: StatusRegisters) -> bool:
    """Whether something was met between B and C, which in scissor mode close on each other."""
    met = _DETECTIONS[status.scissor.detection]
    return status.mode == SCISSOR and met is Detection.CONTACT_CLOSING


def checked_counts(targets: Sequence[int]) -> Sequence[int]:
    """Three counts, or Refused."""
    if len(targets) != FINGERS or any(not 0 <= target <= FULL_BYTE for target in targets):
        raise Refused(f"targets {tuple(targets)} are not counts", "give three counts, 0 to 255")
    return targets


def motion_image(
    mode: int, targets: Sequence[int], speed: int, force_bytes: Sequence[int]
) -> CommandRegisters:
    """Fingers one by one (rICF), all targets given: nothing left from before can move them.

    ``mode`` must be the one that the hand is in: another one would open the fingers first.
    """
    a, b, c = (
        AxisCommand(target, speed, byte) for target, byte in zip(targets, force_bytes, strict=True)
    )
    return CommandRegisters(
        activate=True, mode=mode, go_to=True, individual_fingers=True, a=a, b=b, c=c
    )


def with_scissor(command: CommandRegisters, counts: int, speed: int) -> CommandRegisters:
    """The same, with a place of its own for the scissor (rICS), at the least force: without one a
    hand in scissor mode sends its scissor to finger A's place, and obeys no single finger."""
    return msgspec.structs.replace(
        command, individual_scissor=True, scissor=AxisCommand(counts, speed, 0)
    )


def held_targets(
    fingers: Sequence[FingerState], wanted: CommandRegisters | None
) -> tuple[int, ...]:
    """Targets that keep the fingers where they are: their positions.

    A finger that rests at its target, by its own word, keeps that target: following the report,
    which may be some counts off, would make it creep or press. For that no finger that has met
    something is told further than it was; but one that was told to open since, and says still that
    it has met something, is not to open on.
    """
    here = [finger.position_counts for finger in fingers]
    if wanted is None or not wanted.go_to:
        return tuple(here)
    for i, finger in enumerate(fingers):
        asked = wanted.axes[i].position
        if finger.detection is Detection.CONTACT_CLOSING:
            if here[i] - asked <= MISREAD_COUNTS:
                here[i] = min(here[i], asked)
        elif abs(asked - here[i]) <= 1 or _stands_at(finger, asked):
            here[i] = asked
    return tuple(here)


def closing_targets(closing: Sequence[bool], limits: Sequence[int], held: Sequence[int]) -> Counts3:
    """Targets of a closing: nothing opens, and a finger that does not close stays where it is."""
    a, b, c = (
        max(limit, here) if closes else here
        for closes, limit, here in zip(closing, limits, held, strict=True)
    )
    return a, b, c


def _stands_at(finger: FingerState, asked: int) -> bool:
    """Whether it says that it stands where it was told to be; of that request, and of no other."""
    return finger.detection is Detection.AT_TARGET and finger.requested_counts == asked


def why_still(finger: FingerState, axis: AxisCommand, asked: int | None, grip_byte: int) -> str:
    """Why a finger will not move at a request, by a fresh status; empty when it may.

    ``asked`` is the position last requested, ``grip_byte`` the force byte it closed with.
    """
    if finger.detection is Detection.MOVING:
        return ""
    if finger.detection is Detection.CONTACT_CLOSING and axis.force <= grip_byte:
        if axis.position > finger.position_counts:
            return LATCHED
    elif finger.detection is Detection.AT_TARGET and axis.position == asked:
        return THERE
    return THERE if axis.position == finger.position_counts else ""


def applied(calibration: GripperCalibration, command: CommandRegisters, note: str = "") -> Applied:
    """What the bytes of an image say; a note means that nothing will move."""
    targets: Counts3 = (command.a.position, command.b.position, command.c.position)
    return Applied(
        targets_counts=targets,
        speed_mps=calibration.speed_mps(command.a.speed),
        force_n=calibration.force_n(max(axis.force for axis in command.axes)),
        effective=not note,
        note=note,
    )
