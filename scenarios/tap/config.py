"""Settings of a tap: the mallet, and the hand that swings it."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from scenarios.trial.config import TrialConfig


class TapSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One tap. The search for the impulse follows the paper (section V-B): hard enough to move the
    object, too weak to knock it out."""

    # alternate: even seeds on top, odd ones on the side, across the closing axis; closing: along
    # it, onto the thumb, which the paper did not try
    direction: Literal["top", "side", "alternate", "closing"] = "alternate"
    aim_m: Annotated[float, Meta(ge=0.001, le=0.03, description="m that the tape mark moves")] = (
        0.007  # assumed, 2-20 mm
    )
    impulse_n_s: Annotated[float, Meta(ge=0.0, le=2.0, description="N s; 0: searched")] = 0.0
    spread: Annotated[float, Meta(ge=0.0, le=0.5, description="of the hand, relative")] = 0.2
    side_offset_m: Annotated[float, Meta(ge=-0.2, le=0.3, description="above the grip")] = 0.04
    duration_s: Annotated[float, Meta(ge=0.001, le=0.05, description="of the impact")] = 0.008
    follow_fraction: Annotated[float, Meta(ge=0.0, le=0.5, description="of the impulse")] = 0.1
    follow_s: Annotated[float, Meta(ge=0.001, le=0.2, description="s of follow-through")] = 0.03


class TapConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one tap."""

    tap: TapSettings = TapSettings()

    def direction(self, seed: int) -> str:
        """Of the tap with that seed."""
        if self.tap.direction != "alternate":
            return self.tap.direction
        return "top" if seed % 2 == 0 else "side"

    def scene(self, seed: int) -> str:
        return self.direction(seed)
