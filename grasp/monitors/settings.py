"""When a device is no longer believed. What is not here is a constant beside its check."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

Data = dict[str, float | str] | None  # what a check found, by the fields of its message


class MonitorSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of the plausibility checks. "measured": docs/faults.md."""

    mode: Annotated[
        Literal["stop", "report"],
        Meta(description="report: what would have stopped a run is recorded and shown only, as for "
             "first slow days with an empty hand; lost links, stale data, a device's own fault and "
             "the force guard stop it all the same"),
    ] = "stop"  # fmt: skip
    frozen_samples: Annotated[
        int, Meta(ge=2, le=1000, description="repeats in a row of all codes of a loaded hand; "
                  "measured: at most 3 by chance")
    ] = 8  # fmt: skip
    stuck_samples: Annotated[
        int, Meta(ge=10, le=10000, description="repeats in a row after which a taxel is stuck; "
                  "assumed: at 0.3 counts of noise it comes by chance once in a day")
    ] = 100  # fmt: skip
    jump_counts: Annotated[
        int, Meta(ge=5, le=1023, description="by which all taxels change one way from one sample "
                  "to the next; measured: contact and taps leave some nearly as they were")
    ] = 40  # fmt: skip
    detector_s: Annotated[
        float, Meta(ge=0.01, le=10.0, description="a step, its detector above all, may take; "
                    "assumed, five times the paper's 0.021 s")
    ] = 0.1  # fmt: skip
    standstill_s: Annotated[
        float, Meta(ge=0.02, le=10.0, description="a step may begin later than it should; assumed, "
                    "half of the shortest standstill that has been seen to lose an object")
    ] = 0.15  # fmt: skip
    echo_s: Annotated[
        float, Meta(ge=0.03, le=10.0, description="until the gripper's status speaks of a command; "
                    "assumed: two exchanges and two register refreshes are 0.04 s")
    ] = 0.15  # fmt: skip
    finger_start_s: Annotated[
        float, Meta(ge=0.05, le=10.0, description="a finger that reports motion may keep its "
                    "count; assumed: latency up to 0.15 s, two refreshes, lag, a count")
    ] = 0.3  # fmt: skip
    arm_start_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="from a command until the arm moves, and that it "
                    "may keep its place while told to move; assumed")
    ] = 0.25  # fmt: skip
