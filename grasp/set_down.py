"""SetDown: from the top of the lift down to where the object stands and the hand opens.

How far the object slipped is not known, so neither is the height of the arm at which it stands.
Where it does, closed fingers that slide down over a widening object are driven apart: the grip
tightens.
"""

import math
from enum import Enum, auto

import msgspec

from grasp.commands import Command, OpenFingers, StopArm
from grasp.contact_estimator import ContactEstimator, thumb_n
from grasp.controller_settings import ControllerSettings
from grasp.lift_progress import AT_HEIGHT_M, LiftLine, StateClock
from grasp.observation import Observation
from grasp.states import Trigger

CREEP_SHARE = 0.8  # of the time that a state may last
CONTACT_GAP_NS = 100_000_000  # an object falls 5 cm in it, and may be gripped where it landed
SLIP_MARGIN_M = 0.003  # for slip that ended by itself before a detector noticed; assumed
RISE_N = 0.3  # of the grip that stops the arm: 7 standard deviations in the simulated hand at rest
STILL_NS = 500_000_000  # that the arm stands before and after a step: several swings of the pads
CHECK_N = 0.08  # change of the grip by a step where the object stands: 3 such deviations
STEP_M = 5e-4  # down, to find out whether the object stands; assumed
SHORTEST_STEP_M = 2e-4
CERTAIN = 3  # times CHECK_N is the change that a step aims at
MOST_RISE = 0.15  # of the least grip, in all; a textured face that slides causes less
TRIES = 8  # inconclusive steps


class Transition(msgspec.Struct, frozen=True):
    """A change of state: the trigger, why, and the commands sent with it."""

    trigger: Trigger
    cause: str
    commands: tuple[Command, ...] = ()


LOST_ON_THE_WAY = Transition(Trigger.LOSE, "contact lost on the way down")


class Step(Enum):
    """Steps of the state `lower.feel`, repeated in this order."""

    CREEP = auto()  # slowly down to where the lift began
    SETTLE = auto()  # the grip has tightened: the arm stops, the pads relax
    PROBE = auto()  # one small step down: an object that stands tightens the grip again


