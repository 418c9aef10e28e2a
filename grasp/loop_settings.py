"""Pace of the control loop (`grasp.loop`), and how long it waits for an end."""

from typing import Annotated

import msgspec
from msgspec import Meta

from drivers.interfaces import PERIOD_S


class LoopSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Pace of the loop."""

    period_s: Annotated[
        float, Meta(ge=0.002, le=0.1, description="one tactile sample (paper: 100 Hz)")
    ] = PERIOD_S
    decision_delay_s: Annotated[
        float,
        Meta(
            ge=0.0,
            le=0.5,
            description="virtual time that a decision takes; default: p50 of frame "
            "to decision with `energy`, quiet; the paper's inference takes 0.021 s",
        ),
    ] = 0.00002
    deadline_s: Annotated[
        float,
        Meta(ge=1.0, le=3600.0, description="a run may last, whatever its phases may; assumed"),
    ] = 180.0
    stop_s: Annotated[
        float,
        Meta(
            ge=0.2, le=60.0,
            description="a run that was stopped may last, should its safe state not end it: more "
            "than the 3 s of a safe state; assumed",
        ),
    ] = 20.0  # fmt: skip
    abort_s: Annotated[
        float,
        Meta(ge=0.1, le=30.0, description="for arm and hand to stand after a bug of ours; assumed"),
    ] = 3.0
    abort_repeat_s: Annotated[
        float, Meta(ge=0.01, le=1.0, description="between two stops then; assumed")
    ] = 0.05
    spared_s: Annotated[
        float,
        Meta(
            ge=0.0, le=0.05,
            description="of a period, for those who watch, though an acknowledgement is late; "
            "assumed: 40 % of the shortest period lets a recorder write",
        ),
    ] = 0.002  # fmt: skip
