"""SetDown: from the top of the lift to where the hand lets go.

How far an object slipped is not known, so neither is how high the arm is when it stands. Closed
fingers that slide down over an object that stands and widens are driven apart, and feel it.
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
ARRIVED = "arm where the lift began"
CONTACT_GAP_NS = 100_000_000  # in it an object falls 5 cm, and may be gripped where it landed
MARGIN_M = 0.003  # for slip that ended by itself before a detector noticed; assumed
RISE_N = 0.3  # of the grip that stops the arm; seven deviations of it in the simulated hand's rest
STILL_NS = 500_000_000  # the arm stands before a step and after it: several swings of the pads
CHECK_N = 0.08  # change of the grip by a step where the object stands; three of those deviations
STEP_M = 5e-4  # down, to see whether the object stands; assumed
SHORTEST_M = 2e-4  # of such a step
CERTAIN = 3  # times CHECK_N is what a step aims at
MOST_SHARE = 0.15  # of the least grip, tighter in all; a textured face makes less of it in sliding
TRIES = 8  # inconclusive steps


class Transition(msgspec.Struct, frozen=True):
    """Out of a state: the trigger, why, and what is asked for with it."""

    trigger: Trigger
    cause: str
    commands: tuple[Command, ...] = ()


LOST_ON_THE_WAY = Transition(Trigger.LOSE, "contact lost on the way down")


class Step(Enum):
    """Of the state `lower.feel`, one after the other and from the start again."""

    CREEP = auto()  # slowly down to where the lift began
    SETTLE = auto()  # the grip has tightened on the way: the arm stops, the pads relax
    PROBE = auto()  # one small step down: an object that stands tightens the grip again


class SetDown:
    """States `lower.descend` and `lower.feel`; `lost` where what the hand holds may stand and
    it is not known where.

    What is remembered: how high the arm was when slip was last in progress, what the grip was when
    the arm last began to go down and the least that it was so, where it tightened last and how
    often, where the hand opened.
    """

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
        self._stood_n: list[float] = []  # grip of samples of the arm standing
        self._slipped_m = 0.0
        self._grip_n = 0.0
        self._least_n = math.inf
        self._tight_m = 0.0
        self._touches = 0
        self._let_go_m = 0.0

    @property
    def clear_m(self) -> float:
        """Height of the arm clear of what was set down."""
        return self._let_go_m + self._settings.retreat_m

    def slipping(self, obs: Observation) -> None:
        """On the way up: slip is in progress now."""
        self._slipped_m = self._line.height_m(obs)

    def begin(self, cause: str) -> Transition:
        """Down to where the lift began, unless the object may be elsewhere in the hand: it fell and
        was gripped again higher up, and a closed hand would be driven down along it."""
        gap_ns = self._contact.estimate.longest_gap_ns
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
            arrived = self._line.stands_at(obs, 0.0)
            return self._let_go(obs, ARRIVED) if arrived else self._tightened(obs)
        grip_n = self._still_n(obs)
        if grip_n is None:
            return None
        self._stood_n.clear()
        return self._probe(obs, grip_n) if self._step is Step.SETTLE else self._judge(obs, grip_n)

    @property
    def arm_stop(self) -> StopArm | None:
        """The stop with which the present step began; None where the arm goes on."""
        stops = self._step is Step.SETTLE
        return StopArm(self._settings.stop_deceleration_mps2) if stops else None

    def _still_n(self, obs: Observation) -> float | None:
        """Grip while the arm stands, its mean over the second half of a time, so that what moves it
        has settled and the pads' restlessness is averaged out; None until then."""
        still_ns = self._clock.still_ns
        if still_ns is None:
            self._stood_n.clear()
            return None
        stood_ns = obs.t_ns - still_ns
        if stood_ns >= STILL_NS / 2:
            self._stood_n.append(thumb_n(obs))
        return sum(self._stood_n) / len(self._stood_n) if stood_ns >= STILL_NS else None

    @property
    def _near_m(self) -> float:
        """Higher than this no object stands: it rose with the hand from when slip had ended, so it
        has slipped no more than the arm had risen by then, which is all of that where the arm
        stopped while the object still stood; with a margin for what no detector noticed."""
        if self._slipped_m <= 0.0:
            return 0.0
        return min(self._slipped_m + MARGIN_M, self._settings.lift_height_m)

    def _take_grip(self) -> None:
        self._grip_n = self._contact.estimate.grip_n
        self._least_n = min(self._least_n, self._grip_n)

    def _tightened(self, obs: Observation) -> Transition | None:
        """The grip tightens where closed fingers slide down over a flank that widens."""
        rise_n = self._contact.estimate.grip_n - self._grip_n
        if rise_n < RISE_N:
            return None
        self._step = Step.SETTLE
        self._touches += 1
        self._tight_m = self._line.height_m(obs)
        self._stood_n.clear()
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
        speed_mps = max(self._settings.landing_speed_mps, in_time_mps)
        return Transition(Trigger.FEEL, cause, (self._line.down(0.0, speed_mps),))

    def _probe(self, obs: Observation, grip_n: float) -> Transition:
        self._step = Step.PROBE
        height_m = self._line.height_m(obs)
        step_m = self._step_m(self._tight_m - height_m, grip_n - self._grip_n)
        self._grip_n = grip_n
        step = self._line.down(height_m - step_m, self._settings.landing_speed_mps)
        return Transition(Trigger.FEEL, "the arm has stood for long enough", (step,))

    def _step_m(self, braking_m: float, rise_n: float) -> float:
        """As short as is conclusive, where the grip went on tightening while the arm braked."""
        if braking_m <= 0.0 or rise_n <= RISE_N:
            return STEP_M
        conclusive_m = CERTAIN * CHECK_N * braking_m / (rise_n - RISE_N)
        return min(max(conclusive_m, SHORTEST_M), STEP_M)

    def _judge(self, obs: Observation, grip_n: float) -> Transition:
        """A grip in the air takes no notice of a step down; where it does, the object stands: a
        flank tightens it, a textured face may loosen it, and it stays tight; but not where none can
        stand: codes that drift tighten a grip, too. One that has tightened much, though no step
        was conclusive, goes no further."""
        rise_n = grip_n - self._grip_n
        tight = grip_n - self._least_n >= RISE_N
        high = self._line.height_m(obs) > self._near_m + AT_HEIGHT_M
        stands = rise_n >= CHECK_N or (tight and -rise_n >= CHECK_N)
        if stands and not high:
            return self._let_go(obs, f"a step down changed the grip by {rise_n:+.1f} N: it stands")
        if self._touches >= TRIES or grip_n >= (1 + MOST_SHARE) * self._least_n:
            unsure = "the grip tightens, and it is not certain that the object stands"
            return Transition(Trigger.LOSE, unsure)
        loose = "a step down did not tighten the grip"
        if high:
            return self._quickly("no object can stand yet" if stands else loose)
        return self._slowly(obs, loose)

    def _let_go(self, obs: Observation, cause: str) -> Transition:
        self._let_go_m = self._line.height_m(obs)
        return Transition(Trigger.STANDS, cause, (OpenFingers(self._settings.approach_speed_mps),))
