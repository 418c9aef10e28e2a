"""GraspController: one pure step from an observation to commands.

No clock is read, nothing sleeps, nothing does I/O, so a run on the wire, a run in virtual time and
the replay of a recording are the same code.
"""

import math
from collections.abc import Callable

import msgspec

from drivers.errors import SuppressBugs
from drivers.interfaces import FINGER_NAMES, OPEN_COUNTS, Counts3, Detection, Vector3
from grasp.commands import (
    BeginRest,
    Command,
    HoldFingers,
    MoveFingers,
    StopArm,
)
from grasp.contact_estimator import ContactEstimator
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.lift_line import AT_HEIGHT_M, LiftLine
from grasp.observation import Observation
from grasp.phases import (
    AIRBORNE_PHASES,
    END_PHASES,
    LOWERING_PHASES,
    OPEN_PHASES,
    Phase,
    PhaseMachine,
    Trigger,
)
from grasp.safe_state import Missing, Pursuit, SafeState
from grasp.set_down import SetDown, Way
from grasp.slip_monitor import SlipMonitor, SlipStatus
from grasp.slip_response import make_response
from grasp.state_clock import StateClock

OVERLOAD_NS = 30_000_000  # measured force may be so long above the limit in motion; assumed
ALARM_HOLD_NS = 2_000_000_000  # alarms that no closing answers prolong a hold by this; assumed
UNTIMED_PHASES = END_PHASES | {Phase.IDLE, Phase.HOLD}
ARM_PHASES = frozenset({  # over once it arrives
    Phase.HOME, Phase.APPROACH, Phase.LIFT, Phase.LOWER, Phase.LAND, Phase.RETREAT,
})  # fmt: skip


class Decision(msgspec.Struct, frozen=True):
    """What one step wants done."""

    phase: Phase
    slip: SlipStatus
    commands: tuple[Command, ...]
    reset_detector: bool = False
    anchor: bool = False  # the first grasp stands: the guard bounds travel from here
    finished: bool = False  # nothing more will follow


