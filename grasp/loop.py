"""ControlLoop: sample, step, command, hand on; once a tactile sample.

The loop owns the deadlines and the timing statistics; it knows devices by their interfaces alone,
and of what a step concludes only which commands go where.
"""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import msgspec

from drivers.errors import GraspError, LinkLost
from drivers.interfaces import (
    Applied,
    Arm,
    ArmState,
    Gripper,
    GripperState,
    TactileFrame,
    TactileSensor,
    Vector3,
)
from grasp import signals
from grasp.clock import Clock, Deadlines, stopwatch_ns
from grasp.commands import (
    CloseFast,
    Command,
    GripperCommand,
    HoldFingers,
    MoveArm,
    MoveFingers,
    OpenFingers,
    StopArm,
    describe,
)
from grasp.controller import Decision
from grasp.controller_settings import LoopSettings
from grasp.fault import ARM, FINGERTIPS, GRIPPER, TRIAL, Fault
from grasp.observation import Observation, StepInput
from grasp.states import State
from grasp.step import GraspStep, StepResult

TIMED_OUT = "the run did not end in time"
LONGER = "where it was only slow, give it longer (loop.deadline_s)"

# No settings, since no result depends on them: a command due this soon is sent before anyone
# watches (half of the shortest period), and how often an acknowledgement is looked for meanwhile.
SOON_NS = 1_000_000
POLL_NS = 100_000
ABORT_REPEAT_NS = 50_000_000  # between two requests where no step can be taken


class Devices(msgspec.Struct, frozen=True):
    """The three devices of a rig."""

    gripper: Gripper
    arm: Arm
    tactile: TactileSensor


class Issued(msgspec.Struct, frozen=True):
    """A command on its way: decided, admitted by the guard, and what the device could apply."""

    decided_ns: int
    sent_ns: int
    asked: Command
    admitted: Command
    applied: Applied | None  # None for arm and fingertips
    refused: str = ""


class Tick(msgspec.Struct, frozen=True):
    """Everything of one period, for recording, display and scoring."""

    observation: Observation
    decision: Decision
    issued: tuple[Issued, ...]  # since the tick before

    @property
    def t_ns(self) -> int:
        return self.observation.t_ns

    @property
    def frame(self) -> TactileFrame | None:
        return self.observation.frame

    @property
    def gripper(self) -> GripperState:
        return self.observation.gripper

    @property
    def arm(self) -> ArmState:
        return self.observation.arm

    @property
    def measured_n(self) -> Vector3:
        return self.observation.measured_n


class Timing:
    """Latency samples of a run, in nanoseconds, and what went missing."""

    def __init__(self) -> None:
        self.frame_to_decision_ns: list[int] = []
        self.gripper_commands_ns: list[tuple[int, int]] = []  # (decided, handed to the driver)
        self.frame_age_ns: list[int] = []
        self.missed_periods = 0  # that the loop slept through
        self.repeated_frames = 0  # periods without a new frame


# what a gripper does by itself where it is polled no more, and that in words; None: nothing
_SetFallback = Callable[[Callable[[Gripper], Applied] | None, str], None]


class _Waiting(msgspec.Struct, frozen=True):
    """A command that has been decided and not been sent yet."""

    due_ns: int
    step_ns: int  # time of the step that decided
    decided_ns: int  # when that step was done
    asked: Command
    admitted: Command


