"""Close: the interface of slip responses, and the response that only closes the hand.

A closing to the force cap has one stage or two. Of two, the first goes by position alone, as fast
as the hand can, to where the limit is kept even on a contact that is stiffer and grasped harder
than stated (``ForceGuard.reach``). It lasts about as long as a command is on its way, so no
feedback could steer it. The second begins at rest and rises to the cap at the hand's slowest, so
that little momentum carries it past.
"""

from drivers.interfaces import Counts3, Detection
from grasp.commands import CloseFast, Command, StopArm
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.lift_progress import LiftLine
from grasp.observation import Observation

CLOSED_COUNTS: Counts3 = (255, 255, 255)
ALL_FINGERS = (True, True, True)
TOP_UP_SPEED_MPS = 0.022  # of a second stage: the gripper's least (manual)
STAGE_NS = 500_000_000  # a first stage that does not rest by then is not waited for


class SlipResponse:
    """The hand closes to the force cap, and the arm goes on (the paper's loop). Base of all others.

    One object for a run: ``begin`` when slip is registered or contact is lost, ``update`` every
    sample until ``end``; none of them touches a device.

    ``closings``: how often the fingers were closed. ``paused_s``: how long the arm has stood for
    it. ``adds_margin``: the present response adds a safety margin, and is not for slip.
    """

    def __init__(self, settings: ControllerSettings, plan: GripPlan, line: LiftLine) -> None:
        self._settings = settings
        self._plan = plan
        self._line = line
        self._first_stage_ns: int | None = None  # since when a first stage has been asked for
        self.closings = 0
        self.paused_s = 0.0
        self.adds_margin = False

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        """The first commands; ``rising``: the arm is on its way up; ``lost``: contact is."""
        return self._close(obs, lost)

    def follow_up(self, obs: Observation, rising: bool) -> tuple[Command, ...]:
        """What is due after slip was over: more force, as a safety margin; mostly nothing."""
        return ()

    @property
    def arm_stop(self) -> StopArm | None:
        """The stop with which it began; None where the arm goes on."""
        return None

    def update(self, obs: Observation, alarm: bool, passed_ns: int) -> None:
        """One sample, so long after the one before; ``alarm``: slip may not be over."""

    @property
    def exhausted(self) -> bool:
        """Whether everything has been tried, and slip comes back."""
        return False

    def over(self, obs: Observation) -> bool:
        """Whether it may end, slip not being registered any more."""
        return True

    def escalate(self, obs: Observation, waited_ns: int) -> tuple[Command, ...] | None:
        """What follows where slip goes on for so long; None: nothing, or nothing yet."""
        return None

    def end(self) -> tuple[Command, ...]:
        """The commands by which the arm goes on."""
        return ()

    def _close(self, obs: Observation, lost: bool = False) -> tuple[Command, ...]:
        """To the force cap, where that is any further."""
        if obs.at_cap:
            return ()
        self.closings += 1
        return (self.closing(obs, lost),)

    def closing(self, obs: Observation, lost: bool = False) -> CloseFast:
        """The closing that is due now; the same again while a first stage is under way.

        ``lost``: contact is, so it is not known where the next one will be.
        """
        s, reach = self._settings, obs.reach_counts
        if s.closing == "constant" or lost or reach is None:
            return self._to_cap(s.closing_speed_mps)
        if not self._first_stage_due(obs, reach[0]):
            self._first_stage_ns = None
            return self.slow_closing()
        if self._first_stage_ns is None:
            self._first_stage_ns = obs.t_ns
        cap_n = self._plan.force_cap_n
        return CloseFast(cap_n, ALL_FINGERS, reach, s.closing_speed_mps, more=True)

    def slow_closing(self) -> CloseFast:
        """To the cap where there is time, or no observation of a first stage."""
        s = self._settings
        return self._to_cap(s.closing_speed_mps if s.closing == "constant" else TOP_UP_SPEED_MPS)

    def _to_cap(self, speed_mps: float) -> CloseFast:
        return CloseFast(self._plan.force_cap_n, ALL_FINGERS, CLOSED_COUNTS, speed_mps)

    def _first_stage_due(self, obs: Observation, reach_counts: int) -> bool:
        """Whether the thumb, which opposes both others, is to begin or to go on with one."""
        thumb, since_ns = obs.gripper.fingers[0], self._first_stage_ns
        overdue = since_ns is not None and obs.t_ns - since_ns > STAGE_NS
        if overdue or thumb.detection is Detection.CONTACT_CLOSING:
            return False
        if not obs.hand_rests:
            return obs.first_stage
        return not obs.first_stage and thumb.requested_counts < reach_counts
