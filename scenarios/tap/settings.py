"""What is assumed of the mallet, of the hand that swings it, and of the order of a tap trial."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta


class TapSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One tap. ``alternate``: even seeds on top, odd seeds on the side."""

    direction: Annotated[
        Literal["top", "side", "alternate", "closing"],
        Meta(
            description="top: down; side: across the closing axis; closing: along it, onto the "
            "thumb, a disturbance that the paper did not try"
        ),
    ] = "alternate"
    aim_m: Annotated[
        float,
        Meta(
            ge=0.001,
            le=0.03,
            description="the blow is searched that moves the tape mark this far: hard enough to "
            "move it, too weak to knock it out (paper, section V-B); assumed, 2-20 mm",
        ),
    ] = 0.007
    mark_height_m: Annotated[
        float, Meta(ge=0.0, le=0.3, description="of that mark, above the grip; assumed")
    ] = 0.05
    impulse_n_s: Annotated[
        float,
        Meta(
            ge=0.0,
            le=2.0,
            description="N s, in place of the search; 0: searched; assumed, 0.08-0.45",
        ),
    ] = 0.0
    strength: Annotated[
        float,
        Meta(
            ge=0.0,
            le=3.0,
            description="of that blow; at 0.2 it moves nothing, which tells what a detector makes "
            "of the blow itself",
        ),
    ] = 1.0
    spread: Annotated[
        float,
        Meta(ge=0.0, le=0.5, description="of the hand: relative deviation; assumed, 0.1-0.3"),
    ] = 0.2
    height_m: Annotated[
        float,
        Meta(
            ge=0.02,
            le=0.5,
            description="held this far above the table, further than a blow moves it; assumed",
        ),
    ] = 0.08
    top_offset_m: Annotated[
        float,
        Meta(ge=-0.1, le=0.1, description="where one on the top lands, beside the grip; assumed"),
    ] = 0.0
    side_offset_m: Annotated[
        float,
        Meta(
            ge=-0.2,
            le=0.3,
            description="where one on the side lands, above the grip, which the fingers surround; "
            "assumed, 20-60 mm",
        ),
    ] = 0.04
    offset_spread_m: Annotated[
        float,
        Meta(ge=0.0, le=0.05, description="deviation of where it lands; assumed, 2-10 mm"),
    ] = 0.005
    duration_s: Annotated[
        float, Meta(ge=0.001, le=0.05, description="of the impact, rubber; assumed, 4-16 ms")
    ] = 0.008
    follow_fraction: Annotated[
        float,
        Meta(ge=0.0, le=0.5, description="of the impulse that follows through; assumed, 0-0.2"),
    ] = 0.1
    follow_s: Annotated[
        float, Meta(ge=0.001, le=0.2, description="how long the hand does so; assumed, 20-60 ms")
    ] = 0.03
    mallet_kg: Annotated[
        float, Meta(gt=0.0, le=5.0, description="16 oz (paper); turns impulse into speed")
    ] = 0.454
    restitution: Annotated[
        float, Meta(ge=0.0, le=1.0, description="rubber on the object; assumed, 0.2-0.5")
    ] = 0.3
    nominal_s: Annotated[
        float, Meta(ge=0.0, le=10.0, description="status nominal for so long before a blow")
    ] = 0.5
    wait_s: Annotated[float, Meta(ge=0.0, le=10.0, description="and 0 to this longer, drawn")] = 0.3
    patience_s: Annotated[
        float, Meta(ge=0.1, le=600.0, description="to wait for that before the trial is given up")
    ] = 10.0
    watch_s: Annotated[
        float, Meta(ge=0.5, le=60.0, description="the status is watched so long after a blow")
    ] = 3.0
    felt_factor: Annotated[
        float,
        Meta(
            ge=1.0,
            le=50.0,
            description="hardware: the blow is the first change of counts this many times the "
            "largest before it; assumed",
        ),
    ] = 3.0
    motion_bound_s: Annotated[
        float,
        Meta(
            ge=0.0,
            le=1.0,
            description="hardware: motion has ended this long after the blow was felt; slip "
            "lasts 13-140 ms in a reduced model",
        ),
    ] = 0.15


class TapScoringSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Windows of the verdict."""

    moved_m: Annotated[
        float, Meta(gt=0, le=0.1, description="a permanent displacement of this counts as moved")
    ] = 0.001
    turned_rad: Annotated[
        float,
        Meta(
            gt=0,
            le=3.2,
            description="or rotation in the hand: moved_m by the lever of the paper's label, "
            "3 mm/s over 0.2 rad/s",
        ),
    ] = 0.001 / 0.015
    register_s: Annotated[
        float, Meta(gt=0, le=5, description="slip is registered within, from first motion; assumed")
    ] = 0.5
    clear_s: Annotated[
        float, Meta(gt=0, le=10, description="status nominal within, from the end of motion")
    ] = 1.0
    stay_s: Annotated[float, Meta(ge=0, le=10, description="and stays nominal for; assumed")] = 0.5
