"""Close: the interface of slip responses, and the response that only closes the hand.

A closing to the force cap has one stage or two. The first of two is a fast motion to a position at
which the limit holds even on a stiffer contact with a stronger first grasp than stated
(``ForceGuard.safe_travel``). It lasts about as long as the delay of a command, so it needs no
feedback. The second starts at rest and closes to the cap at the hand's least speed, so that
momentum causes little overshoot.
"""

from drivers.interfaces import Counts3, Detection
from grasp.commands import CloseFast, Command, StopArm
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.lift_line import LiftLine
from grasp.observation import Observation

CLOSED_COUNTS: Counts3 = (255, 255, 255)
ALL_FINGERS = (True, True, True)
TOP_UP_SPEED_MPS = 0.022  # of a second stage: the gripper's least (manual)
STAGE_NS = 500_000_000  # longest wait for the end of a first stage


class SlipResponse:
    """The hand closes to the force cap while the arm continues (the paper's loop). Base class.

    One object for a run: ``begin`` when slip is registered or contact is lost, ``update`` every
    sample until ``end``. No method commands a device.

    ``closings``: number of closings. ``paused_s``: total time for which the arm was stopped.
    ``adds_margin``: the current response adds a safety margin instead of responding to slip.
    """

    def __init__(self, settings: ControllerSettings, plan: GripPlan, line: LiftLine) -> None:
        self._settings = settings
        self._plan = plan
        self._line = line
        self._first_stage_ns: int | None = None  # since when a first stage has been requested
        self.closings = 0
        self.paused_s = 0.0
        self.adds_margin = False

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        """The first commands. ``rising``: the arm moves up. ``lost``: contact is lost."""
        return self._close(obs, lost)

    def follow_up(self, obs: Observation, rising: bool) -> tuple[Command, ...]:
        """Commands that add a safety margin of force after slip has ended; empty if none is due."""
        return ()

    @property
    def arm_stop(self) -> StopArm | None:
        """The stop with which the response began; None if the arm continues."""
        return None

    def update(self, obs: Observation, alarm: bool, elapsed_ns: int) -> None:
        """Take one sample, ``elapsed_ns`` after the last. ``alarm``: slip may not be over."""

    @property
    def exhausted(self) -> bool:
        """Whether the response has no option left while slip recurs."""
        return False

    def over(self, obs: Observation) -> bool:
        """Whether the response may end now that slip is no longer registered."""
        return True

    def escalate(self, obs: Observation, waited_ns: int) -> tuple[Command, ...] | None:
        """Further commands when slip has continued for ``waited_ns``; None if there are none."""
        return None

    def end(self) -> tuple[Command, ...]:
        """Commands with which the arm continues."""
        return ()

    def _close(self, obs: Observation, lost: bool = False) -> tuple[Command, ...]:
        """Close to the force cap, unless it is reached already."""
        if obs.at_cap:
            return ()
        self.closings += 1
        return (self.closing(obs, lost),)

    def closing(self, obs: Observation, lost: bool = False) -> CloseFast:
        """The closing that is due now; the same again during a first stage.

        ``lost``: contact is lost, so the position of the next contact is unknown.
        """
        s, targets = self._settings, obs.safe_travel_counts
        if s.closing == "constant" or lost or targets is None:
            return self._to_cap(s.closing_speed_mps)
        if not self._first_stage_due(obs, targets[0]):
            self._first_stage_ns = None
            return self.slow_closing()
        if self._first_stage_ns is None:
            self._first_stage_ns = obs.t_ns
        cap_n = self._plan.force_cap_n
        return CloseFast(cap_n, ALL_FINGERS, targets, s.closing_speed_mps, first_stage=True)

    def slow_closing(self) -> CloseFast:
        """A closing to the cap without a first stage, at the second stage's speed."""
        s = self._settings
        return self._to_cap(s.closing_speed_mps if s.closing == "constant" else TOP_UP_SPEED_MPS)

    def _to_cap(self, speed_mps: float) -> CloseFast:
        return CloseFast(self._plan.force_cap_n, ALL_FINGERS, CLOSED_COUNTS, speed_mps)

    def _first_stage_due(self, obs: Observation, target_counts: int) -> bool:
        """Whether the thumb, which opposes both others, starts or continues a first stage."""
        thumb, since_ns = obs.gripper.fingers[0], self._first_stage_ns
        overdue = since_ns is not None and obs.t_ns - since_ns > STAGE_NS
        if overdue or thumb.detection is Detection.CONTACT_CLOSING:
            return False
        if not obs.hand_rests:
            return obs.first_stage
        return not obs.first_stage and thumb.requested_counts < target_counts
