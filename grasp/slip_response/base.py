"""SlipResponse: the interface of responses to slip, and the closing that all of them share.

A closing to the force cap has one stage or two. Of two, the first goes by position alone, as fast
as the hand can, to where the limit is kept even on a contact that is stiffer and grasped harder
than believed (``ForceGuard.reach``). It lasts about as long as a command is on its way, so nothing
that is fed back could steer it. The second begins at rest and rises to the cap at the hand's
slowest, so that little momentum carries it past.
"""

from drivers.interfaces import Counts3, Detection
from grasp.commands import CloseFast, Command, StopArm
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.lift_line import LiftLine
from grasp.observation import Observation

CLOSED_COUNTS: Counts3 = (255, 255, 255)
ALL_FINGERS = (True, True, True)
TOP_UP_SPEED_MPS = 0.022  # of a second stage: the gripper's least (manual)
STAGE_NS = 500_000_000  # a first stage that does not rest by then is not waited for


class SlipResponse:
    """One for a run. ``begin`` when slip is registered or contact is lost, ``update`` every sample
    until ``end``; none of them touches a device.

    ``closings``: how often the fingers were closed. ``first_stage_ns``: since when a first stage
    has been asked for. ``paused_s``: how long the arm has stood for it. ``adds_margin``: it lasts
    for more force, not for slip.
    """

    def __init__(self, settings: ControllerSettings, plan: GripPlan, line: LiftLine) -> None:
        self._settings = settings
        self._plan = plan
        self._line = line
        self.closings = 0
        self.first_stage_ns: int | None = None
        self.paused_s = 0.0
        self.adds_margin = False

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        """The first commands; ``rising``: the arm is on its way up; ``lost``: contact is."""
        raise NotImplementedError

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
        """Whether all has been done, and slip comes back."""
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

    def close(self, obs: Observation, lost: bool = False) -> tuple[Command, ...]:
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
        if not self._is_first(obs, reach[0]):
            self.first_stage_ns = None
            return self.slow_closing()
        if self.first_stage_ns is None:
            self.first_stage_ns = obs.t_ns
        cap_n = self._plan.force_cap_n
        return CloseFast(cap_n, ALL_FINGERS, reach, s.closing_speed_mps, more=True)

    def slow_closing(self) -> CloseFast:
        """To the cap where there is time, or no observation of a first stage."""
        s = self._settings
        return self._to_cap(s.closing_speed_mps if s.closing == "constant" else TOP_UP_SPEED_MPS)

    def _to_cap(self, speed_mps: float) -> CloseFast:
        return CloseFast(self._plan.force_cap_n, ALL_FINGERS, CLOSED_COUNTS, speed_mps)

    def _is_first(self, obs: Observation, reach_counts: int) -> bool:
        """Of the thumb, which opposes both others."""
        thumb, since_ns = obs.gripper.fingers[0], self.first_stage_ns
        overdue = since_ns is not None and obs.t_ns - since_ns > STAGE_NS
        if overdue or thumb.detection is Detection.CONTACT_CLOSING:
            return False
        if not obs.hand_rests:
            return obs.first_stage
        return not obs.first_stage and thumb.requested_counts < reach_counts
