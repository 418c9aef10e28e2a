"""GraspController: one pure step from an observation to commands, one handler for each state."""

import math
from collections.abc import Callable
from contextlib import suppress
from itertools import compress

import msgspec

from drivers.interfaces import FINGER_NAMES, OPEN_COUNTS, Counts3, Detection, Vector3
from grasp.control.commands import BeginRest, Command, HoldFingers, MoveFingers, StopArm
from grasp.control.contact_estimator import ContactEstimator
from grasp.control.controller_settings import ControllerSettings, GripPlan
from grasp.control.fault import FINGERTIPS, LOST, TRIAL, Fault, lines
from grasp.control.lift_line import AT_HEIGHT_M, LiftLine
from grasp.control.monitors.checks import implausible
from grasp.control.monitors.run import RunMonitor
from grasp.control.observation import Observation
from grasp.control.safe_state import SafeState, SafeStateSupervisor, Unconfirmed
from grasp.control.set_down import SetDown, Transition
from grasp.control.slip_monitor import SlipMonitor, SlipStatus
from grasp.control.slip_response import RESPONSES
from grasp.control.slip_response.close import CLOSED_COUNTS
from grasp.control.state_timer import StateTimer
from grasp.control.states import AIRBORNE_STATES, END_STATES, State, StateMachine, Trigger
from grasp.control.touch import Touch

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
ALARM_HOLD_NS = 2_000_000_000  # longest extension of a hold by alarms that no closing ends; assumed