class SetDown:
    """States `lower.descend` and `lower.feel`; ends in `lost` where the object may stand, but not
    certainly."""

    def __init__(
        self,
        settings: ControllerSettings,
        line: LiftLine,
        contact: ContactEstimator,
        clock: StateClock,
    ) -> None:
        self._settings = settings
        self._line = line
        self._contact = contact
        self._clock = clock
        self._step = Step.CREEP
        self._still_grips_n: list[float] = []  # samples while the arm stands
        self._slipped_m = 0.0  # height at which slip was last in progress
        self._grip_n = 0.0  # when the arm last began to go down
        self._least_n = math.inf  # least of these
        self._tight_m = 0.0  # height at which the grip tightened last
        self._touches = 0  # how often it has
        self._open_m = 0.0  # height at which the hand opens

    @property
    def clear_m(self) -> float:
        """Height of the arm clear of what was set down."""
        return self._open_m + self._settings.retreat_m

    def slipping(self, obs: Observation) -> None:
        """Slip is in progress now, on the way up."""
        self._slipped_m = self._line.height_m(obs)

    def begin(self, cause: str) -> Transition:
        """Down to where the lift began, unless the object may have fallen and been gripped again
        higher up: a closed hand would be driven down along it."""
        gap_ns = self._contact.longest_gap_ns
        if gap_ns >= CONTACT_GAP_NS:
            gap = f"nothing was felt for {gap_ns * 1e-9:.2f} s on the way"
            return Transition(Trigger.LOSE, f"{gap}: what the hand holds may stand on the table")
        return self._quickly(cause)

    def descend(self, obs: Observation) -> Transition | None:
        """Out of `lower.descend`; None while it goes on."""
        if self._contact.lost:
            return LOST_ON_THE_WAY
        if self._line.stands_at(obs, self._near_m):
            return self._slowly(obs, "from here on the object may stand")
        return self._tightened(obs)

    def feel(self, obs: Observation) -> Transition | None:
        """Out of `lower.feel`, or to its next step; None while that goes on."""
        if self._contact.lost:
            return LOST_ON_THE_WAY
        if self._step is Step.CREEP:
            if self._line.stands_at(obs, 0.0):
                return self._let_go(obs, "arm where the lift began")
            return self._tightened(obs)
        grip_n = self._still_n(obs)
        if grip_n is None:
            return None
        self._still_grips_n.clear()
        return self._probe(obs, grip_n) if self._step is Step.SETTLE else self._judge(obs, grip_n)

    @property
    def arm_stop(self) -> StopArm | None:
        """The stop with which the present step began; None where the arm goes on."""
        stops = self._step is Step.SETTLE
        return StopArm(self._settings.stop_deceleration_mps2) if stops else None

    def _still_n(self, obs: Observation) -> float | None:
        """Mean grip over the second half of ``STILL_NS`` while the arm stands; None until then."""
        still_ns = self._clock.still_ns
        if still_ns is None:
            self._still_grips_n.clear()
            return None
        stood_ns = obs.t_ns - still_ns
        if stood_ns >= STILL_NS / 2:
            self._still_grips_n.append(thumb_n(obs))
        return sum(self._still_grips_n) / len(self._still_grips_n) if stood_ns >= STILL_NS else None

    @property
    def _near_m(self) -> float:
        """Height above which no object can stand: it rose with the hand once slip had ended, so it
        has slipped no further than the arm had risen by then, and the margin."""
        if self._slipped_m <= 0.0:
            return 0.0
        return min(self._slipped_m + SLIP_MARGIN_M, self._settings.lift_height_m)

    def _take_grip(self) -> None:
        self._grip_n = self._contact.grip_n
        self._least_n = min(self._least_n, self._grip_n)

    def _tightened(self, obs: Observation) -> Transition | None:
        """The arm stops where the grip has tightened: the object may stand."""
        rise_n = self._contact.grip_n - self._grip_n
        if rise_n < RISE_N:
            return None
        self._step = Step.SETTLE
        self._touches += 1
        self._tight_m = self._line.height_m(obs)
        self._still_grips_n.clear()
        cause = f"the grip is {rise_n:.1f} N tighter on the way down"
        stop = StopArm(self._settings.stop_deceleration_mps2)
        return Transition(Trigger.FEEL, cause, (stop,))

    def _quickly(self, cause: str) -> Transition:
        self._take_grip()
        move = self._line.down(self._near_m, self._settings.lower_speed_mps)
        return Transition(Trigger.LOWER, cause, (move,))

    def _slowly(self, obs: Observation, cause: str) -> Transition:
        self._step = Step.CREEP
        self._take_grip()
        if self._line.stands_at(obs, 0.0):
            return Transition(Trigger.FEEL, cause)
        in_time_mps = self._line.height_m(obs) / (CREEP_SHARE * self._settings.phase_timeout_s)
        speed_mps = max(self._settings.feel_speed_mps, in_time_mps)
        return Transition(Trigger.FEEL, cause, (self._line.down(0.0, speed_mps),))

    def _probe(self, obs: Observation, grip_n: float) -> Transition:
        self._step = Step.PROBE
        height_m = self._line.height_m(obs)
        step_m = self._step_m(self._tight_m - height_m, grip_n - self._grip_n)
        self._grip_n = grip_n
        step = self._line.down(height_m - step_m, self._settings.feel_speed_mps)
        return Transition(Trigger.FEEL, "the arm has stood for long enough", (step,))

    def _step_m(self, braking_m: float, rise_n: float) -> float:
        """As short as is conclusive, by how much the grip tightened while the arm braked."""
        if braking_m <= 0.0 or rise_n <= RISE_N:
            return STEP_M
        conclusive_m = CERTAIN * CHECK_N * braking_m / (rise_n - RISE_N)
        return min(max(conclusive_m, SHORTEST_STEP_M), STEP_M)

    def _judge(self, obs: Observation, grip_n: float) -> Transition:
        """A step down changes the grip only where the object stands: a flank tightens it, a
        textured face may loosen a tight one. Too high for that, drifting codes are the cause. The
        arm goes no further where the grip has tightened much in all."""
        rise_n = grip_n - self._grip_n
        tight = grip_n - self._least_n >= RISE_N
        high = self._line.height_m(obs) > self._near_m + AT_HEIGHT_M
        stands = rise_n >= CHECK_N or (tight and -rise_n >= CHECK_N)
        if stands and not high:
            return self._let_go(obs, f"a step down changed the grip by {rise_n:+.1f} N: it stands")
        if self._touches >= TRIES or grip_n >= (1 + MOST_RISE) * self._least_n:
            unsure = "the grip tightens, and it is not certain that the object stands"
            return Transition(Trigger.LOSE, unsure)
        loose = "a step down did not tighten the grip"
        if high:
            return self._quickly("no object can stand yet" if stands else loose)
        return self._slowly(obs, loose)

    def _let_go(self, obs: Observation, cause: str) -> Transition:
        self._open_m = self._line.height_m(obs)
        return Transition(Trigger.STANDS, cause, (OpenFingers(self._settings.approach_speed_mps),))
