"""Close: the interface of slip responses, and the response that only closes the hand.

After a first grasp by touch there is no safe travel: each stage ends where the guard's measured
bound does, and ``escalate`` adds the next one while slip continues and the bound leaves room.

By counts, a closing to the force limit usually has two stages. First stage: fast, to the safe
travel (``ForceGuard.safe_travel``); it lasts about as long as the delay of a command. Feedback
would come too late, so it ends at a position. Second stage: at the hand's least speed, from rest,
to the force limit, so that momentum causes little overshoot. Where no safe travel is left, there is
only the second stage. One stage closes to the limit if no safe travel is known, if contact is lost,
or if ``controller.closing`` is constant.
"""

from drivers.interfaces import Counts3, Detection
from grasp.control.commands import CloseToLimit, Command, StopArm
from grasp.control.controller_settings import ControllerSettings, GripPlan
from grasp.control.lift_line import LiftLine
from grasp.control.observation import Observation

CLOSED_COUNTS: Counts3 = (255, 255, 255)
ALL_FINGERS = (True, True, True)  # with `every_finger` the guard closes the thumb alone
TOP_UP_SPEED_MPS = 0.022  # speed of a second stage: the gripper's least (manual)
STAGE_NS = 500_000_000  # longest wait for the end of a first stage


class SlipResponse:
    """The hand closes to the force limit while the arm continues (the paper's loop). Base class.

    One object for a run: ``begin`` when slip is registered or contact is lost, ``update`` every
    sample until ``end``. No method commands a device.

    ``closes_in_steps``: each from rest, so that a hand which presses more as it starts does so each
    time. ``closings``: number of closings. ``paused_s``: total time for which the arm was stopped.
    ``adds_margin``: the current response adds a safety margin instead of responding to slip.
    """

    closes_in_steps = False

    def __init__(self, settings: ControllerSettings, plan: GripPlan, line: LiftLine) -> None:
        self._settings = settings
        self._plan = plan
        self._line = line
        self._first_stage_ns: int | None = None  # time of the request of the current first stage
        self.closings = 0
        self.paused_s = 0.0
        self.adds_margin = False

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        """The first commands of a response. ``rising``: the arm is lifting, not holding at the top.
        ``lost``: contact is lost."""
        return self._close(obs, lost)

    def follow_up(self, obs: Observation, rising: bool) -> tuple[Command, ...]:
        """Commands that add a safety margin of force after slip has ended; empty if none is due."""
        return ()

    @property
    def arm_stop(self) -> StopArm | None:
        """The stop with which the response began; None if the arm continues."""
        return None

    def update(self, obs: Observation, alarm: bool, elapsed_ns: int) -> None:
        """Take one sample, ``elapsed_ns`` after the last. ``alarm``: slip is registered or masked,
        or the hand moves."""

    @property
    def exhausted(self) -> bool:
        """Whether the response has no option left while slip recurs."""
        return False

    def over(self, obs: Observation) -> bool:
        """Whether the response may end now that slip is no longer registered."""
        return True

    def escalate(self, obs: Observation, waited_ns: int) -> tuple[Command, ...] | None:
        """Further commands when slip has continued for ``waited_ns``; None if there are none: the
        next stage, where the force that was read since leaves room."""
        return self._close(obs) if obs.by_touch and not obs.closing_exhausted else None

    def end(self) -> tuple[Command, ...]:
        """Commands with which the arm continues."""
        return ()

    def _close(self, obs: Observation, lost: bool = False) -> tuple[Command, ...]:
        """Close to the force limit, unless it is reached already."""
        if obs.at_limit:
            return ()
        self.closings += 1
        return (self.closing(obs, lost),)

    def closing(self, obs: Observation, lost: bool = False) -> CloseToLimit:
        """The closing to command now; while a first stage runs, the same one again.

        ``lost``: contact is lost, so the position of the next contact is unknown.
        """
        s, targets = self._settings, obs.safe_travel_counts
        if s.closing == "constant" or lost or targets is None:
            return self._to_limit(s.closing_speed_mps)
        if not self._first_stage_due(obs, targets[0]):
            self._first_stage_ns = None
            return self.slow_closing()
        if self._first_stage_ns is None:
            self._first_stage_ns = obs.t_ns
        limit_n = self._plan.force_limit_n
        return CloseToLimit(limit_n, ALL_FINGERS, targets, s.closing_speed_mps, first_stage=True)

    def slow_closing(self) -> CloseToLimit:
        """A closing to the force limit without a first stage, at the second stage's speed."""
        s = self._settings
        return self._to_limit(s.closing_speed_mps if s.closing == "constant" else TOP_UP_SPEED_MPS)

    def _to_limit(self, speed_mps: float) -> CloseToLimit:
        return CloseToLimit(self._plan.force_limit_n, ALL_FINGERS, CLOSED_COUNTS, speed_mps)

    def _first_stage_due(self, obs: Observation, target_counts: int) -> bool:
        """Whether a first stage is to start or to continue, judged by the thumb."""
        thumb, since_ns = obs.gripper.fingers[0], self._first_stage_ns
        overdue = since_ns is not None and obs.t_ns - since_ns > STAGE_NS
        if overdue or thumb.detection is Detection.CONTACT_CLOSING:
            return False
        if not obs.hand_rests:
            return obs.first_stage
        return not obs.first_stage and thumb.requested_counts < target_counts
