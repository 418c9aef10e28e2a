"""SetDown: from the top of the lift down to the table, where the hand opens.

The slip distance is unknown, and so is the arm's height at which the object touches the table.
Below that height the fingers slide down along the object; where it widens, the grip tightens.
"""

import math
from enum import Enum, auto

from grasp.control.commands import OpenFingers, StopArm
from grasp.control.contact_estimator import ContactEstimator, grip_force_n
from grasp.control.controller_settings import ControllerSettings
from grasp.control.lift_line import AT_HEIGHT_M, LiftLine
from grasp.control.observation import Observation
from grasp.control.state_timer import StateTimer
from grasp.control.states import Trigger
from grasp.control.transition import Transition, lose

CREEP_SHARE = 0.8  # share of controller.phase_timeout_s that the slow descent may take
# in this time an object falls 5 cm: it may stand on the table and be gripped at a higher point
CONTACT_GAP_NS = 100_000_000
SLIP_MARGIN_M = 0.003  # added for slip that ended undetected; assumed
RISE_N = 0.3  # rise of grip force that stops the arm: 7 standard deviations in the simulated hand
STILL_NS = 500_000_000  # rest of the arm before and after a probe: several periods of the pads
CHECK_N = 0.08  # least change of grip force by a conclusive probe: 3 standard deviations
STEP_M = 5e-4  # probing step down; assumed
SHORTEST_STEP_M = 2e-4  # shortest probing step; assumed
PROBE_FACTOR = 3  # a probe aims at a change of so many times CHECK_N
MAX_RISE_SHARE = 0.15  # largest total rise, relative to the least grip; sliding texture causes less
MAX_TIGHTENINGS = 8  # after so many without a conclusive probe the run ends; assumed


LOST_WHILE_LOWERING = lose("contact lost while lowering")


class Step(Enum):
    """Steps of the state `lower.feel`, repeated in this order."""

    CREEP = auto()  # slowly down to where the lift began
    SETTLE = auto()  # the grip has tightened: the arm stops, and the pads relax
    PROBE = auto()  # one small step down: it changes the grip force if the object stands


