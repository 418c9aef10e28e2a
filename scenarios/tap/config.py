"""Settings of the mallet tap."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from scenarios.trial.config import TrialConfig


class TapSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One tap. The search for the impulse follows the paper (section V-B): hard enough to move the
    object, too weak to knock it out."""

    # side: across the closing axis; closing: along that axis, onto the thumb (not in the paper)
    direction: Annotated[
        Literal["top", "side", "alternate", "closing"],
        Meta(description="where the mallet strikes; alternate: even seeds top, odd seeds side"),
    ] = "alternate"
    aim_m: Annotated[
        float, Meta(ge=0.001, le=0.03, description="m of displacement by the searched impulse")
    ] = 0.007  # assumed, 2-20 mm
    impulse_n_s: Annotated[
        float, Meta(ge=0.0, le=2.0, description="N s, impulse of the tap; 0: searched")
    ] = 0.0
    spread: Annotated[
        float, Meta(ge=0.0, le=0.5, description="relative standard deviation of the impulse")
    ] = 0.2
    side_offset_m: Annotated[
        float, Meta(ge=-0.2, le=0.3, description="m, height of a side tap above the grip")
    ] = 0.04
    duration_s: Annotated[
        float, Meta(ge=0.001, le=0.05, description="s, duration of the impact")
    ] = 0.008
    follow_fraction: Annotated[
        float, Meta(ge=0.0, le=0.5, description="follow-through's share of the tap's impulse")
    ] = 0.1
    follow_s: Annotated[
        float, Meta(ge=0.001, le=0.2, description="s, duration of the follow-through")
    ] = 0.03


class TapConfig(TrialConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one tap."""

    tap: TapSettings = TapSettings()

    def direction(self, seed: int) -> str:
        """Direction of the tap with that seed."""
        if self.tap.direction != "alternate":
            return self.tap.direction
        return "top" if seed % 2 == 0 else "side"

    def scene(self, seed: int) -> str:
        return self.direction(seed)
