"""Result and verdict of a tap, from the object's motion and the slip status.

Success as in the paper (section V-B): slip was registered after the object moved upon being
tapped, and the status returned to nominal after the object had stopped. The paper gives no times.
"""

from collections.abc import Sequence
from enum import StrEnum

import msgspec

from scenarios.trial.result import TrialResult

MOVED_M = 0.001  # a permanent displacement of this counts as moved
# or a rotation in the hand, with the lever of the paper's label: 3 mm/s over 0.2 rad/s
MOVED_RAD = MOVED_M / 0.015
REGISTER_S = 0.5  # from first motion until slip is registered; assumed
CLEAR_S = 1.0  # from the end of motion until the status is nominal; assumed
STAY_S = 0.5  # that the status then stays nominal; assumed


class Alarm(msgspec.Struct, frozen=True):
    """An interval of status REGISTERED; ``off_s`` None: until the end of the run."""

    on_s: float
    off_s: float | None


class TapResult(TrialResult, frozen=True, kw_only=True):
    """Verdict of one tap.

    Lengths in metres, relative to the fingertips, down and across the closing axis; ``turned_rad``
    about it. ``moved`` is False for a tap without displacement, which counts in no success rate. It
    is None where no tap was made, or the trial ended early."""

    direction: str
    moved: bool | None
    displacement_m: float | None
    down_m: float | None
    across_m: float | None
    turned_rad: float | None
    impulse_n_s: float | None
    mallet_mps: float | None
    impact_s: float | None
    slip_end_s: float | None
    slip_duration_ms: float | None
    nominal_again_s: float | None
    nominal_again_ms: float | None
    alarms: list[Alarm]
    watched_until_s: float | None
    grip_force_n: dict[str, float] | None

    @property
    def failed(self) -> bool:
        """Whether it failed; a tap without displacement did not."""
        return not (self.success or self.moved is False)

    @property
    def slip_distance_m(self) -> float | None:
        return self.displacement_m


class TapOutcome(StrEnum):
    """Outcomes of a tap: the first is the success, the next two are taps without displacement, the
    last two are no verdict."""

    REGISTERED = "registered"
    UNMOVED_QUIET = "unmoved_quiet"
    UNMOVED_REGISTERED = "unmoved_registered"
    UNDETECTED = "undetected"
    LATE = "late"
    ALARM_STAYED = "alarm_stayed"
    KNOCKED_OUT = "knocked_out"
    NEVER_NOMINAL = "never_nominal"
    OVER_FORCE = "over_force"
    FAULT = "fault"
    INTERRUPTED = "interrupted"  # no verdict
    INTERNAL_ERROR = "internal_error"  # no verdict


UNMOVED = frozenset({TapOutcome.UNMOVED_QUIET, TapOutcome.UNMOVED_REGISTERED})
NOT_TAPPED = frozenset(
    {TapOutcome.NEVER_NOMINAL, TapOutcome.FAULT, TapOutcome.INTERRUPTED, TapOutcome.INTERNAL_ERROR}
)


class ObjectMotion(msgspec.Struct, frozen=True, kw_only=True):
    """Motion of the object after an impact, by simulated truth or by fingertips and tape mark.

    Times in seconds; ``from_s`` and ``until_s``: gross slip, None where there was none.
    """

    impact_s: float
    from_s: float | None
    until_s: float | None
    displacement_m: float
    held: bool = True
    down_m: float | None = None
    across_m: float | None = None
    turned_rad: float | None = None  # None where it is not measured

    def moved(self) -> bool:
        """Whether displacement or rotation reach the thresholds of motion."""
        turned = self.turned_rad is not None and abs(self.turned_rad) >= MOVED_RAD
        return turned or self.displacement_m >= MOVED_M


class TapFacts(msgspec.Struct, frozen=True, kw_only=True):
    """Input of the verdict. ``motion`` is None where no tap was made."""

    motion: ObjectMotion | None
    alarms: Sequence[Alarm]
    watched_until_s: float
    peak_before_n: float | None  # true peak force before the impact, caused by the hand alone
    force_bound_n: float
    fault: str = ""


def verdict(facts: TapFacts) -> TapOutcome:
    """The verdict: the first rule that applies, worst first."""
    if facts.peak_before_n is not None and facts.peak_before_n > facts.force_bound_n:
        return TapOutcome.OVER_FORCE
    if facts.fault:
        return TapOutcome.FAULT
    motion = facts.motion
    if motion is None:
        return TapOutcome.NEVER_NOMINAL
    if not motion.held:
        return TapOutcome.KNOCKED_OUT
    registered_s = registered_after(facts.alarms, motion.impact_s)
    if not motion.moved():
        quiet = registered_s is None
        return TapOutcome.UNMOVED_QUIET if quiet else TapOutcome.UNMOVED_REGISTERED
    if registered_s is None:
        return TapOutcome.UNDETECTED
    return _timely(facts, motion, registered_s)


def _timely(facts: TapFacts, motion: ObjectMotion, registered_s: float) -> TapOutcome:
    if registered_s > first_motion_s(motion) + REGISTER_S:
        return TapOutcome.LATE
    end_s = last_motion_s(motion)
    again_s = nominal_again_s(facts, end_s)
    if again_s is None or again_s > end_s + CLEAR_S:
        return TapOutcome.ALARM_STAYED
    return TapOutcome.REGISTERED


def first_motion_s(motion: ObjectMotion) -> float:
    """First instant of gross slip; the impact where the motion was creep only."""
    return motion.impact_s if motion.from_s is None else motion.from_s


def last_motion_s(motion: ObjectMotion) -> float:
    """Last instant of gross slip; the impact where the motion was creep only."""
    return motion.impact_s if motion.until_s is None else motion.until_s


def registered_after(alarms: Sequence[Alarm], t_s: float) -> float | None:
    """First registration at or after that time."""
    return next((alarm.on_s for alarm in alarms if alarm.on_s >= t_s), None)


def nominal_again_s(facts: TapFacts, since_s: float) -> float | None:
    """First time from ``since_s`` on at which the status is nominal and stays so for STAY_S;
    None if it never did, or was not watched for long enough."""
    t_s = since_s
    for alarm in facts.alarms:
        if alarm.off_s is not None and alarm.off_s <= t_s:
            continue
        if alarm.on_s >= t_s + STAY_S:
            break
        if alarm.off_s is None:
            return None
        t_s = alarm.off_s
    return t_s if t_s + STAY_S <= facts.watched_until_s else None
