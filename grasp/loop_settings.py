"""Pace of the control loop (`grasp.loop`), and how long it waits for an end."""

from typing import Annotated

import msgspec
from msgspec import Meta

from drivers.interfaces import PERIOD_S

STOP_S = 20.0  # a run that was stopped may last, should its safe state not end it; assumed


class LoopSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Pace of the loop."""

    period_s: Annotated[
        float, Meta(ge=0.002, le=0.1, description="one tactile sample (paper: 100 Hz)")
    ] = PERIOD_S
    decision_delay_s: Annotated[
        float, Meta(ge=0.0, le=0.5, description="virtual time that a decision takes; default: p50 "
                    "with `energy`; the paper's inference takes 0.021 s")
    ] = 0.00002  # fmt: skip
    deadline_s: Annotated[
        float, Meta(ge=1.0, le=3600.0, description="a run may last, whatever its states; assumed")
    ] = 180.0