class GraspController:
    """Grasps, lifts, answers slip, holds, sets down. Feed ``step`` once a tactile sample.

    Where it stands is the phase and when that began. Beside it there are what the thumb has felt,
    what the way down has to know, and once a run has ended early the safe state that is asked for.
    """

    def __init__(self, settings: ControllerSettings, plan: GripPlan, monitor: SlipMonitor) -> None:
        self._settings = settings
        self._plan = plan
        self.monitor = monitor
        self.machine = PhaseMachine()
        self.cap_reached = False
        self.alarm_stayed = False  # the hold ended although slip was still registered
        self.fault_cause = ""
        self._pursuit: Pursuit | None = None  # of the safe state that was entered
        self._line = LiftLine(settings, plan.home or (0.0, 0.0, 0.0))  # without one, set by `_idle`
        self._contact = ContactEstimator(settings.contact_n)
        self._clock = StateClock()
        self._way_down = SetDown(settings, self._line, self._contact, self._clock)
        self.response = make_response(settings, plan, self._line)
        self._out: list[Command] = []
        self._reset_detector = False
        self._anchor = False
        self._handlers: dict[Phase, Callable[[Observation], None]] = {
            Phase.IDLE: self._idle,
            Phase.HOME: self._return,
            Phase.APPROACH: self._approach,
            Phase.REST: self._rest,
            Phase.GRASP: self._grasp,
            Phase.OPPOSE: self._oppose,
            Phase.SQUEEZE: self._squeeze,
            Phase.RELAX: self._relax,
            Phase.LISTEN: self._listen,
            Phase.LIFT: self._lift,
            Phase.COMPENSATE: self._compensate,
            Phase.HOLD: self._hold,
            **dict.fromkeys(LOWERING_PHASES, self._go_down),
            Phase.RELEASE: self._release,
            Phase.RETREAT: self._retreat,
            **dict.fromkeys(END_PHASES, self._rest_at_end),
        }

    @property
    def phase(self) -> Phase:
        return self.machine.phase

    @property
    def home(self) -> Vector3:
        """Of the arm, where the lift begins."""
        return self._line.home

    @property
    def closings(self) -> int:
        """How often slip or lost contact was answered by closing."""
        return self.response.closings

    @property
    def finished(self) -> bool:
        """Nothing more will follow."""
        return self.phase in END_PHASES or (self._pursuit is not None and self._pursuit.over)

    @property
    def in_safe_state(self) -> bool:
        return self._pursuit is not None

    @property
    def further(self) -> tuple[str, ...]:
        """Doubts since the safe state was entered."""
        return self._pursuit.further if self._pursuit else ()

    @property
    def unreached(self) -> tuple[str, ...]:
        """What of the safe state was not seen when the run ended."""
        return self._pursuit.unreached if self._pursuit else ()

    @property
    def excused_ns(self) -> float:
        """How much longer than it should the run has taken, by an arm that was slowed down."""
        return self._clock.excused_ns

    def step(self, obs: Observation) -> Decision:
        """Take one observation; returns the commands that follow from it."""
        self._out = []
        self._clock.update(obs, self.phase)
        self._reset_detector = self._anchor = False
        self.monitor.update(obs.t_ns, obs.probabilities)
        self._contact.update(obs, self.phase in AIRBORNE_PHASES)
        answering = self.phase is Phase.COMPENSATE and not self.response.adds_margin
        if answering or self.monitor.status.registered:
            self._way_down.slipping(obs)
        if self._pursuit:
            self._out += self._pursuit.step(obs)
        elif trouble := self._trouble(obs):
            self._fail(obs, trouble)
        elif obs.inputs.stop:
            self._stop(obs)
        else:
            self._handlers[self.phase](obs)
        return Decision(
            phase=self.phase, slip=self.monitor.status, commands=tuple(self._out),
            reset_detector=self._reset_detector, anchor=self._anchor, finished=self.finished,
        )  # fmt: skip

    def aborted(self) -> tuple[Command, ...]:
        """What is asked for when no step can be taken any more: a fault's safe state, or that which
        was entered before."""
        hand: tuple[Command, ...] = (HoldFingers(),)  # where not even that can be told
        with SuppressBugs():
            hand = self._aborted.of_hand(self.response.slow_closing())
        return (StopArm(self._settings.stop_deceleration_mps2), *hand)

    def missing(self, obs: Observation) -> Missing:
        """What of that is not seen; a hand not heard of for as long as makes it stale is not."""
        safe, stale_ns = self._aborted, self._settings.stale_after_s * 1e9
        if obs.gripper.age_ns(obs.t_ns) > stale_ns:
            inputs = msgspec.structs.replace(obs.inputs, gripper_lost=True)
            obs = msgspec.structs.replace(obs, inputs=inputs)
        return Missing(safe.missing_of_arm(obs, stale_ns), safe.missing_of_hand(obs))

    @property
    def _aborted(self) -> SafeState:
        fault = SafeState(Phase.FAULT, self.phase, self._clock.entered_ns, "")
        return self._pursuit.safe if self._pursuit else fault

    def _trouble(self, obs: Observation) -> str:
        if obs.inputs.trouble or obs.doubt:
            return "; ".join(filter(None, (obs.inputs.trouble, obs.doubt)))
        if obs.tactile_stale and self.phase not in OPEN_PHASES:
            return "stale: no fresh fingertip sample"
        of_states = obs.trouble_of_states(self._settings.stale_after_s * 1e9)
        return (
            of_states
            or self._force_trouble(obs)
            or self._clock.trouble(obs, self.phase)
            or self._time_trouble(obs)
        )

    def _force_trouble(self, obs: Observation) -> str:
        moving = self.phase in AIRBORNE_PHASES and obs.arm.moving
        if moving and self._contact.overload_ns > OVERLOAD_NS:
            return "measured force stays above the limit while the arm moves"
        return ""

    def _time_trouble(self, obs: Observation) -> str:
        timeout_s = self._settings.phase_timeout_s
        if self.phase in UNTIMED_PHASES or not self._clock.over(timeout_s):
            return ""
        if self.phase is Phase.REST and obs.hand_rests:
            return f"fingertips_slow: too few samples for rest counts within {timeout_s:g} s"
        return f"phase {self.phase} lasted longer than {timeout_s:g} s: {self._awaited(obs)}"

    def _awaited(self, obs: Observation) -> str:
        """What the present phase is not over without."""
        if obs.pending:
            return "a command has not reached its device yet"
        if not obs.gripper.at_rest:
            return "the fingers still move"
        arm = obs.arm.moving or self.phase in ARM_PHASES
        return "the arm has not arrived" if arm else "the grip is not what it has to be"

    def _fire(self, trigger: Trigger, obs: Observation, cause: str) -> None:
        self.machine.fire(trigger, obs.t_ns, cause)
        self._clock.restart(obs.t_ns)

    def _lasted(self, obs: Observation, duration_s: float) -> bool:
        """Whether the present phase has lasted this long."""
        return obs.t_ns - self._clock.entered_ns >= duration_s * 1e9

    def _stop_again(self, obs: Observation, stop: StopArm | None) -> tuple[Command, ...]:
        """The stop that this phase began with, where the arm goes on: it may have been lost."""
        on_its_way = stop is not None and obs.arm.moving and not obs.pending
        return (stop,) if stop and on_its_way and self._clock.ask_again(obs.t_ns) else ()

    def _move_fingers(self, targets: Counts3, speed_mps: float) -> None:
        self._out.append(MoveFingers(targets, speed_mps, self._settings.grip_force_n))

    def _idle(self, obs: Observation) -> None:
        if any(f.detection is Detection.CONTACT_CLOSING for f in obs.gripper.fingers):
            self._fail(obs, "the hand is closed, and may hold something")
            return
        if max(obs.gripper.positions) > OPEN_COUNTS:  # a grip by position reports no contact
            self._fail(obs, "the hand is not open: what it may hold would fall, or be hit")
            return
        if self._plan.home is None:
            self._line.home = obs.arm.position_m
        if math.dist(obs.arm.position_m, self.home) < AT_HEIGHT_M:
            self._shape(obs, Trigger.START, "run started")
        else:
            self._fire(Trigger.RETURN, obs, "run started")
            self._out.append(self._line.down(0.0, self._settings.lower_speed_mps))

    def _return(self, obs: Observation) -> None:
        if obs.hand_rests and self._line.stands_at(obs, 0.0):
            self._shape(obs, Trigger.RETURNED, "arm home")

    def _shape(self, obs: Observation, trigger: Trigger, cause: str) -> None:
        self._fire(trigger, obs, cause)
        self._move_fingers(self._plan.preshape_counts, self._settings.approach_speed_mps)

    def _approach(self, obs: Observation) -> None:
        if not obs.hand_rests or not self._line.stands_at(obs, 0.0):
            return
        if obs.gripper.requested != self._plan.preshape_counts:  # lost on its way
            self._move_fingers(self._plan.preshape_counts, self._settings.approach_speed_mps)
        else:
            self._fire(Trigger.SHAPED, obs, "fingers short of the object")
            self._out.append(BeginRest())

    def _rest(self, obs: Observation) -> None:
        if obs.hand_rests and obs.inputs.rest_taken:
            self._fire(Trigger.RESTED, obs, "rest counts taken")
            thumb, _, _ = self._plan.preshape_counts
            _, b, c = self._plan.grip_counts
            self._move_fingers((thumb, b, c), self._settings.grip_speed_mps)

    def _grasp(self, obs: Observation) -> None:
        """B and C first: the thumb, closing last, is the only one that presses, and it carries
        what both of them bear."""
        if obs.hand_rests and self._positioned(obs):
            self._fire(Trigger.BRACED, obs, "fingers B and C rest at their positions")
            self._move_fingers(self._plan.grip_counts, self._settings.grip_speed_mps)

    def _oppose(self, obs: Observation) -> None:
        if not obs.hand_rests or not self._positioned(obs):
            return
        if self._settings.firm:
            self._fire(Trigger.POSITIONED, obs, "fingers rest at their positions")
            self._out.append(self.response.slow_closing())
        else:
            self._gripped(obs, "fingers rest at their positions")

    def _squeeze(self, obs: Observation) -> None:
        if obs.hand_rests and self._stopped_on_contact(obs):
            self._gripped(obs, "the thumb stopped at the force cap")

    def _gripped(self, obs: Observation, cause: str) -> None:
        self._fire(Trigger.GRIPPED, obs, cause)
        self._reset_detector = True

    def _relax(self, obs: Observation) -> None:
        if self._stands(obs) and self._lasted(obs, self._settings.relax_s):
            self._fire(Trigger.RELAXED, obs, "pads relaxed")
            self._reset_detector = True
            self.monitor.arm()

    def _listen(self, obs: Observation) -> None:
        s = self._settings
        if not self._stands(obs):
            return
        if self._contact.thumb_lost:
            nothing = "the thumb feels nothing at its position: no object, or a narrower one"
            self._fail(obs, nothing)
        elif self._lasted(obs, s.listen_s):
            self._fire(Trigger.LISTENED, obs, "the detector has listened")
            self._anchor = True
            self._out.append(self._line.move(s.lift_height_m, s.lift_speed_mps))

    def _stands(self, obs: Observation) -> bool:
        """Whether the fingers rest in the grip that is wanted; a fault if that is another."""
        good = self._stopped_on_contact if self._settings.firm else self._positioned
        return obs.hand_rests and good(obs)

    def _positioned(self, obs: Observation) -> bool:
        """False, and a fault, when a finger at rest did not end by position."""
        if name := obs.gripper.not_at_target:
            self._fail(
                obs,
                f"finger {name} stopped on contact short of its position: it is latched and "
                "could not be closed further at this force",
            )
        return not name

    def _stopped_on_contact(self, obs: Observation) -> bool:
        """False, and a fault, when the thumb at rest did not end on the object."""
        if not obs.gripper.thumb_latched:
            self._fail(obs, "the thumb closed as far as it goes and met nothing")
        return obs.gripper.thumb_latched

    def _lift(self, obs: Observation) -> None:
        if self._responds(obs):
            return
        if self._line.stands_at(obs, self._settings.lift_height_m):
            self._fire(Trigger.LIFTED, obs, "arm at the top")

    def _responds(self, obs: Observation) -> bool:
        """Respond to slip and lost contact, where a closing can still do something."""
        slip, lost = self.monitor.status, self._contact.thumb_lost
        rising = self.phase is Phase.LIFT  # at the top the arm stands
        if lost and obs.at_cap:
            self._lose(obs, "contact lost, and the thumb can close no further")
            return True
        borne = self._settings.hold_by_clock and obs.at_cap
        if self._settings.reactions and (lost or (slip.registered and not borne)):
            cause = f"slip registered at finger {FINGER_NAMES[slip.finger]}"
            self._fire(Trigger.SLIP_REGISTERED, obs, "contact lost" if lost else cause)
            self._out += self.response.begin(obs, rising, lost)
            return True
        if more := self.response.follow_up(obs, rising):
            self._fire(Trigger.FOUND, obs, "the force that was found has carried the object")
            self._out += more
        return bool(more)

    def _compensate(self, obs: Observation) -> None:
        slip, response = self.monitor.status, self.response
        alarm = slip.registered or slip.masked or not obs.hand_rests
        response.update(obs, alarm, self._clock.passed_ns)
        self._out += self._stop_again(obs, response.arm_stop)
        if not obs.hand_rests:
            self.monitor.closing(obs.t_ns)
        elif obs.unfinished:  # the same response goes on
            self.monitor.closing(obs.t_ns)
            self._out.append(response.closing(obs, self._contact.thumb_lost))
        elif self._contact.thumb_lost:
            self._lose(obs, "the hand closed and met nothing")
        elif slip.masked:
            return
        elif response.exhausted and not self._settings.hold_by_clock:
            self._give_up(obs, "slip comes back and the force can rise no more")
        elif not slip.registered:
            if response.over(obs):
                self._go_on(obs, Trigger.SLIP_STOPPED, "slip has stopped")
        else:
            self._slip_goes_on(obs)

    def _slip_goes_on(self, obs: Observation) -> None:
        """Although the hand rests, and nothing is masked any more."""
        s = self._settings
        waited_ns = obs.t_ns - max(self._clock.entered_ns, self.monitor.masked_until_ns)
        more = self.response.escalate(obs, waited_ns)
        if more is not None:
            self._out += more
        elif s.hold_by_clock:
            self._go_on(obs, Trigger.SLIP_BORNE, "slip goes on, and the hold ends by its clock")
        elif waited_ns >= s.cap_patience_s * 1e9:
            self._give_up(obs, "slip goes on and the force can rise no more")

    def _give_up(self, obs: Observation, cause: str) -> None:
        self.cap_reached = True
        self._set_down(Trigger.CAP_REACHED, obs, cause)

    def _go_on(self, obs: Observation, rising: Trigger, cause: str) -> None:
        resume = self.response.end()
        if self._line.stands_at(obs, self._settings.lift_height_m):
            self._fire(Trigger.LIFTED, obs, cause)
        else:
            self._fire(rising, obs, cause)
            self._out += resume

    def _hold(self, obs: Observation) -> None:
        """Ends a while after slip was answered last, or where alarms that no closing can answer
        come and go, a while after the arm first came to the top."""
        s = self._settings
        held_ns = obs.t_ns - self.machine.first_ns(Phase.HOLD)
        over = s.hold_by_clock and held_ns >= s.hold_s * 1e9
        tired = obs.closed_out and held_ns >= s.hold_s * 1e9 + ALARM_HOLD_NS
        if not (over or tired) and self._responds(obs):
            return
        if over or tired or obs.inputs.set_down or self._lasted(obs, s.hold_s):
            self._end_hold(obs)

    def _end_hold(self, obs: Observation) -> None:
        self.alarm_stayed = self.monitor.status.registered
        if self._settings.keep:
            self._fire(Trigger.KEEP, obs, "held long enough")
            return
        cause = "asked to set down" if obs.inputs.set_down else "held long enough"
        self._set_down(Trigger.FINISHED, obs, cause)

    def _set_down(self, trigger: Trigger, obs: Observation, cause: str) -> None:
        self.monitor.disarm()
        self._take(self._way_down.begin(trigger, cause), obs)

    def _go_down(self, obs: Observation) -> None:
        if way := self._way_down.step(self.phase, obs):
            self._take(way, obs)
        else:
            stop = StopArm(self._settings.stop_deceleration_mps2)
            self._out += self._stop_again(obs, stop if self.phase is Phase.TOUCH else None)

    def _take(self, way: Way, obs: Observation) -> None:
        if way.trigger is Trigger.LOSE:
            self._lose(obs, way.cause)
        else:
            self._fire(way.trigger, obs, way.cause)
            self._out += way.commands

    def _release(self, obs: Observation) -> None:
        if obs.hand_rests and not obs.gripper.is_open:
            self._fail(obs, f"the fingers stopped at {obs.gripper.positions} counts: not open")
        elif obs.hand_rests:
            self._fire(Trigger.OPENED, obs, "fingers open")
            self._out.append(
                self._line.move(self._way_down.clear_m, self._settings.lower_speed_mps)
            )

    def _retreat(self, obs: Observation) -> None:
        if obs.hand_rests and self._line.stands_at(obs, self._way_down.clear_m):
            self._fire(Trigger.RETREATED, obs, "arm clear")

    def _rest_at_end(self, obs: Observation) -> None:
        """The table ends here: nothing is asked for."""

    def _lose(self, obs: Observation, cause: str) -> None:
        """The arm stops, and nothing is lowered."""
        self._enter_safe_state(Trigger.LOSE, obs, cause)

    def _fail(self, obs: Observation, cause: str) -> None:
        """Enter the safe state of the present phase."""
        self.fault_cause = cause
        self._enter_safe_state(Trigger.FAIL, obs, cause)

    def _stop(self, obs: Observation) -> None:
        self.fault_cause = obs.inputs.stop
        self._enter_safe_state(Trigger.STOP, obs, obs.inputs.stop)

    def _enter_safe_state(self, trigger: Trigger, obs: Observation, cause: str) -> None:
        self._fire(trigger, obs, cause)
        before = self.machine.before
        half_closed = before is Phase.COMPENSATE and obs.first_stage
        safe = SafeState(self.phase, before, obs.t_ns, cause, half_closed)
        self._pursuit = Pursuit(safe, self._settings, self.response)
        self._out += self._pursuit.ask(obs)
