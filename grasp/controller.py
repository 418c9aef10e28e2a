"""GraspController: one pure step from an observation to commands.

No clock is read, nothing sleeps, nothing does I/O, so a run on the wire, a run in virtual time and
the replay of a recording are the same code.
"""

from collections.abc import Callable
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from drivers.interfaces import (
    FINGER_NAMES,
    ArmState,
    Counts3,
    Detection,
    GripperState,
    Vector3,
)
from grasp.commands import (
    BeginRest,
    CloseFast,
    Command,
    HoldFingers,
    MoveArm,
    MoveFingers,
    OpenFingers,
    StopArm,
)
from grasp.phases import (
    AIRBORNE_PHASES,
    CONTACT_PHASES,
    OPEN_PHASES,
    Phase,
    PhaseMachine,
    Trigger,
)
from grasp.slip import SlipMonitor, SlipStatus

CLOSED_COUNTS: Counts3 = (255, 255, 255)
ALL_FINGERS = (True, True, True)


class GripPlan(msgspec.Struct, frozen=True):
    """Predetermined finger positions of one object, motor counts A, B, C (paper, section V-B), and
    the force to close with."""

    preshape_counts: Counts3  # just short of the object
    grip_counts: Counts3  # in contact, with too little force
    force_cap_n: float  # to close with when slip is registered: the guard's limit (paper: 10 N)


class ControllerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Speeds, heights and patience of a grasp."""

    preshape_margin_counts: Annotated[
        int, Meta(ge=2, le=60, description="fingers wait this far short of the grip positions")
    ] = 15
    approach_speed_mps: Annotated[
        float, Meta(ge=0.022, le=0.11, description="of the fingers in free air")
    ] = 0.11
    grip_speed_mps: Annotated[
        float, Meta(ge=0.022, le=0.11, description="of the fingers onto the object")
    ] = 0.022
    grip_force_n: Annotated[
        float, Meta(gt=0.0, le=60.0, description="force setting while moving to the grip positions")
    ] = 10.0
    closing_speed_mps: Annotated[
        float, Meta(ge=0.022, le=0.11, description="asked for when slip is registered")
    ] = 0.11
    relax_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="the pads relax, from the fingers' rest on")
    ] = 0.3
    listen_s: Annotated[
        float, Meta(ge=0.02, le=5.0, description="the detector listens before the arm lifts")
    ] = 0.3
    lift_height_m: Annotated[float, Meta(ge=0.01, le=1.0, description="assumed, 0.1-0.3")] = 0.2
    lift_speed_mps: Annotated[float, Meta(ge=0.005, le=0.5, description="assumed, 0.1-0.25")] = 0.1
    lift_acceleration_mps2: Annotated[
        float, Meta(ge=0.05, le=5.0, description="assumed, 0.3-1.2")
    ] = 0.5
    lower_speed_mps: Annotated[float, Meta(ge=0.005, le=0.5, description="assumed")] = 0.05
    retreat_m: Annotated[
        float, Meta(ge=0.0, le=0.5, description="upwards, after the fingers have opened")
    ] = 0.05
    at_height_m: Annotated[
        float, Meta(ge=1e-4, le=0.01, description="the arm counts as there within this")
    ] = 0.001
    stop_deceleration_mps2: Annotated[
        float, Meta(ge=0.1, le=10.0, description="of the arm, in every safe state")
    ] = 1.0
    hold_s: Annotated[
        float, Meta(ge=0.0, le=600.0, description="at the top, before it is set down")
    ] = 1.0
    cap_patience_s: Annotated[
        float, Meta(ge=0.05, le=5.0, description="slip may go on after the last rise of force")
    ] = 0.3
    stale_after_s: Annotated[
        float, Meta(ge=0.02, le=1.0, description="age at which gripper or arm state is too old")
    ] = 0.1
    phase_timeout_s: Annotated[
        float, Meta(ge=1.0, le=600.0, description="a phase other than idle and hold may last")
    ] = 30.0
    safe_state_s: Annotated[
        float, Meta(ge=0.1, le=10.0, description="a run goes on so long after a fault")
    ] = 0.5
    keep: Annotated[bool, Meta(description="keep holding at the top instead of setting down")] = (
        False
    )
    firm: Annotated[
        bool,
        Meta(description="close to the force cap before lifting, as for the tap (paper, V-B)"),
    ] = False
    reactions: Annotated[
        bool,
        Meta(description="answer registered slip; off in the twin run that judges false starts"),
    ] = True


class Observation(msgspec.Struct, frozen=True):
    """Everything one step may know.

    ``pending``: a command of an earlier step has not reached its device yet. ``trouble``: one line
    of what went wrong in device exchanges since the last step, empty when all is well.
    ``set_down``: whoever runs the experiment has what they want; a held object may be set down.
    ``stop``: the run shall end now, and why; empty while it may go on.
    ``doubt``: what a device says that cannot be believed; empty when all can. ``late_ns`` and
    ``took_ns`` as in ``step.StepInput``, for the recording.
    """

    t_ns: int
    probabilities: NDArray[np.float64]  # (3,)
    tactile_stale: bool
    rest_taken: bool
    gripper: GripperState
    arm: ArmState
    pending: bool = False
    trouble: str = ""
    gripper_lost: bool = False
    set_down: bool = False
    stop: str = ""
    late_ns: int = 0
    took_ns: int = 0
    doubt: str = ""


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

    Where it stands is the phase and when that began. Beside it there are only the arm's home, the
    last rise of force (compensate) and when the arm was at the top (hold).
    """

    def __init__(self, settings: ControllerSettings, plan: GripPlan, monitor: SlipMonitor) -> None:
        self._settings = settings
        self._plan = plan
        self.monitor = monitor
        self.machine = PhaseMachine()
        self.cap_reached = False
        self.finished = False
        self.fault_cause = ""
        self._out: list[Command] = []
        self._reset_detector = False
        self._anchor = False
        self._home: Vector3 = (0.0, 0.0, 0.0)  # of the arm when the run began: set by `_idle`
        self._entered_ns = 0
        self._last_rise_ns = 0
        self._at_top_ns: int | None = None
        self._handlers: dict[Phase, Callable[[Observation], None]] = {
            Phase.IDLE: self._idle,
            Phase.APPROACH: self._approach,
            Phase.REST: self._rest,
            Phase.GRASP: self._grasp,
            Phase.SQUEEZE: self._squeeze,
            Phase.SETTLE: self._settle,
            Phase.LIFT: self._lift,
            Phase.COMPENSATE: self._compensate,
            Phase.HOLD: self._hold,
            Phase.LOWER: self._lower,
            Phase.RELEASE: self._release,
            Phase.RETREAT: self._retreat,
            Phase.FAULT: self._fault,
        }

    @property
    def phase(self) -> Phase:
        return self.machine.phase

    def step(self, seen: Observation) -> Decision:
        """Take one observation; returns the commands that follow from it."""
        self._out = []
        self._reset_detector = self._anchor = False
        self.monitor.update(seen.t_ns, seen.probabilities)
        trouble = self._trouble(seen)
        if trouble and self.phase is not Phase.FAULT:
            self._fail(seen, trouble)
        elif seen.stop and self.phase is not Phase.FAULT:
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

    def interrupted(self) -> tuple[Command, ...]:
        """Safe state of a run that is stopped from outside: the arm stands, a grip is kept."""
        stop = StopArm(self._settings.stop_deceleration_mps2)
        free = self.phase not in CONTACT_PHASES and self.phase is not Phase.IDLE
        return (stop, HoldFingers()) if free else (stop,)

    def _trouble(self, seen: Observation) -> str:
        stale_ns = self._settings.stale_after_s * 1e9
        if seen.trouble or seen.doubt:
            return seen.trouble or seen.doubt
        if seen.tactile_stale and self.phase not in OPEN_PHASES:
            return "stale: no fresh fingertip sample"
        if seen.gripper.age_ns(seen.t_ns) > stale_ns:
            return "stale: gripper status too old"
        if seen.arm.age_ns(seen.t_ns) > stale_ns:
            return "stale: arm state too old"
        if seen.gripper.fault:
            return f"gripper fault: {seen.gripper.fault_text}"
        if seen.arm.stopped_by_safety:
            return "arm stopped by its safety system"
        timeout_s = self._settings.phase_timeout_s
        timed = self.phase not in (Phase.IDLE, Phase.HOLD)
        if timed and self._lasted(seen, timeout_s):
            return f"phase {self.phase} lasted longer than {timeout_s:g} s"
        return ""

    def _fire(self, trigger: Trigger, seen: Observation, cause: str) -> None:
        self.machine.fire(trigger, seen.t_ns, cause)
        self._entered_ns = seen.t_ns

    def _lasted(self, seen: Observation, duration_s: float) -> bool:
        """Whether the present phase has lasted this long."""
        return seen.t_ns - self._entered_ns >= duration_s * 1e9

    def _at_rest(self, seen: Observation) -> bool:
        return not seen.pending and seen.gripper.at_rest

    def _arm_at(self, seen: Observation, height_m: float) -> bool:
        """True when the arm stands at that height over its home."""
        away_m = abs(seen.arm.position_m[2] - self._home[2] - height_m)
        return not seen.pending and not seen.arm.moving and away_m < self._settings.at_height_m

    def _move_arm(self, height_m: float, speed_mps: float) -> None:
        x, y, z = self._home
        self._out.append(
            MoveArm((x, y, z + height_m), speed_mps, self._settings.lift_acceleration_mps2)
        )

    def _move_fingers(self, targets: Counts3, speed_mps: float) -> None:
        self._out.append(MoveFingers(targets, speed_mps, self._settings.grip_force_n))

    def _close_to_cap(self) -> None:
        speed_mps = self._settings.closing_speed_mps
        self._out.append(CloseFast(self._plan.force_cap_n, ALL_FINGERS, CLOSED_COUNTS, speed_mps))

    def _idle(self, seen: Observation) -> None:
        if self.finished:
            return
        if any(f.detection is Detection.CONTACT_CLOSING for f in seen.gripper.fingers):
            self._fail(seen, "the gripper already holds something")
            return
        self._home = seen.arm.position_m
        self._fire(Trigger.START, seen, "run started")
        self._move_fingers(self._plan.preshape_counts, self._settings.approach_speed_mps)

    def _approach(self, seen: Observation) -> None:
        if self._at_rest(seen):
            self._fire(Trigger.SHAPED, seen, "fingers short of the object")
            self._out.append(BeginRest())

    def _rest(self, seen: Observation) -> None:
        if self._at_rest(seen) and seen.rest_taken:
            self._fire(Trigger.RESTED, seen, "rest counts taken")
            self._move_fingers(self._plan.grip_counts, self._settings.grip_speed_mps)

    def _grasp(self, seen: Observation) -> None:
        if not self._at_rest(seen) or not self._positioned(seen):
            return
        if self._settings.firm:
            self._fire(Trigger.POSITIONED, seen, "fingers rest at their positions")
            self._close_to_cap()
        else:
            self._gripped(seen, "fingers rest at their positions")

    def _squeeze(self, seen: Observation) -> None:
        if self._at_rest(seen) and self._stopped_on_contact(seen):
            self._gripped(seen, "the thumb stopped at the force cap")

    def _gripped(self, seen: Observation, cause: str) -> None:
        self._fire(Trigger.GRIPPED, seen, cause)
        self._reset_detector = True

    def _settle(self, seen: Observation) -> None:
        s = self._settings
        good = self._stopped_on_contact if s.firm else self._positioned
        if not self._at_rest(seen) or not good(seen):
            return
        if not self.monitor.status.armed:
            if self._lasted(seen, s.relax_s):
                self._reset_detector = True
                self.monitor.arm()
        elif self._lasted(seen, s.relax_s + s.listen_s):
            self._fire(Trigger.SETTLED, seen, "pads relaxed, detector listening")
            self._anchor = True
            self._move_arm(s.lift_height_m, s.lift_speed_mps)

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
        if self._answers_slip(seen):
            return
        if self._arm_at(seen, self._settings.lift_height_m):
            self._reach_top(Trigger.LIFTED, seen, "arm at the top")

    def _answers_slip(self, seen: Observation) -> bool:
        slip = self.monitor.status
        if not (slip.registered and self._settings.reactions):
            return False
        self._fire(
            Trigger.SLIP_REGISTERED, seen, f"slip registered at finger {FINGER_NAMES[slip.finger]}"
        )
        self._last_rise_ns = seen.t_ns
        self._close_to_cap()
        return True

    def _reach_top(self, trigger: Trigger, seen: Observation, cause: str) -> None:
        self._fire(trigger, seen, cause)
        self._at_top_ns = None

    def _compensate(self, seen: Observation) -> None:
        slip = self.monitor.status
        if not self._at_rest(seen):
            self._last_rise_ns = seen.t_ns
            self.monitor.closing(seen.t_ns)
        elif slip.masked:
            return
        elif not slip.registered:
            self._reach_top(Trigger.SLIP_STOPPED, seen, "slip has stopped")
        elif seen.t_ns - self._last_rise_ns >= self._settings.cap_patience_s * 1e9:
            self.cap_reached = True
            self._fire(Trigger.CAP_REACHED, seen, "slip goes on and the force can rise no more")
            self._set_down()

    def _hold(self, seen: Observation) -> None:
        s = self._settings
        if self._answers_slip(seen) or not self._arm_at(seen, s.lift_height_m):
            return
        if self._at_top_ns is None:
            self._at_top_ns = seen.t_ns
        elif seen.set_down or seen.t_ns - self._at_top_ns >= s.hold_s * 1e9:
            if s.keep:
                self.finished = True
                return
            cause = "asked to set down" if seen.set_down else "held long enough"
            self._fire(Trigger.FINISHED, seen, cause)
            self._set_down()

    def _set_down(self) -> None:
        self.monitor.disarm()
        self._move_arm(0.0, self._settings.lower_speed_mps)

    def _lower(self, seen: Observation) -> None:
        if self._arm_at(seen, 0.0):
            self._fire(Trigger.LANDED, seen, "arm where the lift began")
            self._out.append(OpenFingers(self._settings.approach_speed_mps))

    def _release(self, seen: Observation) -> None:
        if self._at_rest(seen):
            self._fire(Trigger.OPENED, seen, "fingers open")
            self._move_arm(self._settings.retreat_m, self._settings.lower_speed_mps)

    def _retreat(self, seen: Observation) -> None:
        if self._at_rest(seen) and self._arm_at(seen, self._settings.retreat_m):
            self._fire(Trigger.RETREATED, seen, "arm clear")
            self.finished = True

    def _fail(self, seen: Observation, cause: str) -> None:
        """Enter the safe state of the present phase; the commands are sent once."""
        before = self.phase
        self.fault_cause = cause
        self._fire(Trigger.FAIL, seen, cause)
        self._out.append(StopArm(self._settings.stop_deceleration_mps2))
        if seen.gripper_lost:
            return
        if before in AIRBORNE_PHASES:  # the object may be off the table: do not let it fall
            self._close_to_cap()
        elif before is not Phase.IDLE:
            self._out.append(HoldFingers())

    def _stop(self, seen: Observation) -> None:
        """As told: a safe state in which a grip is kept as it is."""
        self._out += self.interrupted()
        self.fault_cause = seen.stop
        self._fire(Trigger.FAIL, seen, seen.stop)

    def _fault(self, seen: Observation) -> None:
        self.finished = self._lasted(seen, self._settings.safe_state_s)
