"""Steps: slip in the lift is answered by as little force as ends it, and then a margin.

While the arm stands, slip is over whatever the hand does; only when the arm rises again does the
object say whether the force is enough. So each attempt is one step, and once it has carried the
object for a way it gets its margin, for what may still come. Force is never given back: to search
for the least by letting go is to drop what slips meanwhile.
"""

import math

from grasp.commands import MoveFingers
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.lift_line import LiftLine
from grasp.observation import Observation

OPEN_ENDED = 255  # counts: as far as fingers close


class Steps:
    """``lasts``: the present answer is a step or a margin, and a jump may follow. ``securing``: a
    margin."""

    def __init__(self, settings: ControllerSettings, plan: GripPlan, line: LiftLine) -> None:
        self._settings = settings
        self._plan = plan
        self._line = line
        self._found_m: float | None = None  # how high the arm was when force was last found
        self._taken = 0
        self.lasts = False
        self.securing = False

    def may(self, obs: Observation) -> bool:
        """Whether a step is an answer here: what slips still stands on the table, and the arm's
        stop, which ends slip, fits in the time of a step; the thumb, not latched by the force cap,
        may go a whole step further, and not too many were too small."""
        s = self._settings
        stops_s = math.hypot(*obs.arm.velocity_mps) / s.answer_stop_mps2
        low = self._line.height_m(obs) < s.step_below_m and stops_s <= s.step_patience_s
        some = self._taken < s.step_tries and not obs.gripper.thumb_latched
        return s.answer == "stop_and_step" and low and some and self._room(obs) >= self._counts

    def step(self, obs: Observation) -> MoveFingers:
        """The thumb one step further, and a margin to follow."""
        self._taken += 1
        self.lasts, self._found_m = True, self._line.height_m(obs)
        return self._further(obs, 1)

    def end(self) -> None:
        """A jump follows, or the arm goes on."""
        self.lasts = self.securing = False

    def margin_due(self, obs: Observation, at_top: bool) -> bool:
        """Whether the force that was found has carried the object for long enough."""
        if self._found_m is None or self._settings.margin_steps == 0:
            return False
        if self._room(obs) == 0:
            return False
        risen_m = self._line.height_m(obs) - self._found_m
        return at_top or risen_m >= self._settings.margin_after_m

    def margin(self, obs: Observation) -> MoveFingers:
        """The thumb all steps of the margin further."""
        self.securing = self.lasts = True
        self._found_m = None
        return self._further(obs, self._settings.margin_steps)

    def forget(self) -> None:
        """There is no force to give a margin to: the hand closes to its cap."""
        self._found_m = None
        self.end()

    @property
    def _counts(self) -> int:
        """Of a step."""
        return max(1, self._plan.stiffness.counts_within(self._settings.step_n))

    def _room(self, obs: Observation) -> int:
        """Counts that the guard lets the thumb go further."""
        end = OPEN_ENDED if obs.thumb_end is None else obs.thumb_end
        return max(0, end - obs.gripper.requested[0])

    def _further(self, obs: Observation, steps: int) -> MoveFingers:
        """As far as it may."""
        a, b, c = obs.gripper.requested
        counts = min(steps * self._counts, self._room(obs))
        cap_n = self._plan.force_cap_n
        return MoveFingers((a + counts, b, c), self._settings.grip_speed_mps, cap_n)
