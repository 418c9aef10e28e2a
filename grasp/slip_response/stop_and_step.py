"""StopAndStep: the arm stops, and the thumb closes by as little as ends slip."""

import math

from grasp.commands import Command, MoveFingers
from grasp.observation import Observation
from grasp.slip_response.close import CLOSED_COUNTS
from grasp.slip_response.stop_and_close import StopAndClose

STEP_N = 1.5  # more force a step, in whole counts, one at least; assumed
STEP_TRIES = 5  # steps of a lift; slip after them leads to a closing to the cap; assumed
STEP_PATIENCE_NS = 250_000_000  # longer than a detector needs to notice that slip is over; assumed
STEP_BELOW_M = 0.03  # of the arm: higher, the object is in the air, and the hand closes; assumed
MARGIN_AFTER_M = 0.01  # a force is found when it has carried so far; assumed


class StopAndStep(StopAndClose):
    """The arm stops, and the thumb closes by as little as ends slip, then by a margin; where a step
    will not do, or was not enough, as ``StopAndClose``.

    While the arm stands, slip is over whatever the hand does; only when the arm rises again does it
    show whether the force is enough. So each attempt is one step, and once it has carried the
    object for a way it gets its margin. Force is never given back: a search for the least by
    letting go drops what slips meanwhile.
    """

    _found_m: float | None = None  # how high the arm was when force was last found
    _taken = 0
    _stepping = False  # the present response is a step or a margin: a closing may follow

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        if not rising or lost or not self._may_step(obs):
            self._forget()
            return super().begin(obs, rising, lost)
        self._taken += 1
        self.closings += 1
        self._stepping, self._found_m = True, self._line.height_m(obs)
        return (*self._stop_arm(obs, rising), self._further(obs, 1))

    def follow_up(self, obs: Observation, rising: bool) -> tuple[Command, ...]:
        """The margin, once the force that was found has carried the object for long enough."""
        found_m, steps = self._found_m, self._settings.margin_steps
        if found_m is None or steps == 0 or self._room(obs) == 0:
            return ()
        if rising and self._line.height_m(obs) - found_m < MARGIN_AFTER_M:
            return ()
        self._found_m = None
        self._stepping = self.adds_margin = True
        return (*self._stop_arm(obs, rising), self._further(obs, steps))

    def escalate(self, obs: Observation, waited_ns: int) -> tuple[Command, ...] | None:
        if not self._stepping or waited_ns < STEP_PATIENCE_NS:
            return None
        self._forget()
        return self._close(obs)

    def end(self) -> tuple[Command, ...]:
        self._stepping = self.adds_margin = False
        return super().end()

    def _forget(self) -> None:
        """There is no force to give a margin to: the hand closes to its cap."""
        self._found_m = None
        self._stepping = self.adds_margin = False

    def _may_step(self, obs: Observation) -> bool:
        """Whether a step will do: the object still stands on the table, the arm stops within the
        time of a step, the thumb may go a whole step further, and few steps were too small."""
        stops_s = math.hypot(*obs.arm.velocity_mps) / self._settings.slip_stop_mps2
        low = self._line.height_m(obs) < STEP_BELOW_M and stops_s <= STEP_PATIENCE_NS * 1e-9
        some = self._taken < STEP_TRIES and not obs.gripper.thumb_latched
        return low and some and self._room(obs) >= self._step_counts

    @property
    def _step_counts(self) -> int:
        return max(1, self._plan.stiffness.counts_within(STEP_N))

    def _room(self, obs: Observation) -> int:
        """Counts that the guard lets the thumb go further."""
        end = CLOSED_COUNTS[0] if obs.thumb_end is None else obs.thumb_end
        return max(0, end - obs.gripper.requested[0])

    def _further(self, obs: Observation, steps: int) -> MoveFingers:
        """The thumb so many steps further, as far as it may."""
        a, b, c = obs.gripper.requested
        counts = min(steps * self._step_counts, self._room(obs))
        cap_n = self._plan.force_cap_n
        return MoveFingers((a + counts, b, c), self._settings.grip_speed_mps, cap_n)
