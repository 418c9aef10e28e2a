"""The result of a lift, and its verdict from what the world knows and the controller did.

Success as in the paper (section V-C): slip correctly detected and compensated, object stably
grasped and lifted; long objects are judged by the distance between first and final grasp.
"""

from enum import StrEnum

import msgspec

from scenarios.trial.person import TapeMark
from scenarios.trial.result import TrialResult
from scenarios.world.objects import GraspObject
from scenarios.world.settings import GROSS_SLIP_MPS, GROSS_TURN_RADPS
from scenarios.world.truth import Truth

NEAR_M, FAR_M = 0.06, 0.12  # of a long object's slip (paper, table IV)
EARLY_S = 0.05  # registered this long before gross slip is no false start; assumed
FELT_N = 0.5  # without a simulation: less than this is not held; assumed
LIFTED_M = 0.005  # the object must be this far off the table at the end; assumed


class LiftOutcome(StrEnum):
    """How a lift can end; the first three are successes, the last two are not judged."""

    HELD_WITHIN_6CM = "held_within_6cm"
    HELD_WITHIN_12CM = "held_within_12cm"
    HELD = "held"
    BEYOND_12CM = "beyond_12cm"
    DROPPED = "dropped"
    EXPELLED = "expelled"
    NEVER_SLIPPED = "never_slipped"
    UNDETECTED = "undetected"
    FALSE_START = "false_start"
    CAP_REACHED = "cap_reached"
    ALARM_STAYED = "alarm_stayed"
    OVER_FORCE = "over_force"
    FAULT = "fault"
    INTERRUPTED = "interrupted"  # not judged
    INTERNAL_ERROR = "internal_error"  # nor this


SUCCESSES = frozenset({LiftOutcome.HELD_WITHIN_6CM, LiftOutcome.HELD_WITHIN_12CM, LiftOutcome.HELD})


class LiftResult(TrialResult, frozen=True, kw_only=True):
    """Verdict of one lift; docs/data-formats.md explains each outcome. ``alarm_stayed``: slip was
    registered at the end of the hold, whether or not that decides the outcome."""

    first_detection_s: float | None
    reaction_latency_ms: float | None
    slip_distance_m: float | None
    turned_rad: float | None  # in the hand, about the closing axis; None without a simulation
    settled_force_n: dict[str, float] | None
    alarm_stayed: bool


class LiftFacts(msgspec.Struct, frozen=True):
    """What a verdict is drawn from; times in seconds since the run began.

    ``end``: truth at the last instant in the air (before setting down), None without simulation.
    ``mark``: what a person read at the top, None where nobody was asked.
    ``open_loop_onset_s``: onset of gross slip in the twin run, None where it never slipped.
    """

    end: Truth | None
    felt_n: float  # highest measured force at that instant: all that hardware knows of holding
    had_compensated: bool
    registered_s: float | None
    onset_s: float | None
    open_loop_onset_s: float | None
    peak_force_n: float | None
    force_bound_n: float
    cap_reached: bool  # set down because slip was still registered at the force cap
    alarm_stayed: bool  # slip was registered at the end of a hold that waits for it to stop
    fault: str
    mark: TapeMark | None = None
    let_go_m: float = 0.0  # the highest that the object was when the hand lost it; 0: nobody knows


def outcome(facts: LiftFacts, body: GraspObject) -> LiftOutcome:
    """The first rule that applies, worst first."""
    if facts.peak_force_n is not None and facts.peak_force_n > facts.force_bound_n:
        return LiftOutcome.OVER_FORCE
    if facts.fault:
        return LiftOutcome.FAULT
    if facts.registered_s is not None and false_start(facts):
        return LiftOutcome.FALSE_START
    failed = _not_held(facts)
    if failed is not None:
        return failed
    if facts.registered_s is None:
        slipped = facts.onset_s is not None or (facts.mark is not None and facts.mark.moved_m > 0.0)
        return LiftOutcome.UNDETECTED if slipped else LiftOutcome.NEVER_SLIPPED
    return _held(slip_distance_m(facts), body)


def slip_distance_m(facts: LiftFacts) -> float | None:
    """Between first and final grasp: as the world knows it, or as a person read it."""
    if facts.end is not None:
        return facts.end.slip_distance_m
    return facts.mark.moved_m if facts.mark is not None and facts.mark.held else None


def _not_held(facts: LiftFacts) -> LiftOutcome | None:
    """How the object was lost, if it was; on hardware the fingers' own feeling is all there is."""
    end = facts.end
    if end is None:
        if facts.mark is not None and not facts.mark.held:
            return LiftOutcome.DROPPED
        if facts.cap_reached:
            return LiftOutcome.CAP_REACHED
        return LiftOutcome.DROPPED if facts.felt_n < FELT_N else None
    if not end.touched:
        expelled = facts.had_compensated and end.flank_slope < 0.0
        return LiftOutcome.EXPELLED if expelled else LiftOutcome.DROPPED
    if facts.let_go_m >= LIFTED_M:  # held at the top, and not set down
        return LiftOutcome.DROPPED
    if _at_rest_in_the_air(end):
        alarm = facts.cap_reached or facts.alarm_stayed
        return LiftOutcome.ALARM_STAYED if alarm else None
    return LiftOutcome.CAP_REACHED if facts.cap_reached else LiftOutcome.DROPPED


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
    """Registered although, without reaction, nothing would have slipped by then or soon after."""
    if facts.registered_s is None:
        return False
    if facts.end is None:  # only a simulation knows the onset
        return False
    latest = facts.registered_s + EARLY_S
    onsets = (facts.onset_s, facts.open_loop_onset_s)
    return not any(onset is not None and onset <= latest for onset in onsets)
