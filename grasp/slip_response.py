"""Responses to slip: what hand and arm do from the registration of slip until it is over.

`jump` (SlipResponse itself) only closes the hand; `stop_and_jump` (StopAndClose) also stops the arm
meanwhile; `stop_and_step` (StopAndStep) closes the thumb no further than ends slip.

A closing to the force cap has one stage or two. Of two, the first goes by position alone, as fast
as the hand can, to where the limit is kept even on a contact that is stiffer and grasped harder
than stated (``ForceGuard.reach``). It lasts about as long as a command is on its way, so no
feedback could steer it. The second begins at rest and rises to the cap at the hand's slowest, so
that little momentum carries it past.
"""

import math

from drivers.interfaces import Counts3, Detection
from grasp.commands import CloseFast, Command, MoveFingers, StopArm
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.lift_progress import LiftLine
from grasp.observation import Observation

CLOSED_COUNTS: Counts3 = (255, 255, 255)
ALL_FINGERS = (True, True, True)
TOP_UP_SPEED_MPS = 0.022  # of a second stage: the gripper's least (manual)
STAGE_NS = 500_000_000  # a first stage that does not rest by then is not waited for
RESUME_MPS2 = 0.5  # at most, when the arm goes on: a twentieth of gravity
RESUME_QUIET_NS = 50_000_000  # slip is over for so long when it does; assumed
USELESS_PAUSE_S = 1.5  # in all of a lift, for alarms that no closing ends; assumed
STEP_N = 1.5  # more force a step, in whole counts, one at least; assumed
STEP_TRIES = 5  # steps of a lift; slip after them leads to a closing to the cap; assumed
STEP_PATIENCE_NS = 250_000_000  # longer than a detector needs to notice that slip is over; assumed
STEP_BELOW_M = 0.03  # of the arm: higher, the object is in the air, and the hand closes; assumed
MARGIN_AFTER_M = 0.01  # a force is found when it has carried so far; assumed


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


class StopAndClose(SlipResponse):
    """In the lift the arm also stops, and goes on gently when slip is over.

    An object that slips there mostly still stands on the table, and the fingers slide up along it:
    slip ends some 30 ms after the arm stops, while the hand needs 100 to 200 ms to press harder.
    """

    _stopped = False  # the arm, for the present response
    _stands = False  # the arm did so in the last sample
    _useless = False  # no closing could have an effect when the arm stopped
    _useless_s = 0.0
    _alarm_ns = 0  # when slip was last not known to be over

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        return (*self._stop_arm(obs, rising), *super().begin(obs, rising, lost))

    def _stop_arm(self, obs: Observation, rising: bool) -> tuple[Command, ...]:
        """Begin a pause, where the arm is on its way."""
        if not rising:
            return ()
        self._stopped, self._alarm_ns = True, obs.t_ns
        self._stands, self._useless = not obs.arm.moving, obs.closed_out
        return (StopArm(self._settings.answer_stop_mps2),)

    @property
    def arm_stop(self) -> StopArm | None:
        return StopArm(self._settings.answer_stop_mps2) if self._stopped else None

    def update(self, obs: Observation, alarm: bool, passed_ns: int) -> None:
        if self._stopped:
            self.paused_s += passed_ns * 1e-9 * self._stands
            self._useless_s += passed_ns * 1e-9 * self._useless
            self._alarm_ns = obs.t_ns if alarm else self._alarm_ns
            self._stands = not obs.arm.moving

    @property
    def exhausted(self) -> bool:
        return self._useless_s >= USELESS_PAUSE_S

    def over(self, obs: Observation) -> bool:
        """Whether the arm stands and slip has been over for long enough."""
        quiet = obs.t_ns - self._alarm_ns >= RESUME_QUIET_NS
        return not self._stopped or (quiet and not obs.pending and not obs.arm.moving)

    def end(self) -> tuple[Command, ...]:
        """The arm goes on so gently that a grip which only just holds goes on holding. It brakes no
        harder than the stop did, so that a stop on the way carries it past no end."""
        if not self._stopped:
            return ()
        self._stopped = False
        s = self._settings
        gently_mps2 = min(s.lift_acceleration_mps2, RESUME_MPS2, s.answer_stop_mps2)
        return (self._line.move(s.lift_height_m, s.lift_speed_mps, gently_mps2),)


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
        stops_s = math.hypot(*obs.arm.velocity_mps) / self._settings.answer_stop_mps2
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


RESPONSES: dict[str, type[SlipResponse]] = {
    "jump": SlipResponse,
    "stop_and_jump": StopAndClose,
    "stop_and_step": StopAndStep,
}  # by the setting `controller.answer`
