"""Register bytes written by hand, compared with the driver's codec and with the model's.

Worked frames: Robotiq 3-Finger manual, 2014, p. 67-74; layout: its register map, p. 39-57.
"""

import msgspec
import pytest

from drivers.robotiq.model import hand as model
from drivers.robotiq.protocol import (
    AxisCommand,
    AxisStatus,
    CommandRegisters,
    StatusRegisters,
)

# gACT, gMOD, gGTO, gIMC, gSTA, gFLT; gPR, gPO, gCU, gDT of A, B, C and scissor
STATUS = {
    "moving after close": (
        "39C0 00FF 080F 0008 1000 080F 0089 0000",
        (1, 0, 1, 3, 0, 0),
        ((255, 8, 15, 0), (0, 8, 16, 0), (0, 8, 15, 0), (0, 137, 0, 3)),
    ),
    "grip done": (
        "B9EA 00FF BC00 00C1 0000 BD00 0089 0000",
        (1, 0, 1, 3, 2, 0),
        ((255, 188, 0, 2), (0, 193, 0, 2), (0, 189, 0, 2), (0, 137, 0, 3)),
    ),
    "opening": (
        "39C0 0000 B80B 00BD 0E00 BA0B 0089 0000",
        (1, 0, 1, 3, 0, 0),
        ((0, 184, 11, 0), (0, 189, 14, 0), (0, 186, 11, 0), (0, 137, 0, 3)),
    ),
    "open done": (
        "F9FF 0000 0700 0006 0000 0600 0089 0000",
        (1, 0, 1, 3, 3, 0),
        ((0, 7, 0, 3), (0, 6, 0, 3), (0, 6, 0, 3), (0, 137, 0, 3)),
    ),
    "activating": ("1100" + 14 * "00", (1, 0, 0, 1, 0, 0), 4 * ((0, 0, 0, 0),)),
    "ready": ("3100" + 14 * "00", (1, 0, 0, 3, 0, 0), 4 * ((0, 0, 0, 0),)),
    # no frame of the manual: every byte another value, by its register map
    "all different": (
        "65 E4 0D 10 11 12 13 14 15 16 17 18 19 1A 1B 00",
        (1, 2, 0, 2, 1, 13),
        ((16, 17, 18, 0), (19, 20, 21, 1), (22, 23, 24, 2), (25, 26, 27, 3)),
    ),
}
# rACT, rMOD, rGTO, rICF, rICS; rPR, rSP, rFR of A, B, C and scissor
NONE = 4 * ((0, 0, 0),)
COMMANDS = {
    "reset": (32 * "0", (0, 0, 0, 0, 0), NONE),
    "activate": ("01" + 30 * "0", (1, 0, 0, 0, 0), NONE),
    "close": ("090000FFFFFF" + 20 * "0", (1, 0, 1, 0, 0), ((255, 255, 255), *NONE[1:])),
    "mode": ("06" + 30 * "0", (0, 3, 0, 0, 0), NONE),
    "individual fingers": ("0004" + 28 * "0", (0, 0, 0, 1, 0), NONE),
    "individual scissor": ("0008" + 28 * "0", (0, 0, 0, 0, 1), NONE),
    "all different": (
        "0D 0C 00 10 11 12 13 14 15 16 17 18 19 1A 1B 00",
        (1, 2, 1, 1, 1),
        ((16, 17, 18), (19, 20, 21), (22, 23, 24), (25, 26, 27)),
    ),
}


def words(text: str) -> tuple[int, ...]:
    data = bytes.fromhex(text)
    return tuple(256 * high + low for high, low in zip(data[::2], data[1::2], strict=True))


def axes_of(status: StatusRegisters) -> tuple[AxisStatus, ...]:
    return *status.fingers, status.scissor


def test_the_driver_reads_a_status_frame() -> None:
    for name, (frame, head, axes) in STATUS.items():
        read = StatusRegisters.from_registers(words(frame))
        assert msgspec.structs.astuple(read)[:6] == head, name
        assert tuple(map(msgspec.structs.astuple, axes_of(read))) == axes, name


def test_the_model_makes_a_status_frame() -> None:
    for name, (frame, head, axes) in STATUS.items():
        a, b, c, scissor = (model.AxisStatus(*axis) for axis in axes)
        assert model.encode(model.HandStatus(*head, (a, b, c, scissor))) == words(frame), name


def test_the_driver_makes_a_command_frame() -> None:
    for name, (frame, head, axes) in COMMANDS.items():
        names = CommandRegisters.__struct_fields__[:5]
        a, b, c, scissor = (AxisCommand(*axis) for axis in axes)
        made = CommandRegisters(
            **dict(zip(names, head, strict=True)), a=a, b=b, c=c, scissor=scissor
        )
        assert made.to_registers() == words(frame), name


def test_the_model_reads_a_command_frame() -> None:
    for name, (frame, head, axes) in COMMANDS.items():
        read = model.decode(words(frame))
        assert msgspec.structs.astuple(read)[:5] == head, name
        assert tuple(map(msgspec.structs.astuple, (*read.fingers, read.scissor))) == axes, name


def test_invalid_registers_are_not_written() -> None:
    for values in [(), (0,) * 9, (-1,), (65536,), ("x",)]:
        with pytest.raises(ValueError, match="register"):
            model.written(8 * (0,), 0, values)
        with pytest.raises(ValueError, match="do not exist"):
            model.written(8 * (0,), 7, (0, 0))
