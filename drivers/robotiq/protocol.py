"""Registers of the Robotiq 3-Finger gripper: bytes, faults, text, plausibility. No I/O, no time.

Source: Robotiq 3-Finger instruction manual, 2008-2014 edition (register map p. 39-57, worked
frames p. 67-74, register order p. 89) and 2008-2018 edition. Eight 16-bit registers go each way;
register n holds byte 2n in its high half and byte 2n+1 in its low half. Any content decodes; a
wrong shape, not 16 bytes or eight values of 16 bits, is a ``ValueError``.
"""

import struct
from collections.abc import Sequence
from enum import Enum
from typing import Final, NamedTuple, Self

import msgspec

from drivers.errors import Refused

MODE_NAMES: Final = ("basic", "pinch", "wide", "scissor")
BASIC: Final = 0
SCISSOR: Final = 3
SET_BASIC_MODE: Final = "`grasp gripper activate`, with an empty hand, sets basic mode"
SCISSOR_NOTE: Final = "; it is in scissor mode: B and C are spread apart too"


def check_not_scissor(mode: int) -> None:
    """Raises Refused in scissor mode: fingers B and C close on each other, and no guard limits
    that. In this mode only opening is commanded."""
    if mode == SCISSOR:
        raise Refused(
            "the hand is in scissor mode, in which it may only be opened",
            f"support the object, run `grasp release`; then {SET_BASIC_MODE}",
        )


def mode_warning(mode: int) -> str:
    """Warning for a hand that is not in basic mode; empty in basic mode."""
    if mode == BASIC:
        return ""
    return (
        f"in {MODE_NAMES[mode]} mode: positions, forces and calibrations here apply to basic mode"
    )


REGISTERS: Final = 8
BYTES: Final = 2 * REGISTERS
MA_PER_CURRENT_COUNT: Final = 10  # manual p. 67: 0x0F shown as 150 mA
FULL_BYTE: Final = 255

_WORDS: Final = struct.Struct(">8H")

Registers = tuple[int, ...]


class RegisterLink(NamedTuple):
    """First register of the command and status blocks on one kind of link (manual p. 59, 75)."""

    command_register: int
    status_register: int


TCP: Final = RegisterLink(command_register=0x0000, status_register=0x0000)
RTU: Final = RegisterLink(command_register=0x03E8, status_register=0x07D0)


def to_registers(data: bytes) -> Registers:
    """Eight registers from 16 bytes, even byte high."""
    if len(data) != BYTES:
        raise ValueError(f"{len(data)} bytes, need {BYTES}")
    return _WORDS.unpack(data)


def to_bytes(registers: Sequence[int]) -> bytes:
    """16 bytes from eight registers, even byte high."""
    try:
        return _WORDS.pack(*registers)
    except (struct.error, TypeError) as error:
        raise ValueError(f"not {REGISTERS} registers of 16 bits") from error


class AxisCommand(msgspec.Struct, frozen=True):
    """Request for one axis (rPR, rSP, rFR). Speed and force 0 are the minimum, not zero."""

    position: int = 0
    speed: int = 0
    force: int = 0

    def __post_init__(self) -> None:
        values = self.position, self.speed, self.force
        if min(values) < 0 or max(values) > FULL_BYTE:
            raise ValueError(f"{self}: position, speed and force need 0 to {FULL_BYTE}")


class CommandRegisters(msgspec.Struct, frozen=True, kw_only=True):
    """Registers written to the gripper. The comment of each field is its name in the manual."""

    activate: bool = False  # rACT: must be set first and stay set; clearing it resets
    mode: int = 0  # rMOD: 0 basic, 1 pinch, 2 wide, 3 scissor
    go_to: bool = False  # rGTO
    individual_fingers: bool = False  # rICF: fingers B and C obey their own bytes
    individual_scissor: bool = False  # rICS
    a: AxisCommand = AxisCommand()  # all fingers unless individual_fingers
    b: AxisCommand = AxisCommand()
    c: AxisCommand = AxisCommand()
    scissor: AxisCommand = AxisCommand()

    def __post_init__(self) -> None:
        if not 0 <= self.mode <= SCISSOR:
            raise ValueError(f"mode = {self.mode}, need 0 to {SCISSOR}")

    @property
    def axes(self) -> tuple[AxisCommand, AxisCommand, AxisCommand, AxisCommand]:
        return self.a, self.b, self.c, self.scissor

    def to_bytes(self) -> bytes:
        action = self.activate | self.mode << 1 | self.go_to << 3  # rATR, bit 4, is never set
        options = self.individual_fingers << 2 | self.individual_scissor << 3
        a, b, c, scissor = map(msgspec.structs.astuple, self.axes)
        return bytes((action, options, 0, *a, *b, *c, *scissor, 0))

    def to_registers(self) -> Registers:
        return to_registers(self.to_bytes())


