"""Stiffness of a contact, as the thumb's motor feels it: newtons into counts of closing."""

import math

import msgspec


class Stiffness(msgspec.Struct, frozen=True):
    """Rise of the thumb's force a count that it closes further, N."""

    newtons_per_count: float

    def counts_within(self, rise_n: float) -> int:
        """Most whole counts of closing that raise the force by no more than this; none below 0."""
        return max(0, math.floor(rise_n / self.newtons_per_count))
