"""Fields of the hand's status words, to change one at a time, and the meaning of a command.

From the manual's register map (2014, p. 39-57), independent of the driver's code.
"""

from collections.abc import Sequence

import msgspec

Words = Sequence[int]


class Field(msgspec.Struct, frozen=True):
    """Some bits of one of the eight words."""

    word: int
    shift: int
    bits: int

    @property
    def most(self) -> int:
        return (1 << self.bits) - 1

    def of(self, words: Words) -> int:
        return words[self.word] >> self.shift & self.most

    def set(self, words: Words, value: int) -> tuple[int, ...]:
        kept = words[self.word] & ~(self.most << self.shift)
        changed = kept | (value & self.most) << self.shift
        return (*words[: self.word], changed, *words[self.word + 1 :])


FIELDS = {
    "gACT": Field(0, 8, 1), "gMOD": Field(0, 9, 2), "gGTO": Field(0, 11, 1),
    "gIMC": Field(0, 12, 2), "gSTA": Field(0, 14, 2), "gDTA": Field(0, 0, 2),
    "gDTB": Field(0, 2, 2), "gDTC": Field(0, 4, 2), "gDTS": Field(0, 6, 2),
    "gFLT": Field(1, 8, 4),
    "gPRA": Field(1, 0, 8), "gPOA": Field(2, 8, 8), "gCUA": Field(2, 0, 8),
    "gPRB": Field(3, 8, 8), "gPOB": Field(3, 0, 8), "gCUB": Field(4, 8, 8),
    "gPRC": Field(4, 0, 8), "gPOC": Field(5, 8, 8), "gCUC": Field(5, 0, 8),
    "gPRS": Field(6, 8, 8), "gPOS": Field(6, 0, 8), "gCUS": Field(7, 8, 8),
}  # fmt: skip
# fields of a command
COMMAND_FIELDS = {
    "rACT": Field(0, 8, 1), "rMOD": Field(0, 9, 2), "rGTO": Field(0, 11, 1),
    "rATR": Field(0, 12, 1), "rICF": Field(0, 2, 1), "rICS": Field(0, 3, 1),
    "rPRA": Field(1, 0, 8), "rSPA": Field(2, 8, 8), "rFRA": Field(2, 0, 8),
    "rPRB": Field(3, 8, 8), "rSPB": Field(3, 0, 8), "rFRB": Field(4, 8, 8),
    "rPRC": Field(4, 0, 8), "rSPC": Field(5, 8, 8), "rFRC": Field(5, 0, 8),
    "rPRS": Field(6, 8, 8), "rSPS": Field(6, 0, 8), "rFRS": Field(7, 8, 8),
}  # fmt: skip
# all fingers at once (rICF 0): opened, or closed with full force
IMAGES = {"opened": (0x0900, 0, 0, 0, 0, 0, 0, 0), "closed": (0x0900, 0xFF, 0xFFFF, 0, 0, 0, 0, 0)}
_OFF = 5  # counts
_JUMP = 90  # counts, or as many steps of 10 mA
_BESIDE = 2  # counts between target and position of a finger that holds
_OPEN_STOP = 6  # counts at the mechanical stop: lower targets have no effect
_RESERVED_FAULT, _WORST_FAULT = 0x01, 0x0E


def wrong(name: str, kind: str, value: int) -> int:
    """The wrong value of a field for a kind of fault: a jump, an offset or out of range."""
    field = FIELDS[name]
    if name == "gFLT":
        return _WORST_FAULT if kind == "close" else _RESERVED_FAULT
    if kind == "out of range":
        return field.most
    if kind == "some off":
        return value + _OFF
    return value + _JUMP if field.bits == 8 else value + 1  # the field keeps what fits


def verb(first: int, words: Words, here: Sequence[int]) -> str:
    """The command in a write of words from ``first`` on: hold, open or close. ``here``: positions
    of the fingers, counts. Speed and force of zero may be a hold or the lowest setting; the target
    decides."""
    whole = [0] * first + list(words)
    code = b"".join(word.to_bytes(2, "big") for word in whole)
    axes = [code[at : at + 3] for at in (3, 6, 9)]  # position, speed, force
    if first == 0 and not code[0] & 0b1000:  # a write without the first word leaves it as it is
        return "hold"
    least = all(speed == 0 and force == 0 for _, speed, force in axes)
    distances = [axis[0] - at for axis, at in zip(axes, here, strict=True)]
    if least and all(map(_stays, (axis[0] for axis in axes), here)):
        return "hold"
    if max(distances) > _BESIDE:
        return "close"
    # a finger that holds may rest beside its target
    return "open" if min(distances) < -_BESIDE or max(distances) <= 0 else "close"


def _stays(target: int, at: int) -> bool:
    return abs(max(target, _OPEN_STOP) - max(at, _OPEN_STOP)) <= _BESIDE
