"""When a device is no longer believed. What is not here is a constant beside its check."""

from collections.abc import Iterable
from itertools import compress
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from drivers.interfaces import FINGER_NAMES

FLIPS, FLIPS_NS = 8, 1_000_000_000  # most changes of a report in that time; assumed
Data = dict[str, float | str] | None  # what a check found, by the fields of its message


class MonitorSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of the plausibility checks (docs/force-limit.md); computer and links decide them."""

    mode: Annotated[
        Literal["stop", "report"],
        Meta(description="report: implausible data is recorded and shown, and ends no run"),
    ] = "stop"
    jump_counts: Annotated[
        int, Meta(ge=5, le=1023, description="all taxels change one way by; measured")
    ] = 40
    # five times the paper's inference of 0.021 s
    detector_s: Annotated[float, Meta(ge=0.01, le=10.0, description="a step may take")] = 0.1
    # half of the shortest standstill that has been seen to lose an object
    standstill_s: Annotated[float, Meta(ge=0.02, le=10.0, description="a step may be late")] = 0.15
    # two exchanges and two register refreshes are 0.04 s
    echo_s: Annotated[
        float, Meta(ge=0.03, le=10.0, description="until the gripper speaks of a command")
    ] = 0.15
    # latency up to 0.15 s, two refreshes, lag, a count
    finger_start_s: Annotated[
        float, Meta(ge=0.05, le=10.0, description="a finger that reports motion keeps its count")
    ] = 0.3
    arm_start_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="from a command until the arm moves")
    ] = 0.25


def named(fingers: Iterable[object]) -> Data:
    """Which fingers a check has found; None: none."""
    found = ", ".join(compress(FINGER_NAMES, fingers))
    return {"finger": found} if found else None


def too_often(changes_ns: Iterable[int], now_ns: int) -> bool:
    """What is commanded once begins, ends and may settle, but does not change for ever."""
    return sum(now_ns - at_ns <= FLIPS_NS for at_ns in changes_ns) > FLIPS
