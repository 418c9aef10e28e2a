"""GraspController: one pure step from an observation to commands.

No clock is read, nothing sleeps, nothing does I/O, so a run on the wire, a run in virtual time and
the replay of a recording are the same code.
"""

import math
from collections.abc import Callable

import msgspec

from drivers.errors import SuppressBugs
from drivers.interfaces import FINGER_NAMES, OPEN_COUNTS, Counts3, Detection, Vector3
from grasp.closing import Closing
from grasp.commands import (
    BeginRest,
    CloseFast,
    Command,
    HoldFingers,
    MoveFingers,
    StopArm,
)
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.fault import ARM, FINGERTIPS, TRIAL, Fault, lines, stale
from grasp.felt import Felt
from grasp.landing import Landing, Way
from grasp.lift_line import LiftLine
from grasp.monitors.checks import failed
from grasp.observation import Observation
from grasp.pace import PhaseClock
from grasp.pause import Pause
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
from grasp.slip import SlipMonitor, SlipStatus
from grasp.steps import Steps

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
        self.closings = 0  # answers to slip or lost contact
        self.faults: tuple[Fault, ...] = ()  # why the run ended early
        self._pursuit: Pursuit | None = None  # of the safe state that was entered
        self._line = LiftLine(settings, plan.home or (0.0, 0.0, 0.0))  # without one, set by `_idle`
        self._felt = Felt(settings)
        self._closing = Closing(settings, plan.force_cap_n)
        self._landing = Landing(settings, self._line, self._felt)
        self.pause = Pause(settings, self._line)
        self._steps = Steps(settings, plan, self._line)
        self._out: list[Command] = []
        self._reset_detector = False
        self._anchor = False
        self._entered_ns = 0
        self._clock = PhaseClock()
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
    def finished(self) -> bool:
        """Nothing more will follow."""
        return self.phase in END_PHASES or (self._pursuit is not None and self._pursuit.over)

    @property
    def in_safe_state(self) -> bool:
        return self._pursuit is not None

    @property
    def fault_cause(self) -> str:
        """Why the run ended early, for people; empty if it did not, or the object was lost."""
        return lines(self.faults)

    @property
    def further(self) -> tuple[Fault, ...]:
        """Checks that failed since the safe state was entered."""
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
        self._clock.take(obs, self.phase)
        self._reset_detector = self._anchor = False
        self.monitor.update(obs.t_ns, obs.probabilities)
        self._felt.take(obs, self.phase in AIRBORNE_PHASES)
        answering = self.phase is Phase.COMPENSATE and not self._steps.securing
        if answering or self.monitor.status.registered:
            self._landing.slipping(obs)
        if self._pursuit:
            self._out += self._pursuit.step(obs)
        elif faults := self._find_faults(obs):
            self._enter_fault(obs, faults)
        elif obs.inputs.stop:
            self._stop(obs, obs.inputs.stop)
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
            hand = self._aborted.of_hand(self._closing.slowly())
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
        fault = SafeState(Phase.FAULT, self.phase, self._entered_ns)
        return self._pursuit.safe if self._pursuit else fault

    def _find_faults(self, obs: Observation) -> tuple[Fault, ...]:
        if obs.faults:
            return obs.faults
        if obs.tactile_stale and self.phase not in OPEN_PHASES:
            return (stale(FINGERTIPS, "no fresh fingertip sample"),)
        fault = (
            obs.device_fault(self._settings.stale_after_s * 1e9)
            or self._overforce(obs)
            or self._slow_arm(obs)
            or self._timeout(obs)
        )
        return () if fault is None else (fault,)

    def _overforce(self, obs: Observation) -> Fault | None:
        moving = self.phase in AIRBORNE_PHASES and obs.arm.moving
        if moving and self._felt.overload_ns(obs.t_ns) > self._settings.overload_s * 1e9:
            text = "measured force stays above the limit while the arm moves"
            return Fault("overforce", TRIAL, text)
        return None

    def _slow_arm(self, obs: Observation) -> Fault | None:
        text = self._clock.trouble(obs, self.phase)
        remedy = "turn up the speed slider of the arm's pendant"
        return Fault("arm_slow", ARM, text, remedy) if text else None

    def _timeout(self, obs: Observation) -> Fault | None:
        timeout_s = self._settings.phase_timeout_s
        if self.phase in UNTIMED_PHASES or not self._clock.over(timeout_s):
            return None
        if self.phase is Phase.REST and obs.hand_rests:
            return failed("fingertips_slow", seconds=timeout_s)
        text = f"phase {self.phase} lasted longer than {timeout_s:g} s: {self._awaited(obs)}"
        return Fault("phase_timeout", TRIAL, text)

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
        self._entered_ns = obs.t_ns
        self._clock.restart()

    def _lasted(self, obs: Observation, duration_s: float) -> bool:
        """Whether the present phase has lasted this long."""
        return obs.t_ns - self._entered_ns >= duration_s * 1e9

    def _move_fingers(self, targets: Counts3, speed_mps: float) -> None:
        self._out.append(MoveFingers(targets, speed_mps, self._settings.grip_force_n))

    def _to_cap(self, obs: Observation) -> CloseFast:
        return self._closing.command(obs, self._felt.contact_lost(obs.t_ns))

    def _idle(self, obs: Observation) -> None:
        if any(f.detection is Detection.CONTACT_CLOSING for f in obs.gripper.fingers):
            self._fail(obs, "the hand is closed, and may hold something")
            return
        if max(obs.gripper.positions) > OPEN_COUNTS:  # a grip by position reports no contact
            self._fail(obs, "the hand is not open: what it may hold would fall, or be hit")
            return
        if self._plan.home is None:
            self._line.home = obs.arm.position_m
        if math.dist(obs.arm.position_m, self.home) < self._settings.at_height_m:
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
            self._out.append(self._closing.slowly())
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
        if self._felt.contact_lost(obs.t_ns):
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
        if self._answers(obs) or self._secures(obs):
            return
        if self._line.stands_at(obs, self._settings.lift_height_m):
            self._fire(Trigger.LIFTED, obs, "arm at the top")

    def _secures(self, obs: Observation) -> bool:
        """A force that was found, and has carried the object, gets its margin."""
        rising = self.phase is Phase.LIFT
        if not self._steps.margin_due(obs, at_top=not rising):
            return False
        self._out += self.pause.begin(obs) if rising else ()
        self._fire(Trigger.FOUND, obs, "the force that was found has carried the object")
        self._out.append(self._steps.margin(obs))
        return True

    def _answers(self, obs: Observation) -> bool:
        """Answer slip and lost contact by the fastest closure, where one can still do something."""
        slip, lost = self.monitor.status, self._felt.contact_lost(obs.t_ns)
        if lost and obs.at_cap:
            self._lose(obs, "contact lost, and the thumb can close no further")
            return True
        borne = self._settings.hold_by_clock and obs.at_cap
        if not self._settings.reactions or not (lost or (slip.registered and not borne)):
            return False
        cause = f"slip registered at finger {FINGER_NAMES[slip.finger]}"
        rising = self.phase is Phase.LIFT  # at the top the arm stands
        steps = rising and not lost and self._steps.may(obs)
        self._out += self.pause.begin(obs) if rising else ()
        self._fire(Trigger.SLIP_REGISTERED, obs, "contact lost" if lost else cause)
        if steps:
            self.closings += 1
            self._out.append(self._steps.step(obs))
        else:
            self._jump(obs)
        return True

    def _jump(self, obs: Observation) -> None:
        """To the force cap, where that is any further."""
        self._steps.forget()
        if not obs.at_cap:
            self.closings += 1
            self._out.append(self._to_cap(obs))

    def _compensate(self, obs: Observation) -> None:
        slip = self.monitor.status
        self._out += self.pause.take(obs, slip.registered or slip.masked or not obs.hand_rests)
        if not obs.hand_rests:
            self.monitor.closing(obs.t_ns)
        elif obs.unfinished:  # the same answer goes on
            self.monitor.closing(obs.t_ns)
            self._out.append(self._to_cap(obs))
        elif self._felt.contact_lost(obs.t_ns):
            self._lose(obs, "the hand closed and met nothing")
        elif slip.masked:
            return
        elif self.pause.tired and not self._settings.hold_by_clock:
            self._give_up(obs, "slip comes back and the force can rise no more")
        elif not slip.registered:
            if self.pause.over(obs):
                self._go_on(obs, Trigger.SLIP_STOPPED, "slip has stopped")
        elif self._steps.lasts and self._patience_ended(obs, self._settings.step_patience_s):
            self._jump(obs)
        elif self._settings.hold_by_clock:
            self._go_on(obs, Trigger.SLIP_BORNE, "slip goes on, and the hold ends by its clock")
        elif self._patience_ended(obs, self._settings.cap_patience_s):
            self._give_up(obs, "slip goes on and the force can rise no more")

    def _give_up(self, obs: Observation, cause: str) -> None:
        self.cap_reached = True
        self._set_down(Trigger.CAP_REACHED, obs, cause)

    def _go_on(self, obs: Observation, rising: Trigger, cause: str) -> None:
        self._steps.end()
        on = self.pause.end()
        if self._line.stands_at(obs, self._settings.lift_height_m):
            self._fire(Trigger.LIFTED, obs, cause)
        else:
            self._fire(rising, obs, cause)
            self._out += on

    def _patience_ended(self, obs: Observation, patience_s: float) -> bool:
        since_ns = max(self._entered_ns, self.monitor.masked_until_ns)
        return obs.t_ns - since_ns >= patience_s * 1e9

    def _hold(self, obs: Observation) -> None:
        """Ends a while after slip was answered last, or where alarms that no closing can answer
        come and go, a while after the arm first came to the top."""
        s = self._settings
        held_ns = obs.t_ns - self.machine.first_ns(Phase.HOLD)
        over = s.hold_by_clock and held_ns >= s.hold_s * 1e9
        tired = obs.closed_out and held_ns >= (s.hold_s + s.alarm_hold_s) * 1e9
        if not (over or tired) and (self._answers(obs) or self._secures(obs)):
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
        self._take(self._landing.begin(trigger, cause), obs)

    def _go_down(self, obs: Observation) -> None:
        if way := self._landing.step(self.phase, obs):
            self._take(way, obs)
        else:
            self._out += self._landing.again(self.phase, obs)

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
            self._out.append(self._line.move(self._landing.clear_m, self._settings.lower_speed_mps))

    def _retreat(self, obs: Observation) -> None:
        if obs.hand_rests and self._line.stands_at(obs, self._landing.clear_m):
            self._fire(Trigger.RETREATED, obs, "arm clear")

    def _rest_at_end(self, obs: Observation) -> None:
        """The table ends here: nothing is asked for."""

    def _lose(self, obs: Observation, cause: str) -> None:
        """The arm stops, and nothing is lowered."""
        self._enter_safe_state(Trigger.LOSE, obs, cause)

    def _fail(self, obs: Observation, cause: str) -> None:
        """What became of the grasp is a fault."""
        self._enter_fault(obs, (Fault("grasp_failed", TRIAL, cause),))

    def _enter_fault(self, obs: Observation, faults: tuple[Fault, ...]) -> None:
        """Enter the safe state of the present phase."""
        self.faults = faults
        self._enter_safe_state(Trigger.FAIL, obs, lines(faults))

    def _stop(self, obs: Observation, why: Fault) -> None:
        self.faults = (why,)
        self._enter_safe_state(Trigger.STOP, obs, why.line)

    def _enter_safe_state(self, trigger: Trigger, obs: Observation, cause: str) -> None:
        self._fire(trigger, obs, cause)
        before = self.machine.before
        half_closed = before is Phase.COMPENSATE and obs.first_stage
        safe = SafeState(self.phase, before, obs.t_ns, self.faults, half_closed)
        self._pursuit = Pursuit(safe, self._settings, self._closing)
        self._out += self._pursuit.ask(obs)