class SetDown:
    """States `lower.descend` and `lower.feel`. If it stays uncertain whether the object stands on
    the table, the run ends in `lost`."""

    def __init__(
        self,
        settings: ControllerSettings,
        line: LiftLine,
        contact: ContactEstimator,
        timer: StateTimer,
    ) -> None:
        self._settings = settings
        self._line = line
        self._contact = contact
        self._timer = timer
        self._step = Step.CREEP
        self._still_grips_n: list[float] = []  # grip force in the samples while the arm rests
        self._slipped_m = 0.0  # height of the arm at the last slip
        self._grip_n = 0.0  # grip force when the arm last started down
        self._least_n = math.inf  # least of these grip forces
        self._tightened_m = 0.0  # height at which the grip last tightened
        self._tightenings = 0
        self._open_m = 0.0  # height at which the hand opens

    @property
    def clear_m(self) -> float:
        """Height to which the arm retreats from the object."""
        return self._open_m + self._settings.retreat_m

    def record_slip(self, obs: Observation) -> None:
        """Record the height of the arm while slip is registered or a response to it lasts."""
        self._slipped_m = self._line.height_m(obs)

    def begin(self, cause: str) -> Transition:
        """Start lowering. If the object may have fallen onto the table and been gripped again at a
        higher point, lose it instead: lowering would push the closed hand down along it."""
        gap_ns = self._contact.longest_gap_ns
        if gap_ns >= CONTACT_GAP_NS:
            gap = f"no contact for {gap_ns * 1e-9:.2f} s during the lift"
            return lose(f"{gap}: the held object may stand on the table")
        return self._descend_fast(cause)

    def descend(self, obs: Observation) -> Transition | None:
        """The transition out of `lower.descend`; None while it continues."""
        if self._contact.lost:
            return LOST_WHILE_LOWERING
        if self._line.stopped_at(obs, self._highest_support_m):
            return self._creep(obs, "from here on the object may touch the table")
        return self._tightened(obs)

    def feel(self, obs: Observation) -> Transition | None:
        """The transition out of `lower.feel` or to its next step; None while the step continues."""
        if self._contact.lost:
            return LOST_WHILE_LOWERING
        if self._step is Step.CREEP:
            if self._line.stopped_at(obs, 0.0):
                return self._release(obs, "arm where the lift began")
            return self._tightened(obs)
        grip_n = self._still_n(obs)
        if grip_n is None:
            return None
        self._still_grips_n.clear()
        return (
            self._probe(obs, grip_n)
            if self._step is Step.SETTLE
            else self._evaluate_probe(obs, grip_n)
        )

    @property
    def arm_stop(self) -> StopArm | None:
        """The arm stop with which the present step began; None if the arm moves."""
        stops = self._step is Step.SETTLE
        return StopArm(self._settings.stop_deceleration_mps2) if stops else None

    def _still_n(self, obs: Observation) -> float | None:
        """Mean grip force over the second half of ``STILL_NS`` of rest of the arm; None before."""
        still_ns = self._timer.still_ns
        if still_ns is None:
            self._still_grips_n.clear()
            return None
        rest_ns = obs.t_ns - still_ns
        if rest_ns >= STILL_NS / 2:
            self._still_grips_n.append(grip_force_n(obs))
        return sum(self._still_grips_n) / len(self._still_grips_n) if rest_ns >= STILL_NS else None

    @property
    def _highest_support_m(self) -> float:
        """Greatest height of the arm at which the object can touch the table: the largest possible
        slip distance. Since the last slip the object has risen with the hand, so that distance is
        the arm's height at the last slip, plus a margin."""
        if self._slipped_m <= 0.0:
            return 0.0
        return min(self._slipped_m + SLIP_MARGIN_M, self._settings.lift_height_m)

    def _record_grip(self) -> None:
        self._grip_n = self._contact.grip_n
        self._least_n = min(self._least_n, self._grip_n)

    def _tightened(self, obs: Observation) -> Transition | None:
        """Stop the arm where the grip has tightened, because the object may touch the table."""
        rise_n = self._contact.grip_n - self._grip_n
        if rise_n < RISE_N:
            return None
        self._step = Step.SETTLE
        self._tightenings += 1
        self._tightened_m = self._line.height_m(obs)
        self._still_grips_n.clear()
        cause = f"the grip tightened by {rise_n:.1f} N while lowering"
        stop = StopArm(self._settings.stop_deceleration_mps2)
        return Transition(Trigger.FEEL, cause, (stop,))

    def _descend_fast(self, cause: str) -> Transition:
        self._record_grip()
        move = self._line.move_down(self._highest_support_m, self._settings.lower_speed_mps)
        return Transition(Trigger.LOWER, cause, (move,))

    def _creep(self, obs: Observation, cause: str) -> Transition:
        self._step = Step.CREEP
        self._record_grip()
        if self._line.stopped_at(obs, 0.0):
            return Transition(Trigger.FEEL, cause)
        in_time_mps = self._line.height_m(obs) / (CREEP_SHARE * self._settings.phase_timeout_s)
        speed_mps = max(self._settings.feel_speed_mps, in_time_mps)
        return Transition(Trigger.FEEL, cause, (self._line.move_down(0.0, speed_mps),))

    def _probe(self, obs: Observation, grip_n: float) -> Transition:
        self._step = Step.PROBE
        height_m = self._line.height_m(obs)
        step_m = self._probe_step_m(self._tightened_m - height_m, grip_n - self._grip_n)
        self._grip_n = grip_n
        step = self._line.move_down(height_m - step_m, self._settings.feel_speed_mps)
        return Transition(Trigger.FEEL, "the arm has rested long enough", (step,))

    def _probe_step_m(self, braking_m: float, rise_n: float) -> float:
        """Length of the shortest conclusive probe, from the tightening while the arm braked."""
        if braking_m <= 0.0 or rise_n <= RISE_N:
            return STEP_M
        conclusive_m = PROBE_FACTOR * CHECK_N * braking_m / (rise_n - RISE_N)
        return min(max(conclusive_m, SHORTEST_STEP_M), STEP_M)

    def _evaluate_probe(self, obs: Observation, grip_n: float) -> Transition:
        """Decide after a probe whether the object stands: only then does a step down change the
        grip force. A widening face tightens the grip; a textured face may loosen a tight one.

        A change above the greatest height of support is drift. Once the grip has tightened much,
        the arm goes no lower and the run ends in `lost`."""
        rise_n = grip_n - self._grip_n
        tight = grip_n - self._least_n >= RISE_N
        too_high = self._line.height_m(obs) > self._highest_support_m + AT_HEIGHT_M
        changed = rise_n >= CHECK_N or (tight and -rise_n >= CHECK_N)
        if changed and not too_high:
            return self._release(
                obs, f"the object stands: a step changed the grip by {rise_n:+.1f} N"
            )
        if self._tightenings >= MAX_TIGHTENINGS or grip_n >= (1 + MAX_RISE_SHARE) * self._least_n:
            return lose("the grip tightens; uncertain whether the object stands")
        unchanged = "a step down did not tighten the grip"
        if too_high:
            return self._descend_fast("no object can stand yet" if changed else unchanged)
        return self._creep(obs, unchanged)

    def _release(self, obs: Observation, cause: str) -> Transition:
        self._open_m = self._line.height_m(obs)
        return Transition(Trigger.STANDS, cause, (OpenFingers(self._settings.approach_speed_mps),))
