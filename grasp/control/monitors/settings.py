"""Settings of the plausibility checks. Other limits are constants in the checks' modules."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

FLIPS, FLIPS_NS = 8, 1_000_000_000  # most changes of a report in that time; assumed
Fields = dict[str, float | str]  # of a failed check's message
Failures = dict[str, Fields]  # the failed checks by their codes, in the order of ``CHECKS``


class MonitorSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of the plausibility checks (docs/troubleshooting.md). Computer and links decide."""

    mode: Annotated[
        Literal["stop", "report"],
        Meta(description="stop: implausible data ends the run; report: it is shown and recorded"),
    ] = "stop"
    jump_counts: Annotated[
        int, Meta(ge=5, le=1023, description="jump of all taxels that is implausible; measured")
    ] = 40
    # five times the paper's inference of 0.021 s
    detector_s: Annotated[
        float, Meta(ge=0.01, le=10.0, description="longest computing time of a step")
    ] = 0.1
    # half of the shortest standstill that lost an object
    standstill_s: Annotated[
        float, Meta(ge=0.02, le=10.0, description="longest delay of a step's start")
    ] = 0.15
    # two exchanges and two register refreshes are 0.04 s
    echo_s: Annotated[
        float,
        Meta(
            ge=0.03, le=10.0, description="longest time until the gripper's status shows a command"
        ),
    ] = 0.15
    # latency up to 0.15 s, two refreshes, lag, a count
    finger_start_s: Annotated[
        float,
        Meta(
            ge=0.05, le=10.0, description="longest time that a finger in motion keeps its position"
        ),
    ] = 0.3
    arm_start_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="longest time from a command until the arm moves")
    ] = 0.25


def too_often(changes_ns: list[int], now_ns: int) -> bool:
    """Whether a report has changed more often than start, end and settling of a motion explain:
    more than ``FLIPS`` times in ``FLIPS_NS``."""
    return sum(now_ns - at_ns <= FLIPS_NS for at_ns in changes_ns) > FLIPS
