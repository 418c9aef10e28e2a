"""What was written to the gripper, against what its commands say by the driver's own encoding.

Compared are the bits that let fingers move one by one, and target, speed and force of each finger.
A finger that stays is told a position that was perhaps read between two steps: its target must lie
where the finger was, or where it had been told to be. Mode and scissor are not compared: no command
tells them.
"""

from collections.abc import Sequence

from drivers.interfaces import FINGERS, Counts3, GripperState
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.encoding import MISREAD_COUNTS, closing_targets, motion_image
from drivers.robotiq.modes import BASIC
from drivers.robotiq.protocol import BYTES, FULL_BYTE
from grasp.commands import (
    CloseFast,
    GripperCommand,
    HoldFingers,
    MoveFingers,
    OpenFingers,
    describe,
)

# Without the mode (in byte 0), whether the scissor obeys by itself (in byte 1), and its own bytes
_COMPARED = (0b11111001, 0b11110111, *[FULL_BYTE] * 10, 0, 0, 0, FULL_BYTE)
_TARGETS, _SPEED = slice(3, 12, 3), 4  # in the 16 bytes
_FIRST = motion_image(BASIC, (0, 0, 0), 0, (0, 0, 0)).to_bytes()[:2]  # the register of rACT

Bounds = tuple[bytes, bytes]  # least and greatest of each byte


class WriteCheck:
    """Takes the gripper's commands and states in their order, and tells which write is wrong."""

    def __init__(self, calibration: GripperCalibration) -> None:
        self.compared = 0
        self._calibration = calibration
        self._before: GripperState | None = None
        self._sent: list[GripperCommand] = []  # the one that was written last, and those since
        self._unseen = False  # the latest of them was not found written yet
        self._troubled = False  # the driver may have stopped the hand by itself

    def send(self, command: GripperCommand) -> None:
        self._sent.append(command)
        self._unseen = True

    def take(self, state: GripperState, troubled: bool) -> tuple[str, str] | None:
        """The state that a step was told: the bytes recorded and expected, where they differ.

        A write may be of any command since the last one, for a command replaces one that waits; a
        fresh status speaks of the latest. ``troubled``: a device failed.
        """
        before, self._before = self._before or state, state
        self._troubled = self._troubled or troubled or not state.active
        new = state.written_ns != before.written_ns
        due = self._unseen and state.fresh and bool(state.written) and not self._troubled
        if not self._sent or not (new or due):
            return None
        self.compared += new
        candidates = self._sent[-1:] if due else self._sent
        written, bounds = _bytes(state.written), []
        for i, command in enumerate(candidates, len(self._sent) - len(candidates)):
            bounds = self._bounds(command, before, state)
            if any(_within(written, each) for each in bounds):
                self._unseen = i < len(self._sent) - 1
                del self._sent[:i]
                return None
        if self._troubled and self._stops(written, before, state):
            return None
        self._unseen, expected = False, f"{_told(bounds[0])} ({describe(self._sent[-1])})"
        return written.hex(" "), expected

    def _stops(self, written: bytes, before: GripperState, state: GripperState) -> bool:
        """Whether it resets the hand or holds it, as the driver does once it has lost it."""
        held = self._bounds(HoldFingers(), before, state)
        return not any(written) or any(_within(written, bounds) for bounds in held)

    def _bounds(
        self, command: GripperCommand, before: GripperState, state: GripperState
    ) -> list[Bounds]:
        """What may be written for a command; the usual first."""
        told, known = _bytes(before.written), [before.positions, state.positions]
        if before.written:
            known.append(_counts(told[_TARGETS]))
        least = _counts([min(each) - MISREAD_COUNTS for each in zip(*known, strict=True)])
        most = _counts([max(each) + MISREAD_COUNTS for each in zip(*known, strict=True)])
        if isinstance(command, HoldFingers):
            low, high = self._image(command, least, 0), self._image(command, most, 0)
            return [(bytes((low[0] & ~8, *low[1:])), high)]  # it may stop by clearing rGTO instead
        speeds = [self._calibration.speed_byte_at_most(command.speed_mps)]
        if isinstance(command, CloseFast):  # where the status is in doubt: no faster than before
            speeds.append(min(*speeds, told[_SPEED]))
        return [
            (self._image(command, least, speed), self._image(command, most, speed))
            for speed in speeds
        ]

    def _image(self, command: GripperCommand, held: Counts3, speed: int) -> bytes:
        """What is written for a command, where fingers that stay are told ``held``."""
        targets, forces = held, [0] * FINGERS
        if isinstance(command, OpenFingers):
            targets = (0, 0, 0)
        elif isinstance(command, MoveFingers):
            targets = command.targets_counts
            forces = [self._calibration.byte_at_most(command.force_n)] * FINGERS
        elif isinstance(command, CloseFast):
            targets = closing_targets(command.closing, command.limits_counts, held)
            byte = self._calibration.byte_at_most(command.force_cap_n)
            forces = [byte if closes else 0 for closes in command.closing]
        return motion_image(BASIC, targets, speed, forces).to_bytes()


def _counts(values: Sequence[int]) -> Counts3:
    a, b, c = (max(0, min(FULL_BYTE, value)) for value in values)
    return a, b, c


def _bytes(text: str) -> bytes:
    """All 16 of a write, which leaves the first register out where it holds what is wanted; what is
    no write fits no command."""
    try:
        data = bytes.fromhex(text)
    except ValueError:
        data = b""
    whole = data if len(data) == BYTES else _FIRST + data
    return whole if len(whole) == BYTES else bytes([FULL_BYTE] * BYTES)


def _within(written: bytes, bounds: Bounds) -> bool:
    return all(
        low <= byte & compared <= high
        for byte, compared, low, high in zip(written, _COMPARED, *bounds, strict=True)
    )


def _told(bounds: Bounds) -> str:
    pairs = zip(*bounds, strict=True)
    return " ".join(f"{low:02x}" if low == high else f"{low:02x}-{high:02x}" for low, high in pairs)
