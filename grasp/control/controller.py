"""GraspController: one pure step from an observation to commands, one handler for each state."""

import math
from collections.abc import Callable
from contextlib import suppress
from itertools import compress

import msgspec

from drivers.interfaces import FINGER_NAMES, OPEN_COUNTS, Counts3, Detection, Vector3
from grasp.control.commands import BeginRest, Command, HoldFingers, MoveFingers, StopArm
from grasp.control.compensation import Compensation
from grasp.control.contact_estimator import ContactEstimator
from grasp.control.controller_settings import ControllerSettings, GripPlan
from grasp.control.fault import FINGERTIPS, Fault
from grasp.control.lift_line import AT_HEIGHT_M, LiftLine
from grasp.control.monitors.checks import implausible
from grasp.control.monitors.run import RunMonitor
from grasp.control.observation import Observation
from grasp.control.safe_state import SafeState, SafeStateSupervisor, Unconfirmed
from grasp.control.set_down import SetDown
from grasp.control.slip_monitor import SlipMonitor
from grasp.control.slip_response import RESPONSES
from grasp.control.slip_response.close import CLOSED_COUNTS
from grasp.control.state_timer import StateTimer
from grasp.control.states import AIRBORNE_STATES, END_STATES, State, StateMachine, Trigger
from grasp.control.touch import Touch
from grasp.control.transition import Decision, Transition, end, fail, repeated_stop, stay

# share of `controller.contact_n` below which a finger bears nothing: 6 standard deviations of an
# unloaded simulated fingertip
LOADED_SHARE = 0.25
LOADING_STEPS = 5  # most counts that fingers without load close further before the lift; assumed
UNLOADED_REMEDY = (
    "put the object in the middle, or raise that finger's count in object.grip_counts; if it does "
    "press, look at its fingertip: `grasp doctor`"
)
WIDE = "the object is wider than its file says"
SHORT = f"stopped on contact short of its position: {WIDE}"
WIDE_REMEDY = "lower object.grip_counts, by 1.3 counts for each mm that a side is wider"
RESETTING = frozenset({Trigger.GRIPPED, Trigger.SETTLED})  # the detector begins again
ALARM_HOLD_NS = 2_000_000_000  # longest extension of a hold by alarms that no closing ends; assumed