class AxisStatus(msgspec.Struct, frozen=True):
    """Status of one axis: gPR echo, gPO position, gCU current (10 mA a count), gDT detection."""

    echo: int = 0
    position: int = 0
    current: int = 0
    detection: int = 0

    @property
    def current_ma(self) -> int:
        return self.current * MA_PER_CURRENT_COUNT


class StatusRegisters(msgspec.Struct, frozen=True, kw_only=True):
    """Registers read from the gripper. The comment of each field is its name in the manual."""

    active: bool = False  # gACT
    mode: int = 0  # gMOD
    go_to: bool = False  # gGTO: 0 also during activation, mode change and auto-release
    initialization: int = 0  # gIMC: 0 reset, 1 activating, 2 mode change, 3 ready
    stopped: int = 0  # gSTA: 0 moving, 1 some stopped short, 2 all short, 3 all at target
    fault: int = 0  # gFLT, low nibble; the high nibble is unspecified for this hand
    a: AxisStatus = AxisStatus()
    b: AxisStatus = AxisStatus()
    c: AxisStatus = AxisStatus()
    scissor: AxisStatus = AxisStatus()

    @property
    def fingers(self) -> tuple[AxisStatus, AxisStatus, AxisStatus]:
        return self.a, self.b, self.c

    @property
    def ready(self) -> bool:
        """Activated, and no activation or mode change is under way (byte 0 & 0x31 = 0x31)."""
        return self.active and self.initialization == 3

    @property
    def zeros_note(self) -> str:
        """Note for a status of zeros; empty for any other."""
        zeros = self == StatusRegisters()
        return "; every register is 0: other devices may answer the same" if zeros else ""

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        if len(data) != BYTES:
            raise ValueError(f"{len(data)} bytes, need {BYTES}")
        state, detections = data[0], data[1]
        return cls(
            active=bool(state & 1),
            mode=state >> 1 & 3,
            go_to=bool(state & 8),
            initialization=state >> 4 & 3,
            stopped=state >> 6,
            fault=data[2] & 0x0F,
            a=AxisStatus(data[3], data[4], data[5], detections & 3),
            b=AxisStatus(data[6], data[7], data[8], detections >> 2 & 3),
            c=AxisStatus(data[9], data[10], data[11], detections >> 4 & 3),
            scissor=AxisStatus(data[12], data[13], data[14], detections >> 6),
        )

    @classmethod
    def from_registers(cls, registers: Sequence[int]) -> Self:
        return cls.from_bytes(to_bytes(registers))


class Severity(Enum):
    """Severity of a fault as the gripper ranks it (manual, GRIPPER STATUS / gFLT)."""

    NONE = "none"
    PRIORITY = "priority"  # an action waits; the fault clears by itself
    MINOR = "minor"
    MAJOR = "major"  # motion has stopped; a reset is required


class FaultCode(msgspec.Struct, frozen=True):
    """Fault code with its meaning and remedy."""

    code: int
    severity: Severity
    text: str
    remedy: str


_RESET: Final = (
    "empty the hand and activate it again (`grasp gripper activate`); switch it off and on if it "
    "holds something"
)
_KNOWN: Final = {
    0x00: (Severity.NONE, "", ""),
    0x05: (Severity.PRIORITY, "action delayed: activation must complete first", "wait"),
    0x06: (Severity.PRIORITY, "action delayed: mode change must complete first", "wait"),
    0x07: (
        Severity.PRIORITY,
        "rACT is not set: the hand lost power, or another client cleared it",
        "activate",
    ),
    0x09: (Severity.MINOR, "communication chip not ready, may be booting", "wait"),
    0x0A: (Severity.MINOR, "mode change: scissor interference, below 20 s", "free the hand"),
    0x0B: (Severity.MINOR, "automatic release in progress", "wait until it is open"),
    0x0D: (Severity.MAJOR, "activation fault: interference or other error", _RESET),
    0x0E: (Severity.MAJOR, "mode change: scissor interference, above 20 s", _RESET),
    0x0F: (Severity.MAJOR, "automatic release completed: activation required", _RESET),
}


