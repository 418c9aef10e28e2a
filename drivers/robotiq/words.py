"""The status registers in a person's words, and what in them cannot be. Source: the manual's
GRIPPER STATUS registers, 2014 p. 44-57."""

from typing import Final

from drivers.robotiq.protocol import FAULTS, FULL_BYTE, AxisStatus, StatusRegisters
from drivers.robotiq.protocol import NAMES as MODES

NAMES: Final = ("A", "B", "C", "scissor")
MOST_MA: Final = 2000  # of a finger's motor; assumed: the worked examples show 80 to 160 mA
LEAP_COUNTS: Final = 8  # that a finger which stands may seem to move between two looks; assumed

_INITIALIZATION = ("reset", "activation is under way", "the mode is being changed", "ready")
_STOPPED = (
    "the fingers move",
    "stopped, some short of what was asked",
    "stopped, all short of what was asked",
    "all where they were told to be",
)
_DETECTION = (
    "moves", "stopped on contact while opening",
    "stopped on contact while closing", "where it was told to be",
)  # fmt: skip
_MOVES: Final = 0  # of gSTA and gDT: "only meaningful if gGTO = 1"
_STAND_BY: Final = "stands by, activates, changes its mode or releases"
_NOT_SAID: Final = "says nothing while gGTO is 0"


def lines(status: StatusRegisters) -> list[str]:
    """Every register, a line each."""
    fault = FAULTS[status.fault]
    told = f"{fault.text} ({fault.severity.value})" if fault.text else "no fault"
    axes = zip(NAMES, (*status.fingers, status.scissor), strict=True)
    return [
        f"gACT {status.active:d}: {'activated' if status.active else 'not activated'}",
        f"gMOD {status.mode}: {MODES[status.mode]} mode",
        f"gGTO {status.go_to:d}: {'obeys positions' if status.go_to else _STAND_BY}",
        f"gIMC {status.initialization}: {_INITIALIZATION[status.initialization]}",
        f"gSTA {status.stopped}: {_said(_STOPPED, status.stopped, status)}",
        f"gFLT 0x{status.fault:02X}: {told}",
        *(_axis(name, axis, status) for name, axis in axes),
    ]


def _said(texts: tuple[str, ...], value: int, status: StatusRegisters) -> str:
    return _NOT_SAID if value == _MOVES and not status.go_to else texts[value]


def _axis(name: str, axis: AxisStatus, status: StatusRegisters) -> str:
    who = name if name == NAMES[-1] else f"finger {name}"
    return (
        f"{who}: at {axis.position} counts, told {axis.echo}, {axis.current_ma} mA, "
        f"{_said(_DETECTION, axis.detection, status)} (gDT {axis.detection})"
    )


def doubts(status: StatusRegisters, before: StatusRegisters) -> list[str]:
    """What no 3-Finger hand says, in two looks a moment apart; empty where nothing is strange."""
    found = []
    if not status.active and (status.go_to or status.initialization in (2, 3)):
        found.append("it says that it is not activated, and that it obeys")
    if FAULTS[status.fault].text.startswith("unknown"):
        found.append(FAULTS[status.fault].text)
    for name, axis, was in zip(NAMES, status.fingers, before.fingers, strict=False):
        if axis.current_ma > MOST_MA:
            found.append(f"finger {name} draws {axis.current_ma} mA, more than {MOST_MA}")
        if axis.position == FULL_BYTE:
            found.append(f"finger {name} is at {FULL_BYTE} counts, beyond its mechanical end")
        if _stands(status) and _stands(before) and abs(axis.position - was.position) > LEAP_COUNTS:
            found.append(
                f"finger {name} went from {was.position} to {axis.position} counts and is said to "
                "stand"
            )
    return found


def _stands(status: StatusRegisters) -> bool:
    return status.initialization not in (1, 2) and (not status.go_to or status.stopped != 0)
