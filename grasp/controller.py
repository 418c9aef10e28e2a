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
from grasp.felt import Felt
from grasp.landing import Landing, Way
from grasp.lift_line import LiftLine
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
        self.fault_cause = ""
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

    def step(self, seen: Observation) -> Decision:
        """Take one observation; returns the commands that follow from it."""
        self._out = []
        self._clock.take(seen, self.phase)
        self._reset_detector = self._anchor = False
        self.monitor.update(seen.t_ns, seen.probabilities)
        self._felt.take(seen, self.phase in AIRBORNE_PHASES)
        answering = self.phase is Phase.COMPENSATE and not self._steps.securing
        if answering or self.monitor.status.registered:
            self._landing.slipping(seen)
        if self._pursuit:
            self._out += self._pursuit.step(seen)
        elif trouble := self._trouble(seen):
            self._fail(seen, trouble)
        elif seen.stop:
            self._stop(seen)
        else:
            self._handlers[self.phase](seen)
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

    def missing(self, seen: Observation) -> Missing:
        """What of that is not seen; a hand not heard of for as long as makes it stale is not."""
        safe, stale_ns = self._aborted, self._settings.stale_after_s * 1e9
        if seen.gripper.age_ns(seen.t_ns) > stale_ns:
            seen = msgspec.structs.replace(seen, gripper_lost=True)
        return Missing(safe.missing_of_arm(seen, stale_ns), safe.missing_of_hand(seen))

    @property
    def _aborted(self) -> SafeState:
        fault = SafeState(Phase.FAULT, self.phase, self._entered_ns, "")
        return self._pursuit.safe if self._pursuit else fault

    def _trouble(self, seen: Observation) -> str:
        if seen.trouble or seen.doubt:
            return "; ".join(filter(None, (seen.trouble, seen.doubt)))
        if seen.tactile_stale and self.phase not in OPEN_PHASES:
            return "stale: no fresh fingertip sample"
        of_states = seen.trouble_of_states(self._settings.stale_after_s * 1e9)
        return (
            of_states
            or self._force_trouble(seen)
            or self._clock.trouble(seen, self.phase)
            or self._time_trouble(seen)
        )

    def _force_trouble(self, seen: Observation) -> str:
        moving = self.phase in AIRBORNE_PHASES and seen.arm.moving
        if moving and self._felt.overload_ns(seen.t_ns) > self._settings.overload_s * 1e9:
            return "measured force stays above the limit while the arm moves"
        return ""

    def _time_trouble(self, seen: Observation) -> str:
        timeout_s = self._settings.phase_timeout_s
        if self.phase in UNTIMED_PHASES or not self._clock.over(timeout_s):
            return ""
        if self.phase is Phase.REST and seen.hand_rests:
            return f"fingertips_slow: too few samples for rest counts within {timeout_s:g} s"
        return f"phase {self.phase} lasted longer than {timeout_s:g} s: {self._awaited(seen)}"

    def _awaited(self, seen: Observation) -> str:
        """What the present phase is not over without."""
        if seen.pending:
            return "a command has not reached its device yet"
        if not seen.gripper.at_rest:
            return "the fingers still move"
        arm = seen.arm.moving or self.phase in ARM_PHASES
        return "the arm has not arrived" if arm else "the grip is not what it has to be"

    def _fire(self, trigger: Trigger, seen: Observation, cause: str) -> None:
        self.machine.fire(trigger, seen.t_ns, cause)
        self._entered_ns = seen.t_ns
        self._clock.restart()

    def _lasted(self, seen: Observation, duration_s: float) -> bool:
        """Whether the present phase has lasted this long."""
        return seen.t_ns - self._entered_ns >= duration_s * 1e9

    def _move_fingers(self, targets: Counts3, speed_mps: float) -> None:
        self._out.append(MoveFingers(targets, speed_mps, self._settings.grip_force_n))

    def _to_cap(self, seen: Observation) -> CloseFast:
        return self._closing.command(seen, self._felt.contact_lost(seen.t_ns))

    def _idle(self, seen: Observation) -> None:
        if any(f.detection is Detection.CONTACT_CLOSING for f in seen.gripper.fingers):
            self._fail(seen, "the hand is closed, and may hold something")
            return
        if max(seen.gripper.positions) > OPEN_COUNTS:  # a grip by position reports no contact
            self._fail(seen, "the hand is not open: what it may hold would fall, or be hit")
            return
        if self._plan.home is None:
            self._line.home = seen.arm.position_m
        if math.dist(seen.arm.position_m, self.home) < self._settings.at_height_m:
            self._shape(seen, Trigger.START, "run started")
        else:
            self._fire(Trigger.RETURN, seen, "run started")
            self._out.append(self._line.down(0.0, self._settings.lower_speed_mps))

    def _return(self, seen: Observation) -> None:
        if seen.hand_rests and self._line.stands_at(seen, 0.0):
            self._shape(seen, Trigger.RETURNED, "arm home")

    def _shape(self, seen: Observation, trigger: Trigger, cause: str) -> None:
        self._fire(trigger, seen, cause)
        self._move_fingers(self._plan.preshape_counts, self._settings.approach_speed_mps)

    def _approach(self, seen: Observation) -> None:
        if not seen.hand_rests or not self._line.stands_at(seen, 0.0):
            return
        if seen.gripper.requested != self._plan.preshape_counts:  # lost on its way
            self._move_fingers(self._plan.preshape_counts, self._settings.approach_speed_mps)
        else:
            self._fire(Trigger.SHAPED, seen, "fingers short of the object")
            self._out.append(BeginRest())

    def _rest(self, seen: Observation) -> None:
        if seen.hand_rests and seen.rest_taken:
            self._fire(Trigger.RESTED, seen, "rest counts taken")
            thumb, _, _ = self._plan.preshape_counts
            _, b, c = self._plan.grip_counts
            self._move_fingers((thumb, b, c), self._settings.grip_speed_mps)

    def _grasp(self, seen: Observation) -> None:
        """B and C first: the thumb, closing last, is the only one that presses, and it carries
        what both of them bear."""
        if seen.hand_rests and self._positioned(seen):
            self._fire(Trigger.BRACED, seen, "fingers B and C rest at their positions")
            self._move_fingers(self._plan.grip_counts, self._settings.grip_speed_mps)

    def _oppose(self, seen: Observation) -> None:
        if not seen.hand_rests or not self._positioned(seen):
            return
        if self._settings.firm:
            self._fire(Trigger.POSITIONED, seen, "fingers rest at their positions")
            self._out.append(self._closing.slowly())
        else:
            self._gripped(seen, "fingers rest at their positions")

    def _squeeze(self, seen: Observation) -> None:
        if seen.hand_rests and self._stopped_on_contact(seen):
            self._gripped(seen, "the thumb stopped at the force cap")

    def _gripped(self, seen: Observation, cause: str) -> None:
        self._fire(Trigger.GRIPPED, seen, cause)
        self._reset_detector = True

    def _relax(self, seen: Observation) -> None:
        if self._stands(seen) and self._lasted(seen, self._settings.relax_s):
            self._fire(Trigger.RELAXED, seen, "pads relaxed")
            self._reset_detector = True
            self.monitor.arm()

    def _listen(self, seen: Observation) -> None:
        s = self._settings
        if not self._stands(seen):
            return
        if self._felt.contact_lost(seen.t_ns):
            nothing = "the thumb feels nothing at its position: no object, or a narrower one"
            self._fail(seen, nothing)
        elif self._lasted(seen, s.listen_s):
            self._fire(Trigger.LISTENED, seen, "the detector has listened")
            self._anchor = True
            self._out.append(self._line.move(s.lift_height_m, s.lift_speed_mps))

    def _stands(self, seen: Observation) -> bool:
        """Whether the fingers rest in the grip that is wanted; a fault if that is another."""
        good = self._stopped_on_contact if self._settings.firm else self._positioned
        return seen.hand_rests and good(seen)

    def _positioned(self, seen: Observation) -> bool:
        """False, and a fault, when a finger at rest did not end by position."""
        if name := seen.gripper.not_at_target:
            self._fail(
                seen,
                f"finger {name} stopped on contact short of its position: it is latched and "
                "could not be closed further at this force",
            )
        return not name

    def _stopped_on_contact(self, seen: Observation) -> bool:
        """False, and a fault, when the thumb at rest did not end on the object."""
        if not seen.gripper.thumb_latched:
            self._fail(seen, "the thumb closed as far as it goes and met nothing")
        return seen.gripper.thumb_latched

    def _lift(self, seen: Observation) -> None:
        if self._answers(seen) or self._secures(seen):
            return
        if self._line.stands_at(seen, self._settings.lift_height_m):
            self._fire(Trigger.LIFTED, seen, "arm at the top")

    def _secures(self, seen: Observation) -> bool:
        """A force that was found, and has carried the object, gets its margin."""
        rising = self.phase is Phase.LIFT
        if not self._steps.margin_due(seen, at_top=not rising):
            return False
        self._out += self.pause.begin(seen) if rising else ()
        self._fire(Trigger.FOUND, seen, "the force that was found has carried the object")
        self._out.append(self._steps.margin(seen))
        return True

    def _answers(self, seen: Observation) -> bool:
        """Answer slip and lost contact by the fastest closure, where one can still do something."""
        slip, lost = self.monitor.status, self._felt.contact_lost(seen.t_ns)
        if lost and seen.at_cap:
            self._lose(seen, "contact lost, and the thumb can close no further")
            return True
        borne = self._settings.hold_by_clock and seen.at_cap
        if not self._settings.reactions or not (lost or (slip.registered and not borne)):
            return False
        cause = f"slip registered at finger {FINGER_NAMES[slip.finger]}"
        rising = self.phase is Phase.LIFT  # at the top the arm stands
        steps = rising and not lost and self._steps.may(seen)
        self._out += self.pause.begin(seen) if rising else ()
        self._fire(Trigger.SLIP_REGISTERED, seen, "contact lost" if lost else cause)
        if steps:
            self.closings += 1
            self._out.append(self._steps.step(seen))
        else:
            self._jump(seen)
        return True

    def _jump(self, seen: Observation) -> None:
        """To the force cap, where that is any further."""
        self._steps.forget()
        if not seen.at_cap:
            self.closings += 1
            self._out.append(self._to_cap(seen))

    def _compensate(self, seen: Observation) -> None:
        slip = self.monitor.status
        self._out += self.pause.take(seen, slip.registered or slip.masked or not seen.hand_rests)
        if not seen.hand_rests:
            self.monitor.closing(seen.t_ns)
        elif seen.unfinished:  # the same answer goes on
            self.monitor.closing(seen.t_ns)
            self._out.append(self._to_cap(seen))
        elif self._felt.contact_lost(seen.t_ns):
            self._lose(seen, "the hand closed and met nothing")
        elif slip.masked:
            return
        elif self.pause.tired and not self._settings.hold_by_clock:
            self._give_up(seen, "slip comes back and the force can rise no more")
        elif not slip.registered:
            if self.pause.over(seen):
                self._go_on(seen, Trigger.SLIP_STOPPED, "slip has stopped")
        elif self._steps.lasts and self._patience_ended(seen, self._settings.step_patience_s):
            self._jump(seen)
        elif self._settings.hold_by_clock:
            self._go_on(seen, Trigger.SLIP_BORNE, "slip goes on, and the hold ends by its clock")
        elif self._patience_ended(seen, self._settings.cap_patience_s):
            self._give_up(seen, "slip goes on and the force can rise no more")

    def _give_up(self, seen: Observation, cause: str) -> None:
        self.cap_reached = True
        self._set_down(Trigger.CAP_REACHED, seen, cause)

    def _go_on(self, seen: Observation, rising: Trigger, cause: str) -> None:
        self._steps.end()
        on = self.pause.end()
        if self._line.stands_at(seen, self._settings.lift_height_m):
            self._fire(Trigger.LIFTED, seen, cause)
        else:
            self._fire(rising, seen, cause)
            self._out += on

    def _patience_ended(self, seen: Observation, patience_s: float) -> bool:
        since_ns = max(self._entered_ns, self.monitor.masked_until_ns)
        return seen.t_ns - since_ns >= patience_s * 1e9

    def _hold(self, seen: Observation) -> None:
        """Ends a while after slip was answered last, or where alarms that no closing can answer
        come and go, a while after the arm first came to the top."""
        s = self._settings
        held_ns = seen.t_ns - self.machine.first_ns(Phase.HOLD)
        over = s.hold_by_clock and held_ns >= s.hold_s * 1e9
        tired = seen.closed_out and held_ns >= (s.hold_s + s.alarm_hold_s) * 1e9
        if not (over or tired) and (self._answers(seen) or self._secures(seen)):
            return
        if over or tired or seen.set_down or self._lasted(seen, s.hold_s):
            self._end_hold(seen)

    def _end_hold(self, seen: Observation) -> None:
        self.alarm_stayed = self.monitor.status.registered
        if self._settings.keep:
            self._fire(Trigger.KEEP, seen, "held long enough")
            return
        cause = "asked to set down" if seen.set_down else "held long enough"
        self._set_down(Trigger.FINISHED, seen, cause)

    def _set_down(self, trigger: Trigger, seen: Observation, cause: str) -> None:
        self.monitor.disarm()
        self._take(self._landing.begin(trigger, cause), seen)

    def _go_down(self, seen: Observation) -> None:
        if way := self._landing.step(self.phase, seen):
            self._take(way, seen)
        else:
            self._out += self._landing.again(self.phase, seen)

    def _take(self, way: Way, seen: Observation) -> None:
        if way.trigger is Trigger.LOSE:
            self._lose(seen, way.cause)
        else:
            self._fire(way.trigger, seen, way.cause)
            self._out += way.commands

    def _release(self, seen: Observation) -> None:
        if seen.hand_rests and not seen.gripper.is_open:
            self._fail(seen, f"the fingers stopped at {seen.gripper.positions} counts: not open")
        elif seen.hand_rests:
            self._fire(Trigger.OPENED, seen, "fingers open")
            self._out.append(self._line.move(self._landing.clear_m, self._settings.lower_speed_mps))

    def _retreat(self, seen: Observation) -> None:
        if seen.hand_rests and self._line.stands_at(seen, self._landing.clear_m):
            self._fire(Trigger.RETREATED, seen, "arm clear")

    def _rest_at_end(self, seen: Observation) -> None:
        """The table ends here: nothing is asked for."""

    def _lose(self, seen: Observation, cause: str) -> None:
        """The arm stops, and nothing is lowered."""
        self._enter_safe_state(Trigger.LOSE, seen, cause)

    def _fail(self, seen: Observation, cause: str) -> None:
        """Enter the safe state of the present phase."""
        self.fault_cause = cause
        self._enter_safe_state(Trigger.FAIL, seen, cause)

    def _stop(self, seen: Observation) -> None:
        self.fault_cause = seen.stop
        self._enter_safe_state(Trigger.STOP, seen, seen.stop)

    def _enter_safe_state(self, trigger: Trigger, seen: Observation, cause: str) -> None:
        self._fire(trigger, seen, cause)
        before = self.machine.before
        half_closed = before is Phase.COMPENSATE and seen.first_stage
        safe = SafeState(self.phase, before, seen.t_ns, cause, half_closed)
        self._pursuit = Pursuit(safe, self._settings, self._closing)
        self._out += self._pursuit.ask(seen)