def _fault(code: int) -> FaultCode:
    unknown = Severity.MINOR, f"unknown fault 0x{code:02X}", "consult the manual"
    return FaultCode(code, *_KNOWN.get(code, unknown))


FAULTS: Final = tuple(_fault(code) for code in range(16))


# Text of a status, and its plausibility. Source: the manual's GRIPPER STATUS registers, 2014
# p. 44-57.

AXES: Final = ("A", "B", "C", "scissor")
MAX_CURRENT_MA: Final = 2000  # of a finger's motor; assumed: the worked examples show 80 to 160 mA
JUMP_TOLERANCE_COUNTS: Final = 8  # error of a position that was read late; assumed

_INITIALIZATION = ("reset", "activation is under way", "the mode is being changed", "ready")
_STOPPED = (
    "the fingers move", "stopped, some short of their targets",
    "stopped, all short of their targets", "all at their targets",
)  # fmt: skip
_DETECTION = (
    "moves", "stopped on contact while opening",
    "stopped on contact while closing", "at its target",
)  # fmt: skip
_MOVES: Final = 0  # of gSTA and gDT: "only meaningful if gGTO = 1"
_STANDBY: Final = "standby, activation, mode change or automatic release"
_NO_MEANING: Final = "no meaning while gGTO is 0"


def status_lines(status: StatusRegisters) -> list[str]:
    """Text of a status, one line for each field and axis."""
    fault = FAULTS[status.fault]
    fault_text = f"{fault.text} ({fault.severity.value})" if fault.text else "no fault"
    axes = zip(AXES, (*status.fingers, status.scissor), strict=True)
    return [
        f"gACT {status.active:d}: {'activated' if status.active else 'not activated'}",
        f"gMOD {status.mode}: {MODE_NAMES[status.mode]} mode",
        f"gGTO {status.go_to:d}: {'goes to the requested positions' if status.go_to else _STANDBY}",
        f"gIMC {status.initialization}: {_INITIALIZATION[status.initialization]}",
        f"gSTA {status.stopped}: {_motion_text(_STOPPED, status.stopped, status)}",
        f"gFLT 0x{status.fault:02X}: {fault_text}",
        *(_axis_line(name, axis, status) for name, axis in axes),
    ]


def _motion_text(texts: tuple[str, ...], value: int, status: StatusRegisters) -> str:
    return _NO_MEANING if value == _MOVES and not status.go_to else texts[value]


def _axis_line(name: str, axis: AxisStatus, status: StatusRegisters) -> str:
    axis_name = name if name == AXES[-1] else f"finger {name}"
    return (
        f"{axis_name}: at {axis.position} counts, requested {axis.echo}, {axis.current_ma} mA, "
        f"{_motion_text(_DETECTION, axis.detection, status)} (gDT {axis.detection})"
    )


def implausible_values(status: StatusRegisters, before: StatusRegisters) -> list[str]:
    """Values of two statuses, read shortly after each other, that no 3-Finger hand reports."""
    found = []
    if not status.active and (status.go_to or status.initialization in (2, 3)):
        found.append("it reports that it is not activated and yet obeys commands")
    if FAULTS[status.fault].text.startswith("unknown"):
        found.append(FAULTS[status.fault].text)
    for name, axis, was in zip(AXES, status.fingers, before.fingers, strict=False):
        if axis.current_ma > MAX_CURRENT_MA:
            found.append(f"finger {name} draws {axis.current_ma} mA, more than {MAX_CURRENT_MA}")
        if axis.position == FULL_BYTE:
            found.append(f"finger {name} is at {FULL_BYTE} counts, beyond its mechanical end")
        jumped = abs(axis.position - was.position) > JUMP_TOLERANCE_COUNTS
        if jumped and _stationary(status) and _stationary(before):
            moved = f"from {was.position} to {axis.position} counts"
            found.append(f"finger {name} moved {moved} and is reported as stopped")
    return found


def _stationary(status: StatusRegisters) -> bool:
    return status.initialization not in (1, 2) and (not status.go_to or status.stopped != 0)
