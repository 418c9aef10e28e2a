"""Settings and register codec of the modelled hand. No I/O, no time.

The codec follows the register map of the Robotiq 3-Finger manual (2014, p. 39-57) and is written
separately from the driver's, so that tests reveal a misplaced byte in either. Eight words of 16
bits go each way; byte 2n is the high half of word n, byte 2n + 1 its low half.
"""

from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, Literal

import msgspec
from msgspec import Meta

WORDS: Final = 8
FULL: Final = 255
MA_PER_COUNT: Final = 10  # of gCU; manual p. 67: 0x0F is 150 mA
MAX_FORCE_N: Final = 60.0  # true static force of byte 255; manual p. 47

Words = tuple[int, ...]

# First byte of a block of three: fingers A, B, C, then the scissor.
_BLOCKS: Final = (3, 6, 9, 12)


class HandSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Properties of the hand. "manual": Robotiq 3-Finger manual, 2014 or 2018; "assumed": no
    source."""

    m_per_count: ClassVar[float] = 0.00077  # fingertip travel of a motor count; Franchi TR711

    refresh_hz: Annotated[
        Literal[100, 200], Meta(description="Hz, update rate of the registers; manual p. 75")
    ] = 100
    tick_phase_s: float = 0.005  # offset of refresh ticks from time zero; random for each trial
    command_latency_s: Annotated[
        float, Meta(ge=0, le=0.15, description="s from a command's take-up to the motor; assumed")
    ] = 0.03
    activation_s: Annotated[
        float, Meta(ge=0, le=30, description="duration of activation, s; assumed")
    ] = 6.0
    tip_mass_kg: Annotated[
        float, Meta(ge=0.02, le=2, description="kg, moving mass at the tip, with motor; assumed")
    ] = 0.1
    least_force_n: Annotated[
        float, Meta(ge=1, le=30, description="N, true static force of force byte 0; Grover 2022")
    ] = 10.0
    force_exponent: Annotated[
        float, Meta(ge=0.3, le=3, description="exponent of true force over force byte; assumed")
    ] = 1.0
    current_clamp: Annotated[
        bool, Meta(description="motor current is limited before contact is detected, too; assumed")
    ] = True
    override_s: Annotated[
        float,
        Meta(ge=0, le=0.3, description="s at start without force limit; manual p. 47, assumed"),
    ] = 0.0
    override_n: Annotated[
        float, Meta(ge=0, le=80, description="N, force during override_s; assumed")
    ] = 30.0
    debounce_s: Annotated[
        float,
        Meta(ge=0.001, le=0.2, description="s from a finger's stall to reported contact; assumed"),
    ] = 0.03

    def force_n(self, byte: int) -> float:
        """True static force at which the motor of a finger stalls, N."""
        span = MAX_FORCE_N - self.least_force_n
        return float(self.least_force_n + span * (byte / FULL) ** self.force_exponent)


def speed_mps(byte: int) -> float:
    """Fingertip speed of a speed byte, m/s; manual, 22 to 110 mm/s."""
    return 0.022 + 0.000345 * byte


class Request(msgspec.Struct, frozen=True):
    """Request for one axis (rPR, rSP, rFR)."""

    position: int = 0
    speed: int = 0
    force: int = 0


class Command(msgspec.Struct, frozen=True):
    """The eight command words, decoded."""

    activate: bool  # rACT
    mode: int  # rMOD
    go_to: bool  # rGTO
    individual_fingers: bool  # rICF
    individual_scissor: bool  # rICS
    fingers: tuple[Request, Request, Request]
    scissor: Request


class AxisStatus(msgspec.Struct, frozen=True):
    """Status of one axis (gPR, gPO, gCU, gDT)."""

    echo: int
    position: int
    current: int
    detection: int


class HandStatus(msgspec.Struct, frozen=True):
    """The eight status words, before they are encoded."""

    active: bool  # gACT
    mode: int  # gMOD
    go_to: bool  # gGTO
    initialization: int  # gIMC
    stopped: int  # gSTA
    fault: int  # gFLT
    axes: Sequence[AxisStatus]  # A, B, C, scissor


def decode(words: Sequence[int]) -> Command:
    """Command from eight command words. Reserved bits are ignored."""
    action, options = words[0] >> 8, words[0] & 0xFF
    a, b, c, scissor = (Request(*(_byte(words, at + i) for i in range(3))) for at in _BLOCKS)
    return Command(
        activate=_bit(action, 0),
        mode=(action & 0b0000_0110) >> 1,
        go_to=_bit(action, 3),
        individual_fingers=_bit(options, 2),
        individual_scissor=_bit(options, 3),
        fingers=(a, b, c),
        scissor=scissor,
    )


def encode(hand: HandStatus) -> Words:
    """Eight status words from a status."""
    status = (hand.stopped << 6) + (hand.initialization << 4)
    status += (hand.go_to << 3) + (hand.mode << 1) + hand.active
    a, b, c, s = hand.axes
    detections = (s.detection << 6) + (c.detection << 4) + (b.detection << 2) + a.detection
    return (
        (status << 8) + detections,
        (hand.fault << 8) + a.echo,
        (a.position << 8) + a.current,
        (b.echo << 8) + b.position,
        (b.current << 8) + c.echo,
        (c.position << 8) + c.current,
        (s.echo << 8) + s.position,
        s.current << 8,
    )


def written(words: Words, first: int, values: Sequence[int]) -> Words:
    """Command words with some overwritten; raises ValueError for invalid addresses or values."""
    last = first + len(values)
    if not values or first < 0 or last > WORDS:
        raise ValueError(f"command registers {first} to {last - 1} do not exist")
    for value in values:
        if value not in range(1 << 16):
            raise ValueError(f"not registers of 16 bits: {list(values)}")
    return (*words[:first], *values, *words[last:])


def _byte(words: Sequence[int], n: int) -> int:
    word = words[n // 2]
    return word & 0xFF if n % 2 else word >> 8


def _bit(byte: int, n: int) -> bool:
    return bool(byte & 1 << n)
