"""ReflexController: waits until a policy's grip rests, then responds to slip while it holds.

The rules that it serves are in `grasp.policy_reflex`, which limits what the policy commands.
"""

from collections.abc import Callable

import msgspec

from drivers.interfaces import OPEN_COUNTS, Counts3, Detection, Vector3
from grasp.control.compensation import Compensation
from grasp.control.contact_estimator import ContactEstimator
from grasp.control.controller_settings import ControllerSettings, GripPlan
from grasp.control.fault import Fault
from grasp.control.lift_line import LiftLine
from grasp.control.monitors.run import RunMonitor
from grasp.control.observation import Observation
from grasp.control.safe_state import SafeStateSupervisor
from grasp.control.slip_monitor import SlipMonitor
from grasp.control.slip_response import RESPONSES
from grasp.control.state_timer import StateTimer
from grasp.control.states import AIRBORNE_STATES, State, StateMachine, Transitions, Trigger
from grasp.control.transition import Decision, Transition, end, stay

HELD_STATES = frozenset({State.HOLD, State.COMPENSATE})
TRANSITIONS: Transitions = (
    (Trigger.GRIPPED, (State.CLOSE,), State.SETTLE),
    (Trigger.TIGHTEN, (State.SETTLE,), State.CLOSE),
    (Trigger.SETTLED, (State.SETTLE,), State.HOLD),
    (Trigger.SLIP, (State.HOLD,), State.COMPENSATE),
    (Trigger.STEADY, (State.COMPENSATE,), State.HOLD),
    (Trigger.LOSE, (State.HOLD, State.COMPENSATE), State.LOST),
    (Trigger.FAIL, (State.CLOSE, State.SETTLE, State.HOLD, State.COMPENSATE), State.FAULT),
)


class ReflexController:
    """States `grasp.close` (the policy moves), `grasp.settle`, `hold`, `compensate`; a safe state
    lasts until another controller is made. Call ``step`` once a tactile sample; the arm belongs to
    the policy, so that only the commands to the hand are meant to be sent."""

    def __init__(self, settings: ControllerSettings, plan: GripPlan, monitor: SlipMonitor) -> None:
        settings = msgspec.structs.replace(settings, hold_by_clock=False, reactions=True)
        self._settings = settings
        self.slip_monitor = monitor
        self.machine = StateMachine(State.CLOSE, TRANSITIONS)
        self.limit_reached = False  # slip continued at the force limit: it must be set down
        self.faults: tuple[Fault, ...] = ()
        self._supervisor: SafeStateSupervisor | None = None
        self._line = LiftLine(settings, plan.home or (0.0, 0.0, 0.0))
        self._contact = ContactEstimator(settings.contact_n)
        self._timer = StateTimer()
        self._run_monitor = RunMonitor(settings, self._timer, self._contact)
        self.response = RESPONSES[settings.slip_response](settings, plan, self._line)
        self._compensation = Compensation(
            settings, monitor, self._contact, self._timer, self.response
        )
        self._positions: Counts3 | None = None  # at the sample before
        self._reset_detector = False
        self._handlers: dict[State, Callable[[Observation], Transition | None]] = {
            State.CLOSE: self._close, State.SETTLE: self._settle,
            State.HOLD: self._hold, State.COMPENSATE: self._compensate,
        }  # fmt: skip

    @property
    def state(self) -> State:
        return self.machine.state

    @property
    def home(self) -> Vector3:
        """Position of the arm where the object was first held."""
        return self._line.home

    @property
    def held(self) -> bool:
        return self.state in HELD_STATES

    @property
    def in_safe_state(self) -> bool:
        return self._supervisor is not None

    def step(self, obs: Observation) -> Decision:
        """Take one observation; returns the decision, with the commands due."""
        state = self.state
        self._reset_detector = False
        self._timer.update(obs, state)
        self.slip_monitor.update(obs.t_ns, obs.probabilities)
        self._contact.update(obs, state in AIRBORNE_STATES)
        transition = self._transition(obs, state)
        commands = transition.commands if transition else ()
        trigger = transition.trigger if transition else None
        if transition and trigger:
            self.machine.fire(trigger, obs.t_ns, transition.cause)
            self._timer.restart(obs.t_ns)
        if transition and transition.faults:
            self.faults = transition.faults
            self._supervisor = SafeStateSupervisor.enter(
                self.machine, obs, self.faults, self._settings, self.response
            )
            commands = self._supervisor.request(obs)
        return Decision(
            self.state,
            self.slip_monitor.status,
            commands,
            reset_detector=self._reset_detector,
            first_grasp=trigger is Trigger.SETTLED,
        )

    def touches(self, obs: Observation) -> bool:
        """Whether any finger is in contact, by its fingertip or, as that may be silent, by the
        hand."""
        closed = max(obs.gripper.positions) > OPEN_COUNTS
        stopped = any(f.detection is Detection.CONTACT_CLOSING for f in obs.gripper.fingers)
        return closed and (stopped or max(obs.estimated_n) >= self._settings.contact_n)

    def grips(self, obs: Observation) -> bool:
        """Whether the thumb and an opposing finger are in contact."""
        some, opposing = max(obs.estimated_n), max(obs.estimated_n[1:])
        contact_n, closed = self._settings.contact_n, max(obs.gripper.positions) > OPEN_COUNTS
        both = min(some, opposing) >= contact_n
        return closed and both and not self._contact.thumb_lost

    def _transition(self, obs: Observation, state: State) -> Transition | None:
        if self._supervisor:
            return stay(*self._supervisor.step(obs))
        if faults := self._run_monitor.check(obs, state):
            return end(Trigger.FAIL, faults)
        return self._handlers[state](obs)

    def _close(self, obs: Observation) -> Transition | None:
        self._timer.restart(obs.t_ns)  # a policy may take its time
        if not (obs.hand_rests and self.grips(obs)):
            return None
        self._reset_detector = True
        return Transition(Trigger.GRIPPED, "the hand rests in contact")

    def _settle(self, obs: Observation) -> Transition | None:
        s = self._settings
        waited_s = (obs.t_ns - self._timer.entered_ns) * 1e-9
        if not obs.hand_rests or self._contact.thumb_lost:
            self.slip_monitor.disarm()
            return Transition(Trigger.TIGHTEN, "the fingers move, or contact is lost")
        if not self.slip_monitor.status.armed and waited_s >= s.settle_s:
            self._reset_detector = True
            self.slip_monitor.arm()
        elif waited_s >= s.settle_s + s.baseline_s:
            self._line.home = obs.arm.position_m
            return Transition(Trigger.SETTLED, "the detector has its baseline")
        return None

    def _hold(self, obs: Observation) -> Transition | None:
        moved = self._positions not in (None, obs.gripper.positions)
        self._positions = obs.gripper.positions
        if moved and not obs.hand_rests:  # the policy closes it, and that shakes the pads
            self.slip_monitor.closing(obs.t_ns)
            return None
        return self._compensation.begin(obs, rising=obs.arm.moving)

    def _compensate(self, obs: Observation) -> Transition | None:
        decided = self._compensation.update(obs)
        if decided and decided.trigger is Trigger.LOWER:
            self.limit_reached = True
            return None
        if decided and decided.trigger is Trigger.STEADY:
            self.response.end()
        return decided
