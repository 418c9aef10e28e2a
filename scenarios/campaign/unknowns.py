"""What nobody knows of the paper's set-up, drawn together over stated ranges.

A Latin hypercube (McKay, Beckman and Conover 1979): with n draws each of the n equal parts of every
range is visited once. The same file gives the same draws.
"""

import math
from collections.abc import Mapping
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from scenarios.campaign.config import RunConfig

SEED = 20_22


class Unknown(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Range of one setting, or of a factor on what the object's file says of it."""

    low: float
    high: float
    times: Annotated[bool, Meta(description="low and high are factors on the setting")] = False
    log: Annotated[bool, Meta(description="drawn evenly in its logarithm")] = False
    also: Annotated[
        tuple[str, ...], Meta(description="settings that take the same value or factor")
    ] = ()

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"low {self.low:g} is not below high {self.high:g}")
        if self.log and self.low <= 0.0:
            raise ValueError(f"low {self.low:g} has no logarithm")

    def at(self, part: float) -> float:
        """The value at a part from 0 to 1 of the range."""
        if self.log:
            return self.low * math.exp(part * math.log(self.high / self.low))
        return self.low + part * (self.high - self.low)

    def words(self, key: str, value: float, base: RunConfig) -> list[str]:
        """Assignments, section.key=value, that give it this value in place of ``base``'s."""
        return [f"{each}={value * self._own(each, base):g}" for each in (key, *self.also)]

    def _own(self, key: str, base: RunConfig) -> float:
        if not self.times:
            return 1.0
        section, _, field = key.partition(".")
        value = getattr(getattr(base, section, None), field, None)
        return float(value) if isinstance(value, int | float) else 1.0  # no setting: refused later


def latin_hypercube(unknowns: Mapping[str, Unknown], draws: int) -> list[dict[str, float]]:
    """Values of every unknown in each draw."""
    rng = np.random.default_rng(SEED)
    parts = {key: (rng.permutation(draws) + rng.uniform(size=draws)) / draws for key in unknowns}
    return [
        {key: round(unknowns[key].at(float(parts[key][i])), 6) for key in unknowns}
        for i in range(draws)
    ]
