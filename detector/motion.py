"""How a fingertip moves over what it touches, as the heads of a network tell it."""

import msgspec

SECTORS = 8
SECTOR_DEG = 360 // SECTORS


class Motion(msgspec.Struct, frozen=True):
    """Of each fingertip, mean of the last 50 ms; worth something while it slips."""

    speed_mps: list[float]
    direction_deg: list[int]  # one of eight, from the fingertip's x to its y
    turning: list[float]  # probability that it turns more than it slides

    @property
    def hand_mps(self) -> float:
        """One speed for all: in the middle of what the fingers tell."""
        return sorted(self.speed_mps)[len(self.speed_mps) // 2]
