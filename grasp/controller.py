"""GraspController: one pure step from an observation to commands, one handler for each state."""

import math
from collections.abc import Callable
from contextlib import suppress

import msgspec

from drivers.interfaces import FINGER_NAMES, OPEN_COUNTS, Counts3, Detection, Vector3
from grasp.commands import BeginRest, Command, HoldFingers, MoveFingers, StopArm
from grasp.contact_estimator import ContactEstimator
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.fault import LOST, TRIAL, Fault, lines
from grasp.lift_progress import AT_HEIGHT_M, LiftLine, StateClock
from grasp.monitors.run import RunMonitor
from grasp.observation import Observation
from grasp.safe_state import Missing, Pursuit, SafeState
from grasp.set_down import SetDown, Transition
from grasp.slip_monitor import SlipMonitor, SlipStatus
from grasp.slip_response import RESPONSES
from grasp.states import AIRBORNE_STATES, END_STATES, State, StateMachine, Trigger

ALARM_HOLD_NS = 2_000_000_000  # longest extension of a hold by futile alarms; assumed


class Decision(msgspec.Struct, frozen=True):
    """Result of one step."""

    state: State
    slip: SlipStatus
    commands: tuple[Command, ...]
    reset_detector: bool = False
    anchor: bool = False  # the first grasp is complete: the guard counts travel from here
    finished: bool = False  # nothing more will follow