class Decision(msgspec.Struct, frozen=True):
    """Result of one step."""

    state: State
    slip: SlipStatus
    commands: tuple[Command, ...]
    reset_detector: bool = False
    first_grasp: bool = False  # complete in this step: the guard measures safe travel from it
    finished: bool = False


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
        by_touch = settings.first_grasp == "touch"
        self._touch = Touch(settings, plan.force_limit_n) if by_touch else None
        self._firm = False  # the closing to the force limit has been commanded
        self._loading_steps = 0  # counts that fingers without load have closed further
        # the first finger that bore nothing, and the force at the thumb then
        self._unloaded: tuple[int, float] | None = None
        self._commands: list[Command] = []  # this and the next two: of the present step
        self._reset_detector = self._first_grasp = False
        self._handlers: dict[State, Callable[[Observation], None]] = {
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
    def fault_cause(self) -> str:
        """Why the run ended early, in one line; empty if it did not."""
        return lines(self.faults)

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
        self._commands = []
        self._reset_detector = self._first_grasp = False
        self._timer.update(obs, state)
        slip = self.slip_monitor.update(obs.t_ns, obs.probabilities)
        self._contact.update(obs, state in AIRBORNE_STATES)
        # during a response the object may slip unregistered, but not while a margin is added
        responding = state is State.COMPENSATE and not self.response.adds_margin
        if responding or slip.registered:
            self._set_down.record_slip(obs)
        if self._supervisor:
            self._commands += self._supervisor.step(obs)
        elif faults := self._run_monitor.check(obs, state):
            self._enter_safe_state(Trigger.FAIL, obs, faults)
        elif obs.stop:
            self._enter_safe_state(Trigger.STOP, obs, (obs.stop,))
        elif state not in END_STATES:
            self._handlers[state](obs)
        return Decision(
            self.state, self.slip_monitor.status, tuple(self._commands),
            self._reset_detector, self._first_grasp, self.finished,
        )  # fmt: skip

    def abort_commands(self) -> tuple[Command, ...]:
        """Commands if no further step is possible: of the safe state entered, else of a fault."""
        hand: tuple[Command, ...] = (HoldFingers(),)  # if a bug prevents the next line
        with suppress(Exception):
            hand = self._abort_state.hand_commands(self.response.closing_at_least_speed())
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

    def _start(self, obs: Observation) -> None:
        """Fail before anything moves if the hand is not open."""
        if self._plan.home is None:
            self._line.home = obs.arm.position_m
        if any(f.detection is Detection.CONTACT_CLOSING for f in obs.gripper.fingers):
            self._fail(obs, "the hand is closed and may hold an object")
        elif max(obs.gripper.positions) > OPEN_COUNTS:  # a grip by position reports no contact
            self._fail(obs, "the hand is not open: it could drop or hit an object")
        elif math.dist(obs.arm.position_m, self.home) < AT_HEIGHT_M:
            self._transition(Trigger.AT_HOME, obs, "run started", self._preshape())
        else:
            move = self._line.move_down(0.0, self._settings.lower_speed_mps)
            self._transition(Trigger.AWAY, obs, "run started", move)

    def _home(self, obs: Observation) -> None:
        if obs.hand_rests and self._line.stopped_at(obs, 0.0):
            self._transition(Trigger.AT_HOME, obs, "arm home", self._preshape())

    def _shape(self, obs: Observation) -> None:
        if not obs.hand_rests or not self._line.stopped_at(obs, 0.0):
            return
        stopped = (f.detection is Detection.CONTACT_CLOSING for f in obs.gripper.fingers)
        if name := next(compress(FINGER_NAMES, stopped), ""):
            self._fail(obs, f"finger {name} {SHORT}", WIDE_REMEDY)
        elif obs.gripper.requested != self._plan.shape_counts:  # the command did not arrive
            self._commands.append(self._preshape())
        else:
            cause = "the hand is open" if self._touch else "fingers short of the object"
            self._transition(Trigger.SHAPED, obs, cause, BeginRest())

    # Grasp

    def _tare(self, obs: Observation) -> None:
        if not (obs.hand_rests and obs.rest_taken):
            return
        if self._touch:
            first = self._touch.begin(obs)
            self._transition(Trigger.TARED, obs, "rest counts taken", first)
        else:
            thumb, _, _ = self._plan.preshape_counts
            _, b, c = self._plan.grip_counts
            self._transition(Trigger.TARED, obs, "rest counts taken", self._grip((thumb, b, c)))

    def _brace(self, obs: Observation) -> None:
        """B and C close first, so that only the thumb, which closes last, presses on the object."""
        if self._touch:
            self._close_by_touch(obs, self._touch)
            return
        thumb_n, *others_n = obs.estimated_n
        pressed = min(thumb_n, max(others_n)) >= self._settings.contact_n
        if pressed and not implausible(obs.reported, FINGERTIPS):
            self._fail(obs, f"the thumb touches while it waits: {WIDE}", WIDE_REMEDY)
        elif self._grip_complete(obs):
            cause = "fingers B and C rest at their positions"
            self._transition(Trigger.BRACED, obs, cause, self._grip(self._plan.grip_counts))

    def _close(self, obs: Observation) -> None:
        """The thumb closes to its position; for a firm grip it then closes to the force limit."""
        if self._touch and not self._touch.complete:
            self._close_by_touch(obs, self._touch)
            return
        if not self._grip_complete(obs):
            return
        cause = "fingers rest at their positions"
        if self._settings.firm and not self._firm:
            self._firm = True
            self._transition(Trigger.TIGHTEN, obs, cause, self.response.closing_at_least_speed())
        else:
            cause = "the thumb stopped at the force limit" if self._firm else cause
            self._transition(Trigger.GRIPPED, obs, cause)
            self._reset_detector = True

    def _close_by_touch(self, obs: Observation, touch: Touch) -> None:
        command = touch.update(obs)
        commands = () if command is None else (command,)
        if touch.failed:
            self._fail(obs, *touch.failed)
        elif touch.complete:
            self._transition(Trigger.GRIPPED, obs, "the fingertips feel the first force")
            self._reset_detector = True
        elif self.state is State.BRACE and touch.braced:
            self._transition(Trigger.BRACED, obs, "B and C wait, or touch the object", *commands)
        else:
            self._commands += commands

    def _settle(self, obs: Observation) -> None:
        if not (self._grip_complete(obs) and self._lasted(obs, self._settings.settle_s)):
            return
        finger = min((1, 2), key=lambda i: obs.estimated_n[i])
        unloaded = obs.estimated_n[finger] < LOADED_SHARE * self._settings.contact_n
        # a thumb without contact ends the run later; implausible fingertips prove nothing
        if unloaded and not (self._contact.thumb_lost or implausible(obs.reported, FINGERTIPS)):
            self._load_finger(obs, finger)
        else:
            self._transition(Trigger.SETTLED, obs, "pads relaxed")
            self._reset_detector = True
            self.slip_monitor.arm()

    def _load_finger(self, obs: Observation, finger: int) -> None:
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
            self._transition(Trigger.TIGHTEN, obs, cause, self._grip((a, b, c)))
            return
        load = f"its fingertip shows {obs.estimated_n[first]:.2f} N after {steps} more counts"
        if dead:
            load += f", while the thumb rose by {rise_n:.1f} N: the fingertip may be dead"
        most = f"at most {LOADING_STEPS} are tried, while the thumb stays within {limit_n:g} N"
        self._fail(obs, f"{cause}: {load}; {most}", UNLOADED_REMEDY)

    def _baseline(self, obs: Observation) -> None:
        if not self._grip_complete(obs):
            return
        if self._contact.thumb_lost:
            self._fail(obs, "no contact at the thumb's position: no object, or a narrower one")
        elif self._lasted(obs, self._settings.baseline_s):
            move = self._line.move(self._settings.lift_height_m, self._settings.lift_speed_mps)
            self._transition(Trigger.READY, obs, "the detector has its baseline", move)
            self._first_grasp = True

    # In the air

    def _lift(self, obs: Observation) -> None:
        if not self._respond_to_slip(obs) and self._line.stopped_at(
            obs, self._settings.lift_height_m
        ):
            self._transition(Trigger.AT_TOP, obs, "arm at the top")

    def _rising(self, obs: Observation) -> bool:
        return self.state is State.LIFT  # in `hold` the arm is at rest

    def _respond_to_slip(self, obs: Observation) -> bool:
        """Respond to slip or lost contact, or add a due margin. Return whether a response started
        or the object is lost."""
        slip, lost = self.slip_monitor.status, self._contact.thumb_lost
        rising = self._rising(obs)
        # with `hold_by_clock` slip at the limit is ignored: no closing and no set-down could follow
        ignored = self._settings.hold_by_clock and obs.at_limit
        if lost and obs.at_limit:
            self._lose(obs, "contact lost, and the thumb can close no further")
        elif self._settings.reactions and (lost or (slip.registered and not ignored)):
            registered = f"slip registered at finger {FINGER_NAMES[slip.finger]}"
            first = self.response.begin(obs, rising, lost)
            self._transition(Trigger.SLIP, obs, "contact lost" if lost else registered, *first)
        elif margin := self.response.follow_up(obs, rising):
            cause = "the force that ended slip has carried the object: margin added"
            self._transition(Trigger.SLIP, obs, cause, *margin)
        else:
            return False
        return True

    def _compensate(self, obs: Observation) -> None:
        slip, response = self.slip_monitor.status, self.response
        alarm = slip.registered or slip.masked or not obs.hand_rests
        response.update(obs, alarm, self._timer.elapsed_ns)
        self._repeat_stop(obs, response.arm_stop)
        if not obs.hand_rests:
            self.slip_monitor.closing(obs.t_ns)
        elif obs.second_stage_due:  # of the same response
            self.slip_monitor.closing(obs.t_ns)
            self._commands.append(response.closing(obs, self._contact.thumb_lost))
        elif self._contact.thumb_lost:
            self._lose(obs, "the hand closed and met no object")
        elif slip.masked:
            pass  # the pads still vibrate from the closing
        elif response.exhausted and not self._settings.hold_by_clock:
            self._give_up(obs, "slip recurs and the force cannot rise further")
        elif slip.registered:
            self._handle_continuing_slip(obs)
        elif response.over(obs):
            self._resume(obs, "slip has stopped")

    def _handle_continuing_slip(self, obs: Observation) -> None:
        """Handle slip that is still registered after the closing and its mask have ended."""
        s = self._settings
        waited_ns = obs.t_ns - max(self._timer.entered_ns, self.slip_monitor.masked_until_ns)
        more = self.response.escalate(obs, waited_ns)
        if more is not None:
            self._commands += more
        elif s.hold_by_clock:
            self._resume(obs, "slip continues; the hold ends after hold_s")
        elif waited_ns >= s.limit_patience_s * 1e9:
            self._give_up(obs, "slip continues and the force cannot rise further")

    def _give_up(self, obs: Observation, cause: str) -> None:
        """Set the object down, because the force cannot rise further."""
        self.limit_reached = True
        self._lower(obs, cause)

    def _resume(self, obs: Observation, cause: str) -> None:
        resume = self.response.end()
        if self._line.stopped_at(obs, self._settings.lift_height_m):
            self._transition(Trigger.AT_TOP, obs, cause)
        else:
            self._transition(Trigger.STEADY, obs, cause, *resume)

    def _hold(self, obs: Observation) -> None:
        """Hold for ``hold_s`` after the last response to slip. Alarms that no closing can end
        extend the hold. It then ends at most ``hold_s`` plus ``ALARM_HOLD_NS`` after the arm first
        arrived at the top."""
        s, set_down = self._settings, obs.set_down
        held_ns = obs.t_ns - self.machine.first_ns(State.HOLD)
        over = s.hold_by_clock and held_ns >= s.hold_s * 1e9
        futile = held_ns >= s.hold_s * 1e9 + ALARM_HOLD_NS and obs.closing_exhausted
        if not (over or futile) and self._respond_to_slip(obs):
            return
        if over or futile or set_down or self._lasted(obs, s.hold_s):
            self.alarm_stayed = self.slip_monitor.status.registered
            if s.keep:
                self._transition(Trigger.KEEP, obs, "held long enough")
            else:
                self._lower(obs, "set-down requested" if set_down else "held long enough")

    # Set down

    def _lower(self, obs: Observation, cause: str) -> None:
        self.slip_monitor.disarm()
        self._apply(obs, self._set_down.begin(cause))

    def _descend(self, obs: Observation) -> None:
        self._apply(obs, self._set_down.descend(obs))

    def _feel(self, obs: Observation) -> None:
        if transition := self._set_down.feel(obs):
            self._apply(obs, transition)
        else:
            self._repeat_stop(obs, self._set_down.arm_stop)

    def _apply(self, obs: Observation, transition: Transition | None) -> None:
        if transition and transition.trigger is Trigger.LOSE:
            self._lose(obs, transition.cause)
        elif transition:
            self._transition(transition.trigger, obs, transition.cause, *transition.commands)

    def _open(self, obs: Observation) -> None:
        if obs.hand_rests and not obs.gripper.is_open:
            self._fail(obs, f"the fingers stopped at {obs.gripper.positions} counts: not open")
        elif obs.hand_rests:
            move = self._line.move(self._set_down.clear_m, self._settings.lower_speed_mps)
            self._transition(Trigger.OPENED, obs, "fingers open", move)

    def _retreat(self, obs: Observation) -> None:
        if obs.hand_rests and self._line.stopped_at(obs, self._set_down.clear_m):
            self._transition(Trigger.CLEAR, obs, "arm clear")

    # From any state

    def _lose(self, obs: Observation, cause: str) -> None:
        """The object is lost: stop the arm and lower nothing."""
        faults = (Fault(LOST, TRIAL, cause, kind=LOST),)
        self._enter_safe_state(Trigger.LOSE, obs, faults, cause)

    def _fail(self, obs: Observation, cause: str, remedy: str = "") -> None:
        """End the run because the grasp failed, although no device did."""
        self._enter_safe_state(Trigger.FAIL, obs, (Fault("grasp_failed", TRIAL, cause, remedy),))

    def _enter_safe_state(
        self, trigger: Trigger, obs: Observation, faults: tuple[Fault, ...] = (), cause: str = ""
    ) -> None:
        self.faults = faults
        self._transition(trigger, obs, cause or lines(faults))
        before = self.machine.before
        half_closed = before is State.COMPENSATE and obs.first_stage
        safe = SafeState(self.state, before, obs.t_ns, self.faults, half_closed)
        self._supervisor = SafeStateSupervisor(safe, self._settings, self.response)
        self._commands += self._supervisor.request(obs)

    # What handlers share

    def _transition(
        self, trigger: Trigger, obs: Observation, cause: str, *commands: Command
    ) -> None:
        """Leave the present state, with the commands whose effect the next state waits for."""
        self.machine.fire(trigger, obs.t_ns, cause)
        self._timer.restart(obs.t_ns)
        self._commands += commands

    def _lasted(self, obs: Observation, duration_s: float) -> bool:
        """Whether the present state has lasted for ``duration_s``."""
        return obs.t_ns - self._timer.entered_ns >= duration_s * 1e9

    def _repeat_stop(self, obs: Observation, stop: StopArm | None) -> None:
        """Repeat the arm stop with which this state began while the arm still moves: the command
        may have been lost."""
        if stop and obs.arm.moving and not obs.pending and self._timer.repeat_due(obs.t_ns):
            self._commands.append(stop)

    def _preshape(self) -> MoveFingers:
        s = self._settings
        return MoveFingers(self._plan.shape_counts, s.approach_speed_mps, s.grip_force_n)

    def _grip(self, targets: Counts3) -> MoveFingers:
        return MoveFingers(targets, self._settings.grip_speed_mps, self._settings.grip_force_n)

    def _grip_complete(self, obs: Observation) -> bool:
        """Whether the fingers are at rest in the planned grip. Ends the run where a finger stopped
        on contact short of its position, or the thumb of a firm grip met no object."""
        if not obs.hand_rests:
            return False
        if self._firm and not obs.gripper.thumb_latched:
            self._fail(obs, "the thumb closed fully and met no object")
            return False
        if not self._firm and not self._touch and (name := obs.gripper.not_at_target):
            self._fail(obs, f"finger {name} {SHORT}", WIDE_REMEDY)
            return False
        return True
