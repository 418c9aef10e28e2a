"""How much physics a run is asked for, and gets."""

from enum import IntEnum
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

AUTO = "auto"


class Level(IntEnum):
    """The rungs, from the cheapest to the reference."""

    RIGID = 0
    SLIDER = 1
    POINTS = 2
    SPIN = 3
    BRUSH = 4

    @property
    def label(self) -> str:
        """As a setting names it."""
        return f"L{int(self)}"


def level_named(label: str) -> Level:
    """The level that a setting names."""
    return Level(int(label[1:]))


class WorldSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Level of the contact ladder, or how exactly it must answer."""

    level: Annotated[
        Literal["auto", "L0", "L1", "L2", "L3", "L4"],
        Meta(
            description="of the contact ladder; auto: the cheapest that keeps the tolerance in "
            "every corner of a lift or tap, L1 where no scene is known"
        ),
    ] = "auto"
    blow_level: Annotated[
        Literal["same", "L0", "L1", "L2", "L3", "L4"],
        Meta(
            description="while a blow moves the object, no less than level; same: as level, and "
            "where that is auto, the cheapest that keeps the tolerance"
        ),
    ] = "same"
    tolerance: Annotated[
        float,
        Meta(
            gt=1e-6,
            le=0.1,
            description="m, on slip distance, and on rotation by the lever of the paper's label "
            "(3 mm/s over 0.2 rad/s); a sample of 10 ms at 0.1 m/s",
        ),
    ] = 1e-3
    force_tolerance_n: Annotated[
        float, Meta(gt=0.0, le=10.0, description="on the peak force of a finger; assumed")
    ] = 0.2

    def __post_init__(self) -> None:
        before = Level.SLIDER if self.forced is None else self.forced  # auto never takes less
        if self.from_blow_on is not None and self.from_blow_on < before:
            raise ValueError(f"blow_level: {self.blow_level} is less than level, {self.level}")

    @property
    def forced(self) -> Level | None:
        """The level that was asked for by name."""
        return None if self.level == AUTO else level_named(self.level)

    @property
    def from_blow_on(self) -> Level | None:
        """The level of a blow; None: nobody said."""
        return None if self.blow_level == "same" else level_named(self.blow_level)


class RunPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What the cell of a run is built at, and why. ``asked``, ``blow_asked``: as the settings say
    it, auto and same where nobody told a level."""

    level: str
    step_s: float
    blow_level: str  # while a blow moves the object
    blow_step_s: float
    asked: str
    blow_asked: str = "same"
    tolerance_m: float
    tolerance_rad: float
    tolerance_n: float  # on the peak force of a finger
    why: tuple[str, ...] = ()  # of the corners that decided, in the planner's words