class GraspController:
    """Grasps, lifts, responds to slip, holds, sets down; ``step`` once a tactile sample.

    What a state has to remember beyond its begin is kept by the slip response, the set-down and,
    once a run has ended early, the safe state.
    """

    def __init__(self, settings: ControllerSettings, plan: GripPlan, monitor: SlipMonitor) -> None:
        self._settings = settings
        self._plan = plan
        self.monitor = monitor
        self.machine = StateMachine()
        self.cap_reached = False
        self.alarm_stayed = False  # slip was still registered when the hold ended
        self.faults: tuple[Fault, ...] = ()  # why the run ended early
        self._pursuit: Pursuit | None = None  # of the safe state, once one was entered
        self._line = LiftLine(settings, plan.home or (0.0, 0.0, 0.0))  # by `_start` without one
        self._contact = ContactEstimator(settings.contact_n)
        self._clock = StateClock()
        self._run_monitor = RunMonitor(settings, self._clock, self._contact)
        self._set_down = SetDown(settings, self._line, self._contact, self._clock)
        self.response = RESPONSES[settings.slip_response](settings, plan, self._line)
        self._firm = False  # the grip is being closed to the force cap
        self._commands: list[Command] = []  # of this step, as are the next two
        self._reset_detector = self._anchor = False
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
        return self.state in END_STATES or (self._pursuit is not None and self._pursuit.over)

    @property
    def in_safe_state(self) -> bool:
        return self._pursuit is not None

    @property
    def fault_cause(self) -> str:
        """Why the run ended early, in one line; empty if it did not."""
        return lines(self.faults)

    @property
    def further(self) -> tuple[Fault, ...]:
        """Checks that failed since the safe state was entered."""
        return self._pursuit.further if self._pursuit else ()

    @property
    def unreached(self) -> tuple[str, ...]:
        """Parts of the safe state that were not observed when the run ended."""
        return self._pursuit.unreached if self._pursuit else ()

    @property
    def excused_ns(self) -> float:
        """By how much an arm that was slowed down has prolonged the run."""
        return self._clock.excused_ns

    def step(self, obs: Observation) -> Decision:
        """Take one observation; returns the commands that follow from it."""
        self._commands = []
        self._reset_detector = self._anchor = False
        self._clock.update(obs, self.state)
        self.monitor.update(obs.t_ns, obs.probabilities)
        self._contact.update(obs, self.state in AIRBORNE_STATES)
        responding = self.state is State.COMPENSATE and not self.response.adds_margin
        if responding or self.monitor.status.registered:
            self._set_down.slipping(obs)
        if self._pursuit:
            self._commands += self._pursuit.step(obs)
        elif faults := self._run_monitor.check(obs, self.state):
            self._enter_safe_state(Trigger.FAIL, obs, faults)
        elif obs.inputs.stop:
            self._enter_safe_state(Trigger.STOP, obs, (obs.inputs.stop,))
        elif self.state not in END_STATES:
            self._handlers[self.state](obs)
        return Decision(
            self.state, self.monitor.status, tuple(self._commands),
            self._reset_detector, self._anchor, self.finished,
        )  # fmt: skip

    def aborted(self) -> tuple[Command, ...]:
        """Commands for when no step can be taken any more: of the safe state that was entered, else
        of a fault's."""
        hand: tuple[Command, ...] = (HoldFingers(),)  # where a bug prevents these
        with suppress(Exception):
            hand = self._aborted.of_hand(self.response.slow_closing())
        return (StopArm(self._settings.stop_deceleration_mps2), *hand)

    def missing(self, obs: Observation) -> Missing:
        """Parts of that safe state that were not observed; a stale hand counts as not observed."""
        stale_ns = self._settings.stale_after_s * 1e9
        if obs.gripper.age_ns(obs.t_ns) > stale_ns:
            inputs = msgspec.structs.replace(obs.inputs, gripper_lost=True)
            obs = msgspec.structs.replace(obs, inputs=inputs)
        safe = self._aborted
        return Missing(safe.missing_of_arm(obs, stale_ns), safe.missing_of_hand(obs))

    @property
    def _aborted(self) -> SafeState:
        if self._pursuit:
            return self._pursuit.safe
        return SafeState(State.FAULT, self.state, self._clock.entered_ns)

    # Approach

    def _start(self, obs: Observation) -> None:
        """A hand that is not open ends the run before anything moves."""
        if self._plan.home is None:
            self._line.home = obs.arm.position_m
        if any(f.detection is Detection.CONTACT_CLOSING for f in obs.gripper.fingers):
            self._fail(obs, "the hand is closed, and may hold something")
        elif max(obs.gripper.positions) > OPEN_COUNTS:  # a grip by position reports no contact
            self._fail(obs, "the hand is not open: what it may hold would fall, or be hit")
        elif math.dist(obs.arm.position_m, self.home) < AT_HEIGHT_M:
            self._go(Trigger.AT_HOME, obs, "run started", self._preshape())
        else:
            move = self._line.down(0.0, self._settings.lower_speed_mps)
            self._go(Trigger.AWAY, obs, "run started", move)

    def _home(self, obs: Observation) -> None:
        if obs.hand_rests and self._line.stands_at(obs, 0.0):
            self._go(Trigger.AT_HOME, obs, "arm home", self._preshape())

    def _shape(self, obs: Observation) -> None:
        if not obs.hand_rests or not self._line.stands_at(obs, 0.0):
            return
        if obs.gripper.requested != self._plan.preshape_counts:  # the command was lost
            self._commands.append(self._preshape())
        else:
            self._go(Trigger.SHAPED, obs, "fingers short of the object", BeginRest())

    # Grasp

    def _tare(self, obs: Observation) -> None:
        if obs.hand_rests and obs.inputs.rest_taken:
            thumb, _, _ = self._plan.preshape_counts
            _, b, c = self._plan.grip_counts
            self._go(Trigger.TARED, obs, "rest counts taken", self._grip((thumb, b, c)))

    def _brace(self, obs: Observation) -> None:
        """B and C close first; only the thumb, closing last, presses, against both of them."""
        if self._grip_rests(obs):
            cause = "fingers B and C rest at their positions"
            self._go(Trigger.BRACED, obs, cause, self._grip(self._plan.grip_counts))

    def _close(self, obs: Observation) -> None:
        """The thumb to its position, and for a firm grip further until it stops at the cap."""
        if not self._grip_rests(obs):
            return
        cause = "fingers rest at their positions"
        if self._settings.firm and not self._firm:
            self._firm = True
            self._go(Trigger.TIGHTEN, obs, cause, self.response.slow_closing())
        else:
            cause = "the thumb stopped at the force cap" if self._firm else cause
            self._go(Trigger.GRIPPED, obs, cause)
            self._reset_detector = True

    def _settle(self, obs: Observation) -> None:
        if self._grip_rests(obs) and self._lasted(obs, self._settings.settle_s):
            self._go(Trigger.SETTLED, obs, "pads relaxed")
            self._reset_detector = True
            self.monitor.arm()

    def _baseline(self, obs: Observation) -> None:
        if not self._grip_rests(obs):
            return
        if self._contact.thumb_lost:
            self._fail(obs, "the thumb feels nothing at its position: no object, or a narrower one")
        elif self._lasted(obs, self._settings.baseline_s):
            move = self._line.move(self._settings.lift_height_m, self._settings.lift_speed_mps)
            self._go(Trigger.READY, obs, "the detector has listened", move)
            self._anchor = True

    # In the air

    def _lift(self, obs: Observation) -> None:
        if not self._responds(obs) and self._line.stands_at(obs, self._settings.lift_height_m):
            self._go(Trigger.AT_TOP, obs, "arm at the top")

    def _responds(self, obs: Observation) -> bool:
        """Whether slip, lost contact or a margin that is due made the state change."""
        slip, lost = self.monitor.status, self._contact.thumb_lost
        rising = self.state is State.LIFT  # in `hold` the arm stands
        ignored = self._settings.hold_by_clock and obs.at_cap
        if lost and obs.at_cap:
            self._lose(obs, "contact lost, and the thumb can close no further")
        elif self._settings.reactions and (lost or (slip.registered and not ignored)):
            slips = f"slip registered at finger {FINGER_NAMES[slip.finger]}"
            first = self.response.begin(obs, rising, lost)
            self._go(Trigger.SLIP, obs, "contact lost" if lost else slips, *first)
        elif more := self.response.follow_up(obs, rising):
            self._go(Trigger.SLIP, obs, "the force that was found has carried the object", *more)
        else:
            return False
        return True

    def _compensate(self, obs: Observation) -> None:
        slip, response = self.monitor.status, self.response
        alarm = slip.registered or slip.masked or not obs.hand_rests
        response.update(obs, alarm, self._clock.passed_ns)
        self._stop_again(obs, response.arm_stop)
        if not obs.hand_rests:
            self.monitor.closing(obs.t_ns)
        elif obs.unfinished:  # the same response goes on
            self.monitor.closing(obs.t_ns)
            self._commands.append(response.closing(obs, self._contact.thumb_lost))
        elif self._contact.thumb_lost:
            self._lose(obs, "the hand closed and met nothing")
        elif slip.masked:
            pass  # the pads still shake from our own closing
        elif response.exhausted and not self._settings.hold_by_clock:
            self._give_up(obs, "slip comes back and the force can rise no more")
        elif slip.registered:
            self._slip_goes_on(obs)
        elif response.over(obs):
            self._go_on(obs, "slip has stopped")

    def _slip_goes_on(self, obs: Observation) -> None:
        """Slip is registered although the hand rests and nothing is masked any more."""
        s = self._settings
        waited_ns = obs.t_ns - max(self._clock.entered_ns, self.monitor.masked_until_ns)
        more = self.response.escalate(obs, waited_ns)
        if more is not None:
            self._commands += more
        elif s.hold_by_clock:
            self._go_on(obs, "slip goes on, and the hold ends by its clock")
        elif waited_ns >= s.cap_patience_s * 1e9:
            self._give_up(obs, "slip goes on and the force can rise no more")

    def _give_up(self, obs: Observation, cause: str) -> None:
        """No more force is possible: set the object down."""
        self.cap_reached = True
        self._lower(obs, cause)

    def _go_on(self, obs: Observation, cause: str) -> None:
        resume = self.response.end()
        if self._line.stands_at(obs, self._settings.lift_height_m):
            self._go(Trigger.AT_TOP, obs, cause)
        else:
            self._go(Trigger.STEADY, obs, cause, *resume)

    def _hold(self, obs: Observation) -> None:
        """Ends ``hold_s`` after the last response to slip. Alarms that no closing can end prolong
        it from the arm's first arrival at the top by no more than ``ALARM_HOLD_NS``."""
        s, set_down = self._settings, obs.inputs.set_down
        held_ns = obs.t_ns - self.machine.first_ns(State.HOLD)
        over = s.hold_by_clock and held_ns >= s.hold_s * 1e9
        futile = obs.closed_out and held_ns >= s.hold_s * 1e9 + ALARM_HOLD_NS
        if not (over or futile) and self._responds(obs):
            return
        if over or futile or set_down or self._lasted(obs, s.hold_s):
            self.alarm_stayed = self.monitor.status.registered
            if s.keep:
                self._go(Trigger.KEEP, obs, "held long enough")
            else:
                self._lower(obs, "asked to set down" if set_down else "held long enough")

    # Set down

    def _lower(self, obs: Observation, cause: str) -> None:
        self.monitor.disarm()
        self._follow(obs, self._set_down.begin(cause))

    def _descend(self, obs: Observation) -> None:
        self._follow(obs, self._set_down.descend(obs))

    def _feel(self, obs: Observation) -> None:
        if transition := self._set_down.feel(obs):
            self._follow(obs, transition)
        else:
            self._stop_again(obs, self._set_down.arm_stop)

    def _follow(self, obs: Observation, transition: Transition | None) -> None:
        if transition and transition.trigger is Trigger.LOSE:
            self._lose(obs, transition.cause)
        elif transition:
            self._go(transition.trigger, obs, transition.cause, *transition.commands)

    def _open(self, obs: Observation) -> None:
        if obs.hand_rests and not obs.gripper.is_open:
            self._fail(obs, f"the fingers stopped at {obs.gripper.positions} counts: not open")
        elif obs.hand_rests:
            move = self._line.move(self._set_down.clear_m, self._settings.lower_speed_mps)
            self._go(Trigger.OPENED, obs, "fingers open", move)

    def _retreat(self, obs: Observation) -> None:
        if obs.hand_rests and self._line.stands_at(obs, self._set_down.clear_m):
            self._go(Trigger.CLEAR, obs, "arm clear")

    # From any state

    def _lose(self, obs: Observation, cause: str) -> None:
        """The object is lost: the arm stops, and nothing is lowered."""
        faults = (Fault(LOST, TRIAL, cause, kind=LOST),)
        self._enter_safe_state(Trigger.LOSE, obs, faults, cause)

    def _fail(self, obs: Observation, cause: str) -> None:
        """The grasp failed, though no device did."""
        self._enter_safe_state(Trigger.FAIL, obs, (Fault("grasp_failed", TRIAL, cause),))

    def _enter_safe_state(
        self, trigger: Trigger, obs: Observation, faults: tuple[Fault, ...] = (), cause: str = ""
    ) -> None:
        self.faults = faults
        self._go(trigger, obs, cause or lines(faults))
        before = self.machine.before
        half_closed = before is State.COMPENSATE and obs.first_stage
        safe = SafeState(self.state, before, obs.t_ns, self.faults, half_closed)
        self._pursuit = Pursuit(safe, self._settings, self.response)
        self._commands += self._pursuit.ask(obs)

    # What handlers share

    def _go(self, trigger: Trigger, obs: Observation, cause: str, *commands: Command) -> None:
        """Leave the present state, with the commands whose effect the next one waits for."""
        self.machine.fire(trigger, obs.t_ns, cause)
        self._clock.restart(obs.t_ns)
        self._commands += commands

    def _lasted(self, obs: Observation, duration_s: float) -> bool:
        """Whether the present state has lasted this long."""
        return obs.t_ns - self._clock.entered_ns >= duration_s * 1e9

    def _stop_again(self, obs: Observation, stop: StopArm | None) -> None:
        """Repeat the stop that this state began with while the arm moves: it may have been lost."""
        if stop and obs.arm.moving and not obs.pending and self._clock.ask_again(obs.t_ns):
            self._commands.append(stop)

    def _preshape(self) -> MoveFingers:
        s = self._settings
        return MoveFingers(self._plan.preshape_counts, s.approach_speed_mps, s.grip_force_n)

    def _grip(self, targets: Counts3) -> MoveFingers:
        return MoveFingers(targets, self._settings.grip_speed_mps, self._settings.grip_force_n)

    def _grip_rests(self, obs: Observation) -> bool:
        """Whether the fingers rest in the grip that is wanted. Fails where a finger stopped on
        contact short of its position, or the thumb of a firm grip closed on nothing."""
        if not obs.hand_rests:
            return False
        if self._firm and not obs.gripper.thumb_latched:
            self._fail(obs, "the thumb closed as far as it goes and met nothing")
            return False
        if not self._firm and (name := obs.gripper.not_at_target):
            short = f"finger {name} stopped on contact short of its position: it is latched and "
            self._fail(obs, f"{short}could not be closed further at this force")
            return False
        return True
