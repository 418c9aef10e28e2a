"""A blow on the object: the same in a stated scene, in a cell and over a cell's control channel."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta


class Blow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One tap of a mallet: a half-sine pulse, then a longer one while the hand follows through.

    ``top`` strikes downwards, ``side`` across the closing axis, ``closing`` along it, onto the
    thumb. Struck ``delay_s`` from now.
    """

    impulse_n_s: Annotated[float, Meta(ge=0.0, le=15.0, description="assumed, 0.08-0.45 N s")]
    duration_s: Annotated[float, Meta(gt=0.0, le=0.2, description="assumed, 2-16 ms")]
    direction: Literal["top", "side", "closing"] = "top"
    offset_m: Annotated[
        float,
        Meta(
            ge=-0.5, le=0.5,
            description="from the grip's middle: beside it for a blow on the top, above it for one "
            "on the side",
        ),
    ] = 0.0  # fmt: skip
    follow_n_s: Annotated[float, Meta(ge=0.0, le=15.0)] = 0.0
    follow_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    delay_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0

    def __post_init__(self) -> None:
        if self.follow_n_s > 0.0 and self.follow_s == 0.0:
            raise ValueError("follow_n_s: a hand follows through for some time: follow_s > 0")
