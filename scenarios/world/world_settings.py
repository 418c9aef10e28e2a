"""At which contact level a run is computed."""

from enum import IntEnum
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

LevelName = Literal["L1", "L3", "L4"]


class Level(IntEnum):
    """From the cheapest to the reference. POINTS is that of a study: it costs what SPIN does."""

    SLIDER = 1
    POINTS = 2
    SPIN = 3
    BRUSH = 4

    @property
    def label(self) -> str:
        """As a setting names it."""
        return f"L{int(self)}"


def level_named(label: LevelName) -> Level:
    """The level that a setting names."""
    return Level(int(label[1:]))


class ContactLevels(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Level and longest step, and those while a tap moves the object."""

    level: LevelName
    step_s: Annotated[float, Meta(gt=0.0)]
    blow_level: LevelName
    blow_step_s: Annotated[float, Meta(gt=0.0)]

    def __post_init__(self) -> None:
        if self.blow_level < self.level:
            raise ValueError(f"blow_level: {self.blow_level} is less than level, {self.level}")


class ContactTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`config/contact_levels.toml`: levels of a lift, of a tap by its direction, and
    the least of any run whose object has its weight aside or is pulled."""

    lift: ContactLevels
    top: ContactLevels
    side: ContactLevels
    closing: ContactLevels
    aside: ContactLevels
    pull: ContactLevels


class WorldSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contact levels in place of those that `config/contact_levels.toml` has for a run."""

    level: Annotated[
        Literal["auto", "L1", "L3", "L4"],
        Meta(description="auto: by scenario; L1 where no scenario is known"),
    ] = "auto"
    blow_level: Annotated[
        Literal["auto", "L1", "L3", "L4"],
        Meta(
            description="while a tap moves the object, never less than level; auto: as level, and "
            "where that is auto, by scenario; L4 where none is known"
        ),
    ] = "auto"

    def __post_init__(self) -> None:
        if "auto" not in (self.level, self.blow_level) and self.blow_level < self.level:
            raise ValueError(f"blow_level: {self.blow_level} is less than level, {self.level}")
