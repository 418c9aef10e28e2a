"""GraspController: one pure step from an observation to commands.

No clock is read, nothing sleeps, nothing does I/O, so a run on the wire, a run in virtual time and
the replay of a recording are the same code.
"""

import math
from collections.abc import Callable

import msgspec

from drivers.interfaces import FINGER_NAMES, Counts3, Detection, Vector3
from grasp.commands import (
    BeginRest,
    CloseFast,
    Command,
    MoveArm,
    MoveFingers,
    OpenFingers,
    StopArm,
)
from grasp.controller_settings import ControllerSettings, GripPlan
from grasp.observation import Observation
from grasp.phases import (
    AIRBORNE_PHASES,
    END_PHASES,
    OPEN_PHASES,
    SAFE_PHASES,
    Phase,
    PhaseMachine,
    Trigger,
)
from grasp.safe_state import SafeState
from grasp.slip import SlipMonitor, SlipStatus

CLOSED_COUNTS: Counts3 = (255, 255, 255)
ALL_FINGERS = (True, True, True)
LEVELS_IN_RELAXING = 5  # time constants of a force's level within controller.relax_s


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

    Where it stands is the phase and when that began. Beside it there are the arm's home and facts
    of the world: when contact was felt last and force was last within the limit, where slip was
    last in progress, what the grip was when the way down began.
    ``_asked_ns``, when a safe state was last asked for, paces its requests; ``_pursued`` is that
    all of it was seen, or waited for long enough.
    """

    def __init__(self, settings: ControllerSettings, plan: GripPlan, monitor: SlipMonitor) -> None:
        self._settings = settings
        self._plan = plan
        self.monitor = monitor
        self.machine = PhaseMachine()
        self.cap_reached = False
        self.alarm_stayed = False  # the hold ended although slip was still registered
        self.closings = 0  # answers to slip or lost contact
        self._pursued = False
        self.fault_cause = ""
        self.further: list[str] = []  # doubts since the safe state was entered
        self.unreached: tuple[str, ...] = ()  # of the safe state, when the run ended
        self.home: Vector3 = plan.home or (0.0, 0.0, 0.0)  # without one, set by `_idle`
        self._out: list[Command] = []
        self._reset_detector = False
        self._anchor = False
        self._entered_ns = 0
        self._felt_ns = 0
        self._gap_ns = 0  # the longest that nothing was felt in the air
        self._in_limit_ns = 0
        self._slipped_m = 0.0  # height of the arm when slip was last in progress
        self._seen_ns = 0
        self._thumb_n = 0.0  # level of the thumb's measured force
        self._grip_n = 0.0  # what it was when the arm last began to go down
        self._touches = 0  # how often the grip has tightened on the way down
        self._let_go_m = 0.0  # height of the arm when the hand opened
        self._asked_ns = 0
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
            Phase.LOWER: self._lower,
            Phase.LAND: self._land,
            Phase.TOUCH: self._touch,
            Phase.PROBE: self._probe,
            Phase.RELEASE: self._release,
            Phase.RETREAT: self._retreat,
            Phase.DONE: self._rest_at_end,
            Phase.KEPT: self._rest_at_end,
            Phase.LOST: self._pursue,
            Phase.STOPPED: self._pursue,
            Phase.FAULT: self._pursue,
        }

    @property
    def phase(self) -> Phase:
        return self.machine.phase

    @property
    def finished(self) -> bool:
        """Nothing more will follow."""
        return self.phase in END_PHASES or self._pursued

    @property
    def in_safe_state(self) -> bool:
        return self.phase in SAFE_PHASES

    @property
    def _safe(self) -> SafeState:
        """The safe state that was entered last."""
        cause = "; ".join((self.fault_cause, *self.further))
        return SafeState(self.phase, self.machine.before, self._entered_ns, cause)

    def step(self, seen: Observation) -> Decision:
        """Take one observation; returns the commands that follow from it."""
        self._out = []
        self._reset_detector = self._anchor = False
        self.monitor.update(seen.t_ns, seen.probabilities)
        self._feel(seen)
        trouble = "" if self.in_safe_state else self._trouble(seen)
        if self.in_safe_state:
            self._doubt_further(seen.doubt)
        if trouble:
            self._fail(seen, trouble)
        elif seen.stop and self.phase not in SAFE_PHASES:
            self._stop(seen)
        else:
            self._handlers[self.phase](seen)
        return Decision(
            phase=self.phase,
            slip=self.monitor.status,
            commands=tuple(self._out),
            reset_detector=self._reset_detector,
            anchor=self._anchor,
            finished=self.finished,
        )

    def aborted(self) -> tuple[Command, ...]:
        """What is asked for when no step can be taken any more: a fault's safe state, or that which
        was entered before."""
        fault = SafeState(Phase.FAULT, self.phase, self._entered_ns, "")
        safe = self._safe if self.in_safe_state else fault
        stop = StopArm(self._settings.stop_deceleration_mps2)
        return (stop, *safe.of_hand(self._fastest_closure()))

    def _doubt_further(self, doubt: str) -> None:
        """In a safe state nothing new is asked for; what else cannot be believed is told."""
        told = {part.partition(":")[0] for part in (*self.fault_cause.split("; "), *self.further)}
        new = (part for part in doubt.split("; ") if part)
        self.further += [part for part in new if part.partition(":")[0] not in told]

    def _feel(self, seen: Observation) -> None:
        """Remember when the thumb, which opposes both others, last touched something, and when no
        force was above the limit."""
        if seen.measured_n[0] >= self._settings.contact_n:
            self._felt_ns = seen.t_ns
        elif self.phase in AIRBORNE_PHASES:
            self._gap_ns = max(self._gap_ns, seen.t_ns - self._felt_ns)
        weight = LEVELS_IN_RELAXING * (seen.t_ns - self._seen_ns) / (self._settings.relax_s * 1e9)
        self._thumb_n += min(1.0, weight) * (seen.measured_n[0] - self._thumb_n)
        self._seen_ns = seen.t_ns
        if not seen.overloaded:
            self._in_limit_ns = seen.t_ns
        if self.phase is Phase.COMPENSATE or self.monitor.status.registered:
            self._slipped_m = self._height_m(seen)

    def _contact_lost(self, seen: Observation) -> bool:
        return seen.t_ns - self._felt_ns >= self._settings.contact_lost_s * 1e9

    def _trouble(self, seen: Observation) -> str:
        if seen.trouble or seen.doubt:
            return "; ".join(filter(None, (seen.trouble, seen.doubt)))
        if seen.tactile_stale and self.phase not in OPEN_PHASES:
            return "stale: no fresh fingertip sample"
        of_states = seen.trouble_of_states(self._settings.stale_after_s * 1e9)
        return of_states or self._force_trouble(seen) or self._time_trouble(seen)

    def _force_trouble(self, seen: Observation) -> str:
        moving = self.phase in AIRBORNE_PHASES and seen.arm.moving
        if moving and seen.t_ns - self._in_limit_ns > self._settings.overload_s * 1e9:
            return "measured force stays above the limit while the arm moves"
        return ""

    def _time_trouble(self, seen: Observation) -> str:
        timeout_s = self._settings.phase_timeout_s
        timed = self.phase not in {Phase.IDLE, Phase.HOLD} | END_PHASES
        if timed and self._lasted(seen, timeout_s):
            return f"phase {self.phase} lasted longer than {timeout_s:g} s"
        return ""

    def _fire(self, trigger: Trigger, seen: Observation, cause: str) -> None:
        self.machine.fire(trigger, seen.t_ns, cause)
        self._entered_ns = seen.t_ns

    def _lasted(self, seen: Observation, duration_s: float) -> bool:
        """Whether the present phase has lasted this long."""
        return seen.t_ns - self._entered_ns >= duration_s * 1e9

    def _arm_at(self, seen: Observation, height_m: float) -> bool:
        """True when the arm stands at that height over its home."""
        away_m = abs(seen.arm.position_m[2] - self.home[2] - height_m)
        return not seen.pending and not seen.arm.moving and away_m < self._settings.at_height_m

    def _height_m(self, seen: Observation) -> float:
        """Of the arm over its home."""
        return seen.arm.position_m[2] - self.home[2]

    def _move_arm(self, height_m: float, speed_mps: float) -> None:
        x, y, z = self.home
        self._out.append(
            MoveArm((x, y, z + height_m), speed_mps, self._settings.lift_acceleration_mps2)
        )

    def _move_fingers(self, targets: Counts3, speed_mps: float) -> None:
        self._out.append(MoveFingers(targets, speed_mps, self._settings.grip_force_n))

    def _close_to_cap(self) -> None:
        self._out.append(self._fastest_closure())

    def _fastest_closure(self) -> CloseFast:
        speed_mps = self._settings.closing_speed_mps
        return CloseFast(self._plan.force_cap_n, ALL_FINGERS, CLOSED_COUNTS, speed_mps)

    def _idle(self, seen: Observation) -> None:
        if any(f.detection is Detection.CONTACT_CLOSING for f in seen.gripper.fingers):
            self._fail(seen, "the gripper already holds something")
            return
        if seen.gripper.positions[0] > self._plan.grip_counts[0]:
            self._fail(seen, "the hand is closed: it may not go down onto an object like that")
            return
        if self._plan.home is None:
            self.home = seen.arm.position_m
        if math.dist(seen.arm.position_m, self.home) < self._settings.at_height_m:
            self._shape(seen, Trigger.START, "run started")
        else:
            self._fire(Trigger.RETURN, seen, "run started")
            self._move_arm(0.0, self._settings.lower_speed_mps)

    def _return(self, seen: Observation) -> None:
        if seen.hand_rests and self._arm_at(seen, 0.0):
            self._shape(seen, Trigger.RETURNED, "arm home")

    def _shape(self, seen: Observation, trigger: Trigger, cause: str) -> None:
        self._fire(trigger, seen, cause)
        self._move_fingers(self._plan.preshape_counts, self._settings.approach_speed_mps)

    def _approach(self, seen: Observation) -> None:
        if not seen.hand_rests or not self._arm_at(seen, 0.0):
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
            self._close_to_cap()
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
        if self._contact_lost(seen):
            self._fail(
                seen, "the thumb feels nothing at its position: no object, or a narrower one"
            )
        elif self._lasted(seen, s.listen_s):
            self._fire(Trigger.LISTENED, seen, "the detector has listened")
            self._anchor = True
            self._move_arm(s.lift_height_m, s.lift_speed_mps)

    def _stands(self, seen: Observation) -> bool:
        """Whether the fingers rest in the grip that is wanted; a fault if that is another."""
        good = self._stopped_on_contact if self._settings.firm else self._positioned
        return seen.hand_rests and good(seen)

    def _positioned(self, seen: Observation) -> bool:
        """False, and a fault, when a finger at rest did not end by position."""
        for name, finger in zip(FINGER_NAMES, seen.gripper.fingers, strict=True):
            if finger.detection is not Detection.AT_TARGET:
                self._fail(
                    seen,
                    f"finger {name} stopped on contact short of its position: it is latched and "
                    "could not be closed further at this force",
                )
                return False
        return True

    def _stopped_on_contact(self, seen: Observation) -> bool:
        """False, and a fault, when the thumb at rest did not end on the object."""
        if seen.gripper.fingers[0].detection is Detection.CONTACT_CLOSING:
            return True
        self._fail(seen, "the thumb closed as far as it goes and met nothing")
        return False

    def _lift(self, seen: Observation) -> None:
        if not self._answers(seen) and self._arm_at(seen, self._settings.lift_height_m):
            self._fire(Trigger.LIFTED, seen, "arm at the top")

    def _answers(self, seen: Observation) -> bool:
        """Answer slip and lost contact by the fastest closure, where one can still do something."""
        slip, lost = self.monitor.status, self._contact_lost(seen)
        if lost and seen.at_cap:
            self._lose(seen, "contact lost, and the thumb can close no further")
            return True
        borne = self._settings.hold_by_clock and seen.at_cap
        if not self._settings.reactions or not (lost or (slip.registered and not borne)):
            return False
        cause = f"slip registered at finger {FINGER_NAMES[slip.finger]}"
        self._fire(Trigger.SLIP_REGISTERED, seen, "contact lost" if lost else cause)
        if not seen.at_cap:
            self.closings += 1
            self._close_to_cap()
        return True

    def _compensate(self, seen: Observation) -> None:
        slip = self.monitor.status
        if not seen.hand_rests:
            self.monitor.closing(seen.t_ns)
        elif self._contact_lost(seen):
            self._lose(seen, "the hand closed and met nothing")
        elif slip.masked:
            return
        elif not slip.registered:
            self._go_on(seen, Trigger.SLIP_STOPPED, "slip has stopped")
        elif self._settings.hold_by_clock:
            self._go_on(seen, Trigger.SLIP_BORNE, "slip goes on, and the hold ends by its clock")
        elif self._patience_ended(seen):
            self.cap_reached = True
            cause = "slip goes on and the force can rise no more"
            self._set_down(seen, Trigger.CAP_REACHED, cause)

    def _go_on(self, seen: Observation, rising: Trigger, cause: str) -> None:
        at_top = self._arm_at(seen, self._settings.lift_height_m)
        self._fire(Trigger.LIFTED if at_top else rising, seen, cause)

    def _patience_ended(self, seen: Observation) -> bool:
        since_ns = max(self._entered_ns, self.monitor.masked_until_ns)
        return seen.t_ns - since_ns >= self._settings.cap_patience_s * 1e9

    def _hold(self, seen: Observation) -> None:
        """Ends a while after slip was answered last, or where alarms that no closing can answer
        come and go, a while after the arm first came to the top."""
        s = self._settings
        held_ns = seen.t_ns - self.machine.first_ns(Phase.HOLD)
        over = s.hold_by_clock and held_ns >= s.hold_s * 1e9
        tired = seen.at_cap and held_ns >= (s.hold_s + s.alarm_hold_s) * 1e9
        if not (over or tired) and self._answers(seen):
            return
        if over or tired or seen.set_down or self._lasted(seen, s.hold_s):
            self._end_hold(seen)

    def _end_hold(self, seen: Observation) -> None:
        self.alarm_stayed = self.monitor.status.registered
        if self._settings.keep:
            self._fire(Trigger.KEEP, seen, "held long enough")
            return
        cause = "asked to set down" if seen.set_down else "held long enough"
        self._set_down(seen, Trigger.FINISHED, cause)

    def _set_down(self, seen: Observation, trigger: Trigger, cause: str) -> None:
        """Down to where the lift began, unless the object may be elsewhere in the hand: it fell and
        was gripped again higher up, and a closed hand would be driven down along it."""
        if self._gap_ns >= self._settings.contact_gap_s * 1e9:
            gap = f"nothing was felt for {self._gap_ns * 1e-9:.2f} s on the way"
            self._lose(seen, f"{gap}: what the hand holds may stand on the table")
            return
        self._fire(trigger, seen, cause)
        self.monitor.disarm()
        self._move_arm(self._near_m, self._settings.lower_speed_mps)

    @property
    def _near_m(self) -> float:
        """Higher than this no object stands: it rose with the hand from when slip had ended, so it
        has slipped less than the arm had risen by then."""
        return min(max(self._slipped_m, 0.0), self._settings.lift_height_m)

    def _lose(self, seen: Observation, cause: str) -> None:
        """The arm stops, and nothing is lowered."""
        self._fire(Trigger.LOSE, seen, cause)
        self._out.append(StopArm(self._settings.stop_deceleration_mps2))

    def _lower(self, seen: Observation) -> None:
        if self._contact_lost(seen):
            self._lose(seen, "contact lost on the way down")
        elif self._arm_at(seen, self._near_m):
            self._land_slowly(seen, Trigger.NEAR, "from here on the object may stand")

    def _land_slowly(self, seen: Observation, trigger: Trigger, cause: str) -> None:
        self._fire(trigger, seen, cause)
        self._grip_n = self._thumb_n
        if not self._arm_at(seen, 0.0):
            in_time_mps = 2 * self._near_m / self._settings.phase_timeout_s
            self._move_arm(0.0, max(self._settings.landing_speed_mps, in_time_mps))

    def _land(self, seen: Observation) -> None:
        """The grip tightens where closed fingers slide down over a flank that widens."""
        rise_n = seen.measured_n[0] - self._grip_n
        if self._contact_lost(seen):
            self._lose(seen, "contact lost on the way down")
        elif self._arm_at(seen, 0.0):
            self._let_go(seen, "arm where the lift began")
        elif rise_n >= self._settings.landing_rise_n:
            self._touches += 1
            cause = f"the thumb feels {rise_n:.1f} N more on the way down"
            self._fire(Trigger.TIGHTENED, seen, cause)
            self._out.append(StopArm(self._settings.stop_deceleration_mps2))

    def _touch(self, seen: Observation) -> None:
        if self._stood(seen):
            self._fire(Trigger.SETTLED, seen, "the arm stands, the pads have relaxed")
            self._grip_n = self._thumb_n
            step_m = self._settings.landing_step_m
            self._move_arm(self._height_m(seen) - step_m, self._settings.landing_speed_mps)

    def _probe(self, seen: Observation) -> None:
        """A grip in the air takes no notice of a step down; where it does, the object stands."""
        if not self._stood(seen):
            return
        rise_n = self._thumb_n - self._grip_n
        if rise_n >= self._settings.landing_check_n:
            self._let_go(seen, f"a step down tightened the grip by {rise_n:.1f} N: it stands")
        elif self._touches >= self._settings.landing_tries:
            self._lose(seen, "the grip tightens, and it is not certain that the object stands")
        else:
            self._land_slowly(seen, Trigger.LOOSE, "a step down did not tighten the grip")

    def _stood(self, seen: Observation) -> bool:
        """Whether the arm stands, and what the thumb feels is steady."""
        stands = not seen.pending and not seen.arm.moving
        return stands and self._lasted(seen, self._settings.relax_s)

    def _let_go(self, seen: Observation, cause: str) -> None:
        self._fire(Trigger.LANDED, seen, cause)
        self._let_go_m = self._height_m(seen)
        self._out.append(OpenFingers(self._settings.approach_speed_mps))

    def _release(self, seen: Observation) -> None:
        if seen.hand_rests:
            self._fire(Trigger.OPENED, seen, "fingers open")
            self._move_arm(self._clear_m, self._settings.lower_speed_mps)

    @property
    def _clear_m(self) -> float:
        """Height of the arm clear of what was set down."""
        return self._let_go_m + self._settings.retreat_m

    def _retreat(self, seen: Observation) -> None:
        if seen.hand_rests and self._arm_at(seen, self._clear_m):
            self._fire(Trigger.RETREATED, seen, "arm clear")

    def _rest_at_end(self, seen: Observation) -> None:
        """The table ends here: nothing is asked for."""

    def _fail(self, seen: Observation, cause: str) -> None:
        """Enter the safe state of the present phase."""
        self.fault_cause = cause
        self._fire(Trigger.FAIL, seen, cause)
        self._ask(seen)

    def _stop(self, seen: Observation) -> None:
        self.fault_cause = seen.stop
        self._fire(Trigger.STOP, seen, seen.stop)
        self._ask(seen)

    def _pursue(self, seen: Observation) -> None:
        """A safe state is reached when it is seen; until then it is asked for again and again."""
        stale_ns = self._settings.stale_after_s * 1e9
        arm, hand = self._safe.missing_of_arm(seen, stale_ns), self._safe.missing_of_hand(seen)
        self.unreached = (*arm, *hand)
        # what the hand was told before may set it going once more, though its status says it rests
        due = seen.t_ns - self._asked_ns >= self._settings.repeat_s * 1e9
        reached = not self.unreached and (due or self._safe.leaves_hand)
        if reached or self._lasted(seen, self._settings.safe_state_s):
            self._pursued = True
        elif self.unreached and due and not seen.pending:
            self._ask(seen)

    def _ask(self, seen: Observation) -> None:
        self._asked_ns = seen.t_ns
        safe = self._safe
        if seen.arm.moving or seen.t_ns == safe.since_ns or safe.arm_is_doubted:
            self._out.append(StopArm(self._settings.stop_deceleration_mps2))
        if not seen.gripper_lost and not safe.hand_is_safe(seen):
            self._out += safe.of_hand(self._fastest_closure())
