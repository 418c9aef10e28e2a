"""StopAndStep: the arm stops, and the thumb closes in small steps until slip ends."""

import math

from grasp.control.commands import Command, MoveFingers
from grasp.control.observation import Observation
from grasp.control.slip_response.close import CLOSED_COUNTS
from grasp.control.slip_response.stop_and_close import PATIENCE_NS, StopAndClose

STEP_N = 1.5  # force of a step, rounded down to motor counts, at least one; assumed
MAX_STEPS = 5  # steps in a lift; later slip leads to a closing to the limit; assumed
STEP_BELOW_M = 0.03  # no step above this height of the arm: the object is in the air; assumed
MARGIN_AFTER_M = 0.01  # a force is sufficient once it has carried the object so far; assumed


class StopAndStep(StopAndClose):
    """The arm stops, and the thumb closes by one step per slip, later by a margin. Where a step is
    not possible or not enough, it responds as ``StopAndClose``.

    While the arm is at rest, slip ends whatever the hand does. Only when the arm rises again does
    it show whether the force is sufficient. So each slip leads to one step. Once the arm has risen
    by ``MARGIN_AFTER_M`` without slip, the margin is added. Force is never reduced, because a
    search for the least force from above would drop objects.
    """

    closes_in_steps = True

    _step_height_m: float | None = None  # height of the arm at the last step; None: no margin due
    _steps_taken = 0
    _stepping = False  # the current response is a step or a margin: a closing may follow

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        if not rising or lost or not self._step_possible(obs):
            self._end_stepping()
            return super().begin(obs, rising, lost)
        self._steps_taken += 1
        self.closings += 1
        self._stepping, self._step_height_m = True, self._line.height_m(obs)
        return (*self._stop_arm(obs, rising), self._step_command(obs, 1))

    def follow_up(self, obs: Observation, rising: bool) -> tuple[Command, ...]:
        """The margin, once the force of the last step has carried the object far enough."""
        step_height_m, steps = self._step_height_m, self._settings.margin_steps
        if step_height_m is None or steps == 0 or self._remaining_counts(obs) == 0:
            return ()
        if rising and self._line.height_m(obs) - step_height_m < MARGIN_AFTER_M:
            return ()
        self._step_height_m = None
        self._stepping = self.adds_margin = True
        return (*self._stop_arm(obs, rising), self._step_command(obs, steps))

    def escalate(self, obs: Observation, waited_ns: int) -> tuple[Command, ...] | None:
        if not self._stepping:
            return super().escalate(obs, waited_ns)
        if waited_ns < PATIENCE_NS:
            return None
        self._end_stepping()
        return self._close(obs)

    def end(self) -> tuple[Command, ...]:
        self._stepping = self.adds_margin = False
        return super().end()

    def _end_stepping(self) -> None:
        """End the steps and add no margin, because the hand closes to the force limit."""
        self._step_height_m = None
        self._stepping = self.adds_margin = False

    def _step_possible(self, obs: Observation) -> bool:
        """Whether a step is possible: the object still stands on the table, the arm stops within
        the time of a step, and the thumb and the number of steps allow another one."""
        stops_s = math.hypot(*obs.arm.velocity_mps) / self._settings.slip_stop_mps2
        low = self._line.height_m(obs) < STEP_BELOW_M and stops_s <= PATIENCE_NS * 1e-9
        more = self._steps_taken < MAX_STEPS and not obs.gripper.thumb_latched
        return low and more and self._remaining_counts(obs) >= self._step_counts

    @property
    def _step_counts(self) -> int:
        return max(1, self._plan.stiffness.counts_within(STEP_N))

    def _remaining_counts(self, obs: Observation) -> int:
        """Motor counts by which the guard lets the thumb close further."""
        end = CLOSED_COUNTS[0] if obs.thumb_end_counts is None else obs.thumb_end_counts
        return max(0, end - obs.gripper.requested[0])

    def _step_command(self, obs: Observation, steps: int) -> MoveFingers:
        """Close the thumb by ``steps`` steps, as far as the guard allows."""
        a, b, c = obs.gripper.requested
        counts = min(steps * self._step_counts, self._remaining_counts(obs))
        limit_n = self._plan.force_limit_n
        return MoveFingers((a + counts, b, c), self._settings.grip_speed_mps, limit_n)
