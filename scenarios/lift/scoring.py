"""Result and verdict of a lift, from the simulated truth and the controller's actions.

Success as in the paper (section V-C): slip correctly detected and compensated, object stably
grasped and lifted. For long objects the distance between first and final grasp counts.
"""

import math
from enum import StrEnum

import msgspec

from scenarios.trial.operator_prompts import TapeMark
from scenarios.trial.result import TrialResult
from scenarios.world.objects import GraspObject
from scenarios.world.settings import GROSS_SLIP_MPS, GROSS_TURN_RADPS
from scenarios.world.truth import Truth

NEAR_M, FAR_M = 0.06, 0.12  # of a long object's slip (paper, table IV)
EARLY_S = 0.05  # registered this long before gross slip is no false start; assumed
LEAST_GRIP_N = 0.5  # without a simulation: below this estimated force the object is lost; assumed
SMALL_M = 0.001  # by touch, less slip than this that is not registered is no failure
TURNED_RAD = math.radians(20.0)  # an object that turned by more is not held as it was gripped
LIFTED_M = 0.005  # the object must be this far off the table at the end; assumed


class LiftOutcome(StrEnum):
    """Outcomes of a lift; the first three are successes, the last two are no verdict."""

    HELD_WITHIN_6CM = "held_within_6cm"
    HELD_WITHIN_12CM = "held_within_12cm"
    HELD = "held"
    BEYOND_12CM = "beyond_12cm"
    TURNED = "turned"
    CRUSHED = "crushed"
    DROPPED = "dropped"
    EXPELLED = "expelled"
    NEVER_SLIPPED = "never_slipped"
    UNDETECTED = "undetected"
    FALSE_START = "false_start"
    LIMIT_REACHED = "limit_reached"
    ALARM_STAYED = "alarm_stayed"
    OVER_FORCE = "over_force"
    FAULT = "fault"
    INTERRUPTED = "interrupted"  # no verdict
    INTERNAL_ERROR = "internal_error"  # no verdict


SUCCESSES = frozenset({LiftOutcome.HELD_WITHIN_6CM, LiftOutcome.HELD_WITHIN_12CM, LiftOutcome.HELD})


class LiftResult(TrialResult, frozen=True, kw_only=True):
    """Verdict of one lift; docs/data-formats.md explains each outcome. ``alarm_stayed``: slip was
    registered at the end of the hold, even where another rule decided the outcome."""

    first_detection_s: float | None
    reaction_latency_ms: float | None
    slip_distance_m: float | None
    turned_rad: float | None  # in the hand, about the closing axis; None without a simulation
    over_least: float | None  # the thumb's force then, over the least that holds the object
    settled_force_n: dict[str, float] | None
    alarm_stayed: bool


class LiftFacts(msgspec.Struct, frozen=True):
    """Input of the verdict; times in seconds since the run began.

    ``end``: truth at the last instant before lowering, None without simulation.
    ``mark``: the operator's reading at the top, None without an operator.
    ``open_loop_onset_s``: onset of gross slip in the open-loop run, None without slip.
    """

    end: Truth | None
    estimated_n: float  # of the most loaded finger then: the only sign of a held object on hardware
    had_compensated: bool
    registered_s: float | None
    onset_s: float | None
    open_loop_onset_s: float | None
    peak_force_n: float | None
    force_bound_n: float
    limit_reached: bool  # set down because slip was still registered at the force limit
    alarm_stayed: bool  # slip was registered at the end of a hold that waits for it to stop
    fault: str
    mark: TapeMark | None = None
    by_touch: bool = False  # the first force was chosen to hold: neither slip nor an alarm is due
    contact_lost: bool = False  # the run ended in `lost`, without contact of any finger
    lost_at_m: float = 0.0  # greatest height at which the hand lost the object; 0: none, or unknown


def outcome(facts: LiftFacts, body: GraspObject) -> LiftOutcome:
    """The verdict: the first rule that applies, worst first."""
    if facts.peak_force_n is not None and facts.peak_force_n > facts.force_bound_n:
        return LiftOutcome.OVER_FORCE
    if facts.fault:
        return LiftOutcome.FAULT
    early = facts.registered_s is not None and false_start(facts)
    if early and not facts.by_touch:
        return LiftOutcome.FALSE_START
    failed = _not_held(facts) or _spoiled(facts, body)
    if failed is not None:
        return failed
    if facts.registered_s is None:
        slipped = facts.onset_s is not None or (facts.mark is not None and facts.mark.moved_m > 0.0)
        if slipped and not (facts.by_touch and (slip_distance_m(facts) or 0.0) < SMALL_M):
            return LiftOutcome.UNDETECTED
        if not facts.by_touch:
            return LiftOutcome.NEVER_SLIPPED
    return _held(slip_distance_m(facts), body)


def slip_distance_m(facts: LiftFacts) -> float | None:
    """Distance between first and final grasp, m: simulated truth or the operator's reading."""
    if facts.end is not None:
        return facts.end.slip_distance_m
    return facts.mark.moved_m if facts.mark is not None and facts.mark.held else None


def _not_held(facts: LiftFacts) -> LiftOutcome | None:
    """Why the object is not held, if so; on hardware by reading, contact and estimated force."""
    end = facts.end
    if end is None:
        if facts.contact_lost or (facts.mark is not None and not facts.mark.held):
            return LiftOutcome.DROPPED
        if facts.limit_reached:
            return LiftOutcome.LIMIT_REACHED
        return LiftOutcome.DROPPED if facts.estimated_n < LEAST_GRIP_N else None
    if not end.touched:
        expelled = facts.had_compensated and end.flank_slope < 0.0
        return LiftOutcome.EXPELLED if expelled else LiftOutcome.DROPPED
    if facts.lost_at_m >= LIFTED_M:  # held at the top, then lost while lowering
        return LiftOutcome.DROPPED
    if _at_rest_in_the_air(end):
        alarm = facts.limit_reached or facts.alarm_stayed
        return LiftOutcome.ALARM_STAYED if alarm else None
    return LiftOutcome.LIMIT_REACHED if facts.limit_reached else LiftOutcome.DROPPED


def _spoiled(facts: LiftFacts, body: GraspObject) -> LiftOutcome | None:
    """Why an object that is held is not as it was."""
    if body.crush_n is not None and (facts.peak_force_n or 0.0) > body.crush_n:
        return LiftOutcome.CRUSHED
    turned = facts.end is not None and abs(facts.end.turn_rad) > TURNED_RAD
    return LiftOutcome.TURNED if turned else None


def _at_rest_in_the_air(end: Truth) -> bool:
    still = abs(end.slip_speed_mps) < GROSS_SLIP_MPS
    return end.height_m >= LIFTED_M and still and abs(end.turn_speed_radps) < GROSS_TURN_RADPS


def _held(slip_m: float | None, body: GraspObject) -> LiftOutcome:
    if not body.long_body or slip_m is None:
        return LiftOutcome.HELD
    if slip_m <= NEAR_M:
        return LiftOutcome.HELD_WITHIN_6CM
    return LiftOutcome.HELD_WITHIN_12CM if slip_m <= FAR_M else LiftOutcome.BEYOND_12CM


def false_start(facts: LiftFacts) -> bool:
    """Whether slip was registered although nothing had slipped, or would soon without reaction."""
    if facts.registered_s is None:
        return False
    if facts.end is None:  # only a simulation knows the onset
        return False
    latest = facts.registered_s + EARLY_S
    onsets = (facts.onset_s, facts.open_loop_onset_s)
    return not any(onset is not None and onset <= latest for onset in onsets)