class ControlLoop:
    """Runs one grasp step on one set of devices."""

    stop_s = 20.0  # a run that was stopped may last, should its safe state not end it; assumed
    abort_s = 3.0  # for arm and hand to stand where no step can be taken any more; assumed
    spared_s = 0.002  # of a period, for those who watch, though an acknowledgement is late; assumed

    def __init__(
        self,
        devices: Devices,
        clock: Clock,
        step: GraspStep,
        settings: LoopSettings,
        on_tick: Callable[[Tick], None] = lambda tick: None,
    ) -> None:
        self.timing = Timing()
        self.errors: dict[str, Fault] = {}  # the first of each device, in their order
        self.set_down = False  # whoever runs the experiment asks for it, once it is held
        self._devices = devices
        self._clock = clock
        self._step = step
        self._on_tick = on_tick
        self._period_ns = round(settings.period_s * 1e9)
        self._delay_ns = round(settings.decision_delay_s * 1e9)
        self._deadlines = Deadlines(clock.now_ns, self._period_ns)
        self._queue: deque[_Waiting] = deque()
        self._issued: list[Issued] = []
        self._last: Tick | None = None
        self._new_errors: tuple[Fault, ...] = ()  # since the last step
        self._stop: Fault | None = None
        self._gripper_lost = False
        self._late_ns = self._took_ns = self._arm_ns = 0
        # only a gripper with a thread of its own can act while no step comes
        self._set_fallback: _SetFallback | None = getattr(devices.gripper, "set_fallback", None)

    def run(self, deadline_s: float) -> None:
        """Tick until the controller has finished; at the latest until deadline_s from now, and what
        an arm was slow by whose speed slider is turned down.

        Raises Interruption between two ticks when a signal has come.
        """
        start_ns, controller = self._clock.now_ns, self._step.controller
        end_ns = start_ns + round(deadline_s * 1e9)
        self._deadlines = Deadlines(start_ns, self._period_ns)  # what came before it is no lateness
        with signals.deferred():
            while not controller.finished and self._clock.now_ns < end_ns + controller.excused_ns:
                signals.check()
                self.tick()
        if not controller.finished:
            self.stop(Fault("run_timeout", TRIAL, TIMED_OUT, LONGER))

    def tick(self) -> Tick:
        """One period: wait for the next sample, step, send what was decided, then hand on."""
        now_ns = self._await_period()
        self._poll(now_ns)
        self._late_ns += self._clock.now_ns - now_ns  # 0 in virtual time
        told = self._gather(now_ns)
        start_ns, began_ns = stopwatch_ns(), self._clock.now_ns
        result = self._step.decide(told)
        self.timing.frame_to_decision_ns.append(stopwatch_ns() - start_ns)
        self._took_ns = self._clock.now_ns - began_ns  # 0 in virtual time, so that runs are equal
        self._enqueue(now_ns, result)
        self._send_before_anyone_watches()
        self._prepare_fallback(self._step.fallback(told.gripper) if self._set_fallback else None)
        tick = Tick(result.observation, result.decision, tuple(self._issued))
        self._issued.clear()
        self._last = tick
        self._on_tick(tick)
        return tick

    def submit(self, command: Command) -> None:
        """Put a command of somebody else's on its way; the guard admits it as any other."""
        now_ns = self._clock.now_ns
        admitted = self._step.admit(command, self._gripper_state())
        self._queue.append(_Waiting(now_ns, now_ns, now_ns, command, admitted))

    def stop(self, why: Fault) -> None:
        """The run shall end now: forget what was queued, but a closing that answers slip, and tick
        until the safe state is reached in which a grip is kept. No signal cuts this short, but
        where something hangs in it: raises Stuck then.
        """
        controller = self._step.controller
        if not controller.finished and not controller.in_safe_state:
            answering = controller.state is State.COMPENSATE
            kept = (w for w in self._queue if answering and isinstance(w.admitted, CloseFast))
            self._queue = deque(kept)
        self._stop = why
        self._pursue_safe_state()

    def fail(self, bug: Fault) -> None:
        """A bug of ours ends a run as any other fault does: its safe state is pursued. Raises what
        the bug raises where that cannot be."""
        self._queue.clear()
        self._new_errors = (bug,)
        self._pursue_safe_state()

    def _pursue_safe_state(self) -> None:
        end_ns = self._clock.now_ns + round(self.stop_s * 1e9)
        with signals.deferred():
            while not self._step.controller.finished and self._clock.now_ns < end_ns:
                signals.check(end=False)
                self.tick()
        self._prepare_fallback(None)

    def abort(self) -> Tick | None:
        """As ``fail`` where no step can be taken any more: arm and hand are commanded until both
        are seen to obey. Returns how they were left; None where there was no step at all."""
        self._queue.clear()
        start_ns = self._clock.now_ns
        stop, *hand = due = self._step.controller.aborted()
        while due and self._clock.now_ns < start_ns + round(self.abort_s * 1e9):
            for command in due:
                self._survives(partial(self._send_at_once, command))
            later_ns = self._clock.now_ns + ABORT_REPEAT_NS
            self._survives(partial(self._clock.sleep_until_ns, later_ns))
            for poll in (self._poll_gripper, self._poll_arm):
                self._survives(partial(poll, self._clock.now_ns))
            due = (stop, *hand)
            with suppress(Exception):  # of the step, or of another package's device
                due = self._unreached(due, start_ns)
        self._prepare_fallback(None)
        with suppress(Exception):
            return self._left()
        return self._last

    def _unreached(self, due: tuple[Command, ...], start_ns: int) -> tuple[Command, ...]:
        """What is to be asked for again; nothing where arm and hand are seen to obey. A closing is
        not begun again while it lasts."""
        left = self._left()
        if left is None or min(left.arm.t_ns, left.gripper.t_ns) <= start_ns:
            return due
        closes = not left.gripper.at_rest and HoldFingers() not in due
        again = due[:1] if closes else due
        return again if any(self._step.controller.missing(left.observation)) else ()

    @staticmethod
    def _survives(act: Callable[[], None]) -> None:
        """One device that fails must not keep the next from its turn."""
        signals.check(end=False)
        with suppress(BaseException):
            act()

    def _send_at_once(self, command: Command) -> None:
        now_ns, admitted = self._clock.now_ns, command
        if not isinstance(command, StopArm | HoldFingers):  # which nothing can be wrong with
            admitted = self._step.admit(command, self._gripper_state())
        self._send(_Waiting(now_ns, now_ns, now_ns, command, admitted))

    def _left(self) -> Tick | None:
        """The last step, with what the devices say now."""
        if self._last is None:
            return None
        last, devices = self._last.observation, self._devices
        inputs = msgspec.structs.replace(
            last.inputs, t_ns=self._clock.now_ns, gripper=devices.gripper.state or last.gripper,
            arm=devices.arm.state or last.arm, gripper_lost=self._gripper_lost, pending=False,
        )  # fmt: skip
        observation = msgspec.structs.replace(last, inputs=inputs, last_close=self._step.last_close)
        return Tick(observation, self._last.decision, tuple(self._issued))

    def _prepare_fallback(self, command: GripperCommand | None) -> None:
        """What the hand's own thread is to do should no further step come."""
        if self._set_fallback is None:
            return
        if command is None:
            self._set_fallback(None, "")
        else:
            self._set_fallback(partial(_to_gripper, command), describe(command))

    def _await_period(self) -> int:
        """Sleep to the next deadline, sending on the way what comes due; gives the time then."""
        due_ns = self._deadlines.next_ns()
        self._advance_to(due_ns)
        now_ns = self._clock.now_ns
        self._late_ns = now_ns - due_ns
        self._deadlines.leave_out(now_ns)
        self.timing.missed_periods = self._deadlines.missed
        return now_ns

    def _advance_to(self, t_ns: int) -> None:
        """Wait, and send on the way what comes due."""
        while self._queue and self._queue[0].due_ns <= t_ns:
            waiting = self._queue.popleft()
            self._clock.sleep_until_ns(waiting.due_ns)
            self._send(waiting)
        self._clock.sleep_until_ns(t_ns)

    def _poll(self, now_ns: int) -> None:
        self._guarded(FINGERTIPS, lambda: self._devices.tactile.poll(now_ns))
        self._poll_gripper(now_ns)
        self._poll_arm(now_ns)

    def _poll_arm(self, now_ns: int) -> None:
        self._arm_ns = now_ns
        self._guarded(ARM, lambda: self._devices.arm.poll(now_ns))

    def _poll_arm_before(self) -> None:
        """A command acts from where and when the arm was asked last."""
        now_ns = self._clock.now_ns
        if now_ns - self._arm_ns > SOON_NS:
            self._poll_arm(now_ns)

    def _poll_gripper(self, now_ns: int) -> None:
        error = self._guarded(GRIPPER, lambda: self._devices.gripper.poll(now_ns))
        if error is None:
            self._gripper_lost = False
        elif isinstance(error, LinkLost):
            self._gripper_lost = True

    def _guarded(self, device: str, action: Callable[[], None]) -> GraspError | None:
        """Do it; an expected error is an input of the next step, never an exception here."""
        try:
            action()
        except GraspError as error:
            self.note(device, error)
            return error
        return None

    def note(self, device: str, error: GraspError) -> str:
        """Tell the next step what a driver raised; returns it in a line."""
        fault = Fault.of(device, error)
        self.errors.setdefault(device, fault)
        if not any(e.device == device and e.code == fault.code for e in self._new_errors):
            self._new_errors += (fault,)
        return f"{fault.code}: {fault.message}"

    def _gripper_state(self) -> GripperState:
        state = self._devices.gripper.state
        assert state is not None  # noqa: S101  (a rig opens with it read)
        return state

    def _gather(self, now_ns: int) -> StepInput:
        """What the devices say now. Errors are told once."""
        tactile, arm = self._devices.tactile, self._devices.arm.state
        frame = tactile.frame
        assert arm is not None  # noqa: S101  (a rig opens with it read)
        if frame is not None:
            self.timing.frame_age_ns.append(now_ns - frame.sampled_ns)
            self.timing.repeated_frames += frame.missed > 0
        errors, self._new_errors = self._new_errors, ()
        return StepInput(
            t_ns=now_ns,
            frame=frame,
            rest_taken=tactile.rest_taken,
            gripper=self._gripper_state(),
            arm=arm,
            pending=bool(self._queue),
            errors=errors,
            gripper_lost=self._gripper_lost,
            set_down=self.set_down,
            stop=self._stop,
            late_ns=self._late_ns,
            took_ns=self._took_ns,
        )

    def _enqueue(self, step_ns: int, result: StepResult) -> None:
        decided_ns = self._clock.now_ns
        due_ns = step_ns + self._delay_ns
        self._queue.extend(
            _Waiting(due_ns, step_ns, decided_ns, asked, admitted)
            for asked, admitted in zip(result.decision.commands, result.admitted, strict=True)
        )

    def _send_before_anyone_watches(self) -> None:
        """On a real clock what is decided goes out at once, and is acknowledged, before a recorder
        or a picture takes the interpreter from the thread that writes to the gripper."""
        if self._clock.virtual or not self._queue:
            return
        self._advance_to(self._clock.now_ns + SOON_NS)
        end_ns = self._deadlines.last_ns + self._period_ns - round(self.spared_s * 1e9)
        while not self._devices.gripper.acknowledged and self._clock.now_ns < end_ns:
            self._clock.sleep_until_ns(self._clock.now_ns + POLL_NS)

    def _send(self, waiting: _Waiting) -> None:
        applied: Applied | None = None
        refused = ""
        sent_ns = self._clock.now_ns
        try:
            applied = self._to_device(waiting.admitted)
        except GraspError as error:
            refused = self.note(_addressee(waiting.admitted), error)
        if isinstance(waiting.admitted, GripperCommand):
            self.timing.gripper_commands_ns.append((waiting.decided_ns, sent_ns))
        self._issued.append(
            Issued(waiting.step_ns, sent_ns, waiting.asked, waiting.admitted, applied, refused)
        )
        if applied is not None:
            self._poll_gripper(self._clock.now_ns)

    def _to_device(self, command: Command) -> Applied | None:
        if isinstance(command, GripperCommand):
            return _to_gripper(command, self._devices.gripper)
        if isinstance(command, MoveArm):
            self._poll_arm_before()
            self._devices.arm.move_to(
                command.position_m, command.speed_mps, command.acceleration_mps2
            )
        elif isinstance(command, StopArm):
            try:
                self._poll_arm_before()
            finally:  # a stop goes out whatever is wrong
                self._devices.arm.stop(command.deceleration_mps2)
        else:
            self._devices.tactile.begin_rest()
        return None


def _to_gripper(command: GripperCommand, gripper: Gripper) -> Applied:
    if isinstance(command, MoveFingers):
        return gripper.move_to(command.targets_counts, command.speed_mps, command.force_n)
    if isinstance(command, CloseFast):
        return gripper.close_fast(
            command.force_cap_n, command.closing, command.limits_counts, command.speed_mps
        )
    if isinstance(command, OpenFingers):
        return gripper.open(command.speed_mps)
    return gripper.hold()


def _addressee(command: Command) -> str:
    if isinstance(command, GripperCommand):
        return GRIPPER
    return ARM if isinstance(command, MoveArm | StopArm) else FINGERTIPS