class GraspController:
    """Grasps, lifts, responds to slip, holds, sets down. Call ``step`` once a tactile sample.

    State beyond the state machine and its timer is kept by the slip response, by the set-down, and
    by the safe-state supervisor once a run has ended early.
    """

    def __init__(self, settings: ControllerSettings, plan: GripPlan, monitor: SlipMonitor) -> None:
        self._settings = settings
        self._plan = plan
        self.slip_monitor = monitor
        self.machine = StateMachine()
        self.limit_reached = False  # slip continued at the force limit: the object is set down
        self.alarm_stayed = False  # slip was still registered when the hold ended
        self.faults: tuple[Fault, ...] = ()  # why the run ended early
        self._supervisor: SafeStateSupervisor | None = None  # once a safe state was entered
        self._line = LiftLine(
            settings, plan.home or (0.0, 0.0, 0.0)
        )  # without a home, `_start` sets it
        self._contact = ContactEstimator(settings.contact_n)
        self._timer = StateTimer()
        self._run_monitor = RunMonitor(settings, self._timer, self._contact)
        self._set_down = SetDown(settings, self._line, self._contact, self._timer)
        self.response = RESPONSES[settings.slip_response](settings, plan, self._line)
        self._compensation = Compensation(
            settings, monitor, self._contact, self._timer, self.response
        )
        by_touch = settings.first_grasp == "touch"
        self._touch = Touch(settings, plan.force_limit_n) if by_touch else None
        self._firm = False  # the closing to the force limit has been commanded
        self._loading_steps = 0  # counts that fingers without load have closed further
        # the first finger that bore nothing, and the force at the thumb then
        self._unloaded: tuple[int, float] | None = None
        self._handlers: dict[State, Callable[[Observation], Transition | None]] = {
            State.START: self._start, State.HOME: self._home, State.SHAPE: self._shape,
            State.TARE: self._tare, State.BRACE: self._brace, State.CLOSE: self._close,
            State.SETTLE: self._settle, State.BASELINE: self._baseline,
            State.LIFT: self._lift, State.COMPENSATE: self._compensate, State.HOLD: self._hold,
            State.DESCEND: self._descend, State.FEEL: self._feel,
            State.OPEN: self._open, State.RETREAT: self._retreat,
        }  # fmt: skip

    @property
    def state(self) -> State:
        return self.machine.state

    @property
    def home(self) -> Vector3:
        """Position of the arm where the lift begins."""
        return self._line.home

    @property
    def finished(self) -> bool:
        ended = self.machine.state in END_STATES
        return ended or (self._supervisor is not None and self._supervisor.over)

    @property
    def in_safe_state(self) -> bool:
        return self._supervisor is not None

    @property
    def later_faults(self) -> tuple[Fault, ...]:
        """Faults found since the safe state was entered."""
        return self._supervisor.later_faults if self._supervisor else ()

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """Parts of the safe state that were not confirmed when the run ended."""
        return self._supervisor.unconfirmed if self._supervisor else ()

    @property
    def arm_delay_ns(self) -> float:
        """Additional duration of the run because of a slow arm."""
        return self._timer.arm_delay_ns

    def step(self, obs: Observation) -> Decision:
        """Take one observation; returns the decision, with the commands to send."""
        state = self.machine.state
        self._timer.update(obs, state)
        slip = self.slip_monitor.update(obs.t_ns, obs.probabilities)
        self._contact.update(obs, state in AIRBORNE_STATES)
        # during a response the object may slip unregistered, but not while a margin is added
        responding = state is State.COMPENSATE and not self.response.adds_margin
        if responding or slip.registered:
            self._set_down.record_slip(obs)
        transition = self._transition(obs, state)
        trigger, commands = (transition.trigger, transition.commands) if transition else (None, ())
        if transition and trigger:
            commands = self._enter(obs, trigger, transition)
        return Decision(
            self.state,
            self.slip_monitor.status,
            commands,
            reset_detector=trigger in RESETTING,
            first_grasp=trigger is Trigger.READY,
            finished=self.finished,
        )

    def _transition(self, obs: Observation, state: State) -> Transition | None:
        """What the supervisor of a safe state, the run's checks or the state's handler decide."""
        if self._supervisor:
            return stay(*self._supervisor.step(obs))
        if faults := self._run_monitor.check(obs, state):
            return end(Trigger.FAIL, faults)
        if obs.stop:
            return end(Trigger.STOP, (obs.stop,))
        return None if state in END_STATES else self._handlers[state](obs)

    def _enter(
        self, obs: Observation, trigger: Trigger, transition: Transition
    ) -> tuple[Command, ...]:
        """Enter the next state; returns the commands due."""
        self.machine.fire(trigger, obs.t_ns, transition.cause)
        self._timer.restart(obs.t_ns)
        if not transition.faults:
            return transition.commands
        self.faults = transition.faults
        self._supervisor = SafeStateSupervisor.enter(
            self.machine, obs, self.faults, self._settings, self.response
        )
        return self._supervisor.request(obs)

    def abort_commands(self) -> tuple[Command, ...]:
        """Commands if no further step is possible: of the safe state entered, else of a fault."""
        hand: tuple[Command, ...] = (HoldFingers(),)  # if a bug prevents the next line
        with suppress(Exception):
            hand = self._abort_state.hand_commands(self.response.slow_closing())
        return (StopArm(self._settings.stop_deceleration_mps2), *hand)

    def unconfirmed_parts(self, obs: Observation) -> Unconfirmed:
        """Parts of the safe state of ``abort_commands`` that the observation does not confirm. A
        stale hand status confirms nothing."""
        stale_ns = self._settings.stale_after_s * 1e9
        if obs.gripper.age_ns(obs.t_ns) > stale_ns:
            obs = msgspec.structs.replace(obs, gripper_lost=True)
        safe = self._abort_state
        return Unconfirmed(safe.unconfirmed_arm(obs, stale_ns), safe.unconfirmed_hand(obs))

    @property
    def _abort_state(self) -> SafeState:
        if self._supervisor:
            return self._supervisor.safe
        return SafeState(State.FAULT, self.state, self._timer.entered_ns)

    # Approach

    def _start(self, obs: Observation) -> Transition:
        """Fail before anything moves if the hand is not open."""
        if self._plan.home is None:
            self._line.home = obs.arm.position_m
        if any(f.detection is Detection.CONTACT_CLOSING for f in obs.gripper.fingers):
            return fail("the hand is closed and may hold an object")
        if max(obs.gripper.positions) > OPEN_COUNTS:  # a grip by position reports no contact
            return fail("the hand is not open: it could drop or hit an object")
        if math.dist(obs.arm.position_m, self.home) < AT_HEIGHT_M:
            return Transition(Trigger.AT_HOME, "run started", (self._preshape(),))
        move = self._line.move_down(0.0, self._settings.lower_speed_mps)
        return Transition(Trigger.AWAY, "run started", (move,))

    def _home(self, obs: Observation) -> Transition | None:
        if not (obs.hand_rests and self._line.stopped_at(obs, 0.0)):
            return None
        return Transition(Trigger.AT_HOME, "arm home", (self._preshape(),))

    def _shape(self, obs: Observation) -> Transition | None:
        if not obs.hand_rests or not self._line.stopped_at(obs, 0.0):
            return None
        stopped = (f.detection is Detection.CONTACT_CLOSING for f in obs.gripper.fingers)
        if name := next(compress(FINGER_NAMES, stopped), ""):
            return fail(f"finger {name} {SHORT}", WIDE_REMEDY)
        if obs.gripper.requested != self._plan.shape_counts:  # the command did not arrive
            return stay(self._preshape())
        cause = "the hand is open" if self._touch else "fingers short of the object"
        return Transition(Trigger.SHAPED, cause, (BeginRest(),))

    # Grasp

    def _tare(self, obs: Observation) -> Transition | None:
        if not (obs.hand_rests and obs.rest_taken):
            return None
        thumb, _, _ = self._plan.preshape_counts
        _, b, c = self._plan.grip_counts
        first = self._touch.begin(obs) if self._touch else self._grip((thumb, b, c))
        return Transition(Trigger.TARED, "rest counts taken", (first,))

    def _brace(self, obs: Observation) -> Transition | None:
        """B and C close first, so that only the thumb, which closes last, presses on the object."""
        if self._touch:
            return self._close_by_touch(obs, self._touch)
        thumb_n, *others_n = obs.estimated_n
        pressed = min(thumb_n, max(others_n)) >= self._settings.contact_n
        if pressed and not implausible(obs.reported, FINGERTIPS):
            return fail(f"the thumb touches while it waits: {WIDE}", WIDE_REMEDY)
        if not obs.hand_rests:
            return None
        closing = self._grip(self._plan.grip_counts)
        cause = "fingers B and C rest at their positions"
        return self._incomplete(obs) or Transition(Trigger.BRACED, cause, (closing,))

    def _close(self, obs: Observation) -> Transition | None:
        """The thumb closes to its position; for a firm grip it then closes to the force limit."""
        if self._touch and not self._touch.complete:
            return self._close_by_touch(obs, self._touch)
        if not obs.hand_rests:
            return None
        if failed := self._incomplete(obs):
            return failed
        cause = "fingers rest at their positions"
        if self._settings.firm and not self._firm:
            self._firm = True
            return Transition(Trigger.TIGHTEN, cause, (self.response.slow_closing(),))
        cause = "the thumb stopped at the force limit" if self._firm else cause
        return Transition(Trigger.GRIPPED, cause)

    def _close_by_touch(self, obs: Observation, touch: Touch) -> Transition | None:
        command = touch.update(obs)
        commands = () if command is None else (command,)
        if touch.failed:
            return fail(*touch.failed)
        if touch.complete:
            return Transition(Trigger.GRIPPED, "the fingertips feel the first force")
        if self.state is State.BRACE and touch.braced:
            return Transition(Trigger.BRACED, "B and C wait, or touch the object", commands)
        return stay(*commands)

    def _settle(self, obs: Observation) -> Transition | None:
        if not obs.hand_rests:
            return None
        if failed := self._incomplete(obs):
            return failed
        if not self._lasted(obs, self._settings.settle_s):
            return None
        finger = min((1, 2), key=lambda i: obs.estimated_n[i])
        unloaded = obs.estimated_n[finger] < LOADED_SHARE * self._settings.contact_n
        # a thumb without contact ends the run later; implausible fingertips prove nothing
        if unloaded and not (self._contact.thumb_lost or implausible(obs.reported, FINGERTIPS)):
            return self._load_finger(obs, finger)
        self.slip_monitor.arm()
        return Transition(Trigger.SETTLED, "pads relaxed")

    def _load_finger(self, obs: Observation, finger: int) -> Transition:
        """Close a finger that bears nothing by one count, or end the run where it may not close
        further: an object between two fingers slides without a registered slip."""
        limit_n, steps, targets = (
            self._plan.force_limit_n, self._loading_steps, list(obs.gripper.requested)
        )  # fmt: skip
        first, thumb_before_n = self._unloaded or (finger, obs.estimated_n[0])
        self._unloaded = first, thumb_before_n
        # pressing one finger can unload the other, so the first one is named
        cause = f"finger {FINGER_NAMES[first]} bears nothing"
        silent = obs.estimated_n[first] < LOADED_SHARE * self._settings.contact_n
        rise_n = obs.estimated_n[0] - thumb_before_n
        dead = silent and steps >= 2 and rise_n > self._settings.contact_n
        targets[finger] += 1
        thumb_n = obs.estimated_n[0] + self._plan.stiffness.newtons_per_count
        closable = targets[finger] <= CLOSED_COUNTS[finger] and thumb_n <= limit_n
        if closable and steps < LOADING_STEPS and not (self._firm or dead):
            self._loading_steps += 1
            a, b, c = targets
            return Transition(Trigger.TIGHTEN, cause, (self._grip((a, b, c)),))
        load = f"its fingertip shows {obs.estimated_n[first]:.2f} N after {steps} more counts"
        if dead:
            load += f", while the thumb rose by {rise_n:.1f} N: the fingertip may be dead"
        most = f"at most {LOADING_STEPS} are tried, while the thumb stays within {limit_n:g} N"
        return fail(f"{cause}: {load}; {most}", UNLOADED_REMEDY)

    def _baseline(self, obs: Observation) -> Transition | None:
        if not obs.hand_rests:
            return None
        if failed := self._incomplete(obs):
            return failed
        if self._contact.thumb_lost:
            return fail("no contact at the thumb's position: no object, or a narrower one")
        if not self._lasted(obs, self._settings.baseline_s):
            return None
        move = self._line.move(self._settings.lift_height_m, self._settings.lift_speed_mps)
        return Transition(Trigger.READY, "the detector has its baseline", (move,))

    # In the air

    def _lift(self, obs: Observation) -> Transition | None:
        if transition := self._compensation.begin(obs, rising=True):
            return transition
        arrived = self._line.stopped_at(obs, self._settings.lift_height_m)
        return Transition(Trigger.AT_TOP, "arm at the top") if arrived else None

    def _compensate(self, obs: Observation) -> Transition | None:
        decided = self._compensation.update(obs)
        if decided and decided.trigger is Trigger.LOWER:
            self.limit_reached = True
            return self._lower(decided.cause)
        if decided and decided.trigger is Trigger.STEADY:
            resume = self.response.end()
            if self._line.stopped_at(obs, self._settings.lift_height_m):
                return Transition(Trigger.AT_TOP, decided.cause)
            return Transition(Trigger.STEADY, decided.cause, resume)
        return decided

    def _hold(self, obs: Observation) -> Transition | None:
        """Hold for ``hold_s`` after the last response to slip. Alarms that no closing can end
        extend the hold. It then ends at most ``hold_s`` plus ``ALARM_HOLD_NS`` after the arm first
        arrived at the top."""
        s, set_down = self._settings, obs.set_down
        held_ns = obs.t_ns - self.machine.first_ns(State.HOLD)
        over = s.hold_by_clock and held_ns >= s.hold_s * 1e9
        futile = held_ns >= s.hold_s * 1e9 + ALARM_HOLD_NS and obs.closing_exhausted
        if not (over or futile) and (transition := self._compensation.begin(obs, rising=False)):
            return transition
        if not (over or futile or set_down or self._lasted(obs, s.hold_s)):
            return None
        self.alarm_stayed = self.slip_monitor.status.registered
        if s.keep:
            return Transition(Trigger.KEEP, "held long enough")
        return self._lower("set-down requested" if set_down else "held long enough")

    # Set down

    def _lower(self, cause: str) -> Transition:
        self.slip_monitor.disarm()
        return self._set_down.begin(cause)

    def _descend(self, obs: Observation) -> Transition | None:
        return self._set_down.descend(obs)

    def _feel(self, obs: Observation) -> Transition | None:
        stop = self._set_down.arm_stop
        return self._set_down.feel(obs) or stay(*repeated_stop(obs, self._timer, stop))

    def _open(self, obs: Observation) -> Transition | None:
        if not obs.hand_rests:
            return None
        if not obs.gripper.is_open:
            return fail(f"the fingers stopped at {obs.gripper.positions} counts: not open")
        move = self._line.move(self._set_down.clear_m, self._settings.lower_speed_mps)
        return Transition(Trigger.OPENED, "fingers open", (move,))

    def _retreat(self, obs: Observation) -> Transition | None:
        clear = obs.hand_rests and self._line.stopped_at(obs, self._set_down.clear_m)
        return Transition(Trigger.CLEAR, "arm clear") if clear else None

    # What handlers share

    def _lasted(self, obs: Observation, duration_s: float) -> bool:
        """Whether the present state has lasted for ``duration_s``."""
        return obs.t_ns - self._timer.entered_ns >= duration_s * 1e9

    def _preshape(self) -> MoveFingers:
        s = self._settings
        return MoveFingers(self._plan.shape_counts, s.approach_speed_mps, s.grip_force_n)

    def _grip(self, targets: Counts3) -> MoveFingers:
        return MoveFingers(targets, self._settings.grip_speed_mps, self._settings.grip_force_n)

    def _incomplete(self, obs: Observation) -> Transition | None:
        """The end of the run where a finger of a hand at rest stopped on contact short of its
        position, or the thumb of a firm grip met no object. None if the grip is complete."""
        if self._firm and not obs.gripper.thumb_latched:
            return fail("the thumb closed fully and met no object")
        if not self._firm and not self._touch and (name := obs.gripper.not_at_target):
            return fail(f"finger {name} {SHORT}", WIDE_REMEDY)
        return None
