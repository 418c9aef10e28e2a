"""ControlLoop: poll the devices, step, send the commands, notify observers; once a tactile sample.

The loop owns deadlines and timing statistics. It knows the devices only by their interfaces, and of
a step's result only the commands and their devices.
"""

from collections import deque
from collections.abc import Callable
from functools import partial

import msgspec

from drivers.errors import GraspError, LinkLost, counted
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
from grasp.control.commands import (
    CloseToLimit,
    Command,
    GripperCommand,
    HoldFingers,
    MoveArm,
    MoveFingers,
    OpenFingers,
    StopArm,
    describe,
)
from grasp.control.controller import GraspController
from grasp.control.controller_settings import LoopSettings
from grasp.control.fault import ARM, FINGERTIPS, GRIPPER, TRIAL, Fault
from grasp.control.observation import Observation
from grasp.control.states import SAFE_STATES, State
from grasp.control.step import GraspStep, StepResult
from grasp.control.transition import Decision
from grasp.run import signals
from grasp.run.clock import Clock, Deadlines, stopwatch_ns

TIMED_OUT = "the run did not end in time"
LONGER = "if it was only slow, raise loop.deadline_s"

# Constants and no settings, because no result depends on them.
SOON_NS = (
    1_000_000  # a command due within this is sent before observers run: half the shortest period
)
POLL_NS = 100_000  # between two checks whether the gripper has acknowledged a command
ABORT_REPEAT_NS = 50_000_000  # between two repetitions of the commands of `abort`


class Devices(msgspec.Struct, frozen=True):
    """The three devices of a rig."""

    gripper: Gripper
    arm: Arm
    tactile: TactileSensor


class Issued(msgspec.Struct, frozen=True):
    """A command that was sent: as requested, as admitted by the guard, as applied by the device."""

    decided_ns: int
    sent_ns: int
    requested: Command
    admitted: Command
    applied: Applied | None  # None for arm and fingertips
    refused: str = ""


class Tick(msgspec.Struct, frozen=True):
    """All data of one period, for recording, display and scoring."""

    observation: Observation
    decision: Decision
    issued: tuple[Issued, ...]  # since the previous tick

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
    def estimated_n(self) -> Vector3:
        return self.observation.estimated_n


class Timing:
    """Latency samples of a run, in nanoseconds, and counts of missed periods and frames."""

    def __init__(self) -> None:
        self.frame_to_decision_ns: list[int] = []
        self.gripper_commands_ns: list[tuple[int, int]] = []  # (decided, handed to the driver)
        self.frame_age_ns: list[int] = []
        self.missed_periods = 0  # skipped, because the loop was late
        self.repeated_frames = 0  # periods without a new frame


class _Waiting(msgspec.Struct, frozen=True):
    """A command that has been decided and not been sent yet."""

    due_ns: int
    step_ns: int  # time of the step that decided it
    decided_ns: int  # end of that step
    requested: Command
    admitted: Command


class ControlLoop:
    """Runs one grasp step on one set of devices."""

    stop_s = 20.0  # longest time for which the loop waits for a safe state; assumed
    abort_s = 3.0  # longest wait for arm and hand to stop where no step is possible; assumed
    observer_reserve_s = 0.002  # of each period, kept for observers; assumed

    def __init__(
        self,
        devices: Devices,
        clock: Clock,
        step: GraspStep[GraspController],
        settings: LoopSettings,
        on_tick: Callable[[Tick], None] = lambda tick: None,
    ) -> None:
        self.timing = Timing()
        self.hidden = step.hidden  # exceptions that were ignored, with their number
        self.errors: dict[str, Fault] = {}  # the first error of each device, in their order
        self.set_down = False  # set by the experiment to request the set-down of a held object
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

    def run(self, deadline_s: float) -> None:
        """Tick until the controller has finished, at most for deadline_s plus the additional time
        of a slow arm.

        Raises Interruption between two ticks when a signal has come.
        """
        now_ns, controller = self._clock.now_ns, self._step.controller
        end_ns, finished = now_ns + round(deadline_s * 1e9), controller.finished
        self._deadlines = Deadlines(
            now_ns, self._period_ns
        )  # the time before the run does not count as late
        with signals.deferred():
            while not finished and now_ns < end_ns + controller.arm_delay_ns:
                signals.check()
                tick = self.tick()
                now_ns, finished = tick.observation.t_ns, tick.decision.finished
        if not finished:
            self.stop(Fault("run_timeout", TRIAL, TIMED_OUT, LONGER))

    def tick(self) -> Tick:
        """Run one period: wait for the sample, step, send the commands, then notify observers."""
        clock, now_ns = self._clock, self._await_period()
        self._poll_tactile(now_ns)
        self._poll_gripper(now_ns)
        self._poll_arm(now_ns)
        began_ns = clock.now_ns  # in virtual time this and ``decided_ns`` are ``now_ns``
        obs = self._observe(now_ns, self._late_ns + began_ns - now_ns)
        start_ns = stopwatch_ns()
        result = self._step.decide(obs)
        self.timing.frame_to_decision_ns.append(stopwatch_ns() - start_ns)
        decided_ns = clock.now_ns
        self._took_ns = decided_ns - began_ns
        if result.admitted:
            self._enqueue(now_ns, decided_ns, result)
        if self._queue and not clock.virtual:
            self._send_before_observers()
        if not clock.virtual:
            due = self._step.controller.abort_commands() if not result.decision.finished else ()
            self._prepare_fallback(self._step.fallback(due, obs.gripper))
        tick = Tick(result.observation, result.decision, tuple(self._issued))
        self._issued.clear()
        self._last = tick
        self._on_tick(tick)
        return tick

    def submit(self, command: Command) -> None:
        """Queue a command from outside the controller; the guard limits it like any other."""
        now_ns = self._clock.now_ns
        admitted = self._step.admit(command, self._gripper_state())
        self._queue.append(_Waiting(now_ns, now_ns, now_ns, command, admitted))

    def stop(self, why: Fault) -> None:
        """End the run: drop queued commands, except a closing that responds to slip, and tick until
        the safe state that keeps a grip is confirmed. Signals do not cut this short. Raises Stuck
        on a signal if it hangs.
        """
        controller = self._step.controller
        if not controller.finished and not controller.in_safe_state:
            responding = controller.state is State.COMPENSATE
            kept = (w for w in self._queue if responding and isinstance(w.admitted, CloseToLimit))
            self._queue = deque(kept)
        self._stop = why
        self._reach_safe_state()

    def fail(self, bug: Fault) -> None:
        """End the run because of a bug in this program, in the safe state of a fault. Raises the
        exception of a further step that fails too."""
        self._queue.clear()
        self._new_errors = (bug,)
        self._reach_safe_state()

    def _reach_safe_state(self) -> None:
        end_ns = self._clock.now_ns + round(self.stop_s * 1e9)
        with signals.deferred():
            while not self._step.controller.finished and self._clock.now_ns < end_ns:
                signals.check(end=False)
                self.tick()
        self._prepare_fallback(None)

    def abort(self) -> Tick | None:
        """End the run where no step is possible any more: command arm and hand until both confirm.
        Returns the last tick with their present states; None if there was no step at all."""
        self._queue.clear()
        start_ns = self._clock.now_ns
        stop, *hand = due = self._step.controller.abort_commands()
        while due and self._clock.now_ns < start_ns + round(self.abort_s * 1e9):
            for command in due:
                self._call_suppressed(partial(self._send_at_once, command))
            later_ns = self._clock.now_ns + ABORT_REPEAT_NS
            self._call_suppressed(partial(self._clock.sleep_until_ns, later_ns))
            for poll in (self._poll_gripper, self._poll_arm):
                self._call_suppressed(partial(poll, self._clock.now_ns))
            due = (stop, *hand)
            with counted(self.hidden):  # of the step, or of another package's device
                due = self._commands_to_repeat(due, start_ns)
        self._prepare_fallback(None)
        left = self._last
        with counted(self.hidden):
            left = self._present()
        return left  # noqa: RET504  (what is left where the line before raises)

    def _commands_to_repeat(self, due: tuple[Command, ...], start_ns: int) -> tuple[Command, ...]:
        """Commands to repeat; none once arm and hand have confirmed. A closing in progress is not
        restarted."""
        present = self._present()
        if present is None or min(present.arm.t_ns, present.gripper.t_ns) <= start_ns:
            return due
        closes = not present.gripper.at_rest and HoldFingers() not in due
        again = due[:1] if closes else due
        return again if any(self._step.controller.unconfirmed_parts(present.observation)) else ()

    def _call_suppressed(self, act: Callable[[], None]) -> None:
        """Call and count any exception: a failing device must not block the next one."""
        signals.check(end=False)
        with counted(self.hidden, BaseException):
            act()

    def _send_at_once(self, command: Command) -> None:
        now_ns, admitted = self._clock.now_ns, command
        if not isinstance(command, StopArm | HoldFingers):  # these need no guard
            admitted = self._step.admit(command, self._gripper_state())
        self._send(_Waiting(now_ns, now_ns, now_ns, command, admitted))

    def _present(self) -> Tick | None:
        """The last tick with the present states of the devices."""
        if self._last is None:
            return None
        last, devices = self._last.observation, self._devices
        observation = msgspec.structs.replace(
            last, t_ns=self._clock.now_ns, gripper=devices.gripper.state or last.gripper,
            arm=devices.arm.state or last.arm, gripper_lost=self._gripper_lost, pending=False,
            last_close=self._step.last_close,
        )  # fmt: skip
        return Tick(observation, self._last.decision, tuple(self._issued))

    def _prepare_fallback(self, command: GripperCommand | None) -> None:
        """Set the command that the gripper driver's thread sends if no further step follows."""
        act = None if command is None else partial(to_gripper, command)
        self._devices.gripper.set_fallback(act, "" if command is None else describe(command))

    def _await_period(self) -> int:
        """Sleep until the next deadline and send commands that become due; returns the time."""
        due_ns = self._deadlines.next_ns()
        if self._queue:
            self._send_due(due_ns)
        self._clock.sleep_until_ns(due_ns)
        now_ns = self._clock.now_ns
        self._late_ns = now_ns - due_ns
        if self._late_ns > 0:
            self._deadlines.skip_missed(now_ns)
        self.timing.missed_periods = self._deadlines.missed
        return now_ns

    def _send_due(self, t_ns: int) -> None:
        """Wait for each command that is due until then, and send it."""
        while self._queue and self._queue[0].due_ns <= t_ns:
            waiting = self._queue.popleft()
            self._clock.sleep_until_ns(waiting.due_ns)
            self._send(waiting)

    # An expected error of a device becomes an input of the next step.

    def _poll_tactile(self, now_ns: int) -> None:
        try:
            self._devices.tactile.poll(now_ns)
        except GraspError as error:
            self.note(FINGERTIPS, error)

    def _poll_gripper(self, now_ns: int) -> None:
        try:
            self._devices.gripper.poll(now_ns)
        except GraspError as error:
            self.note(GRIPPER, error)
            self._gripper_lost = self._gripper_lost or isinstance(error, LinkLost)
        else:
            self._gripper_lost = False

    def _poll_arm(self, now_ns: int) -> None:
        self._arm_ns = now_ns
        try:
            self._devices.arm.poll(now_ns)
        except GraspError as error:
            self.note(ARM, error)

    def _poll_arm_before_command(self) -> None:
        """Refresh the arm's state, because a command starts from it."""
        now_ns = self._clock.now_ns
        if now_ns - self._arm_ns > SOON_NS:
            self._poll_arm(now_ns)

    def note(self, device: str, error: GraspError) -> str:
        """Pass a driver's error to the next step; returns it in one line."""
        fault = Fault.of(device, error)
        self.errors.setdefault(device, fault)
        if not any(e.device == device and e.code == fault.code for e in self._new_errors):
            self._new_errors += (fault,)
        return f"{fault.code}: {fault.message}"

    def _gripper_state(self) -> GripperState:
        state = self._devices.gripper.state
        assert state is not None  # noqa: S101  (a rig opens with it read)
        return state

    def _observe(self, now_ns: int, late_ns: int) -> Observation:
        """Present device states and new errors; each error is passed once."""
        devices = self._devices
        tactile, gripper, arm = devices.tactile, devices.gripper.state, devices.arm.state
        frame = tactile.frame
        assert gripper is not None and arm is not None  # noqa: S101  (a rig opens with both read)
        if frame is not None:
            self.timing.frame_age_ns.append(now_ns - frame.sampled_ns)
            self.timing.repeated_frames += frame.missed > 0
        errors, self._new_errors = self._new_errors, ()
        return Observation(
            t_ns=now_ns,
            frame=frame,
            rest_taken=tactile.rest_taken,
            gripper=gripper,
            arm=arm,
            pending=bool(self._queue),
            errors=errors,
            gripper_lost=self._gripper_lost,
            set_down=self.set_down,
            stop=self._stop,
            late_ns=late_ns,
            took_ns=self._took_ns,
        )

    def _enqueue(self, step_ns: int, decided_ns: int, result: StepResult) -> None:
        due_ns = step_ns + self._delay_ns
        if result.decision.state in SAFE_STATES:  # a move decided before must not follow
            self._queue = deque(w for w in self._queue if not isinstance(w.admitted, MoveArm))
        for requested, admitted in zip(result.decision.commands, result.admitted, strict=True):
            self._queue.append(_Waiting(due_ns, step_ns, decided_ns, requested, admitted))

    def _send_before_observers(self) -> None:
        """Send commands that are due soon and wait for the gripper's acknowledgement: recorder and
        display would delay the thread that writes to the gripper."""
        self._send_due(self._clock.now_ns + SOON_NS)
        end_ns = self._deadlines.last_ns + self._period_ns - round(self.observer_reserve_s * 1e9)
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
            Issued(waiting.step_ns, sent_ns, waiting.requested, waiting.admitted, applied, refused)
        )
        if applied is not None:
            self._poll_gripper(self._clock.now_ns)

    def _to_device(self, command: Command) -> Applied | None:
        if isinstance(command, GripperCommand):
            return to_gripper(command, self._devices.gripper)
        if isinstance(command, MoveArm):
            self._poll_arm_before_command()
            self._devices.arm.move_to(
                command.position_m, command.speed_mps, command.acceleration_mps2
            )
        elif isinstance(command, StopArm):
            try:
                self._poll_arm_before_command()
            finally:  # a stop is always sent
                self._devices.arm.stop(command.deceleration_mps2)
        else:
            self._devices.tactile.begin_rest()
        return None


def to_gripper(command: GripperCommand, gripper: Gripper) -> Applied:
    """Send a command to the gripper; returns what it applied. Raises Refused."""
    if isinstance(command, MoveFingers):
        return gripper.move_to(command.targets_counts, command.speed_mps, command.force_n)
    if isinstance(command, CloseToLimit):
        return gripper.close_to_limit(
            command.force_limit_n, command.closing, command.ends_counts, command.speed_mps
        )
    if isinstance(command, OpenFingers):
        return gripper.open(command.speed_mps)
    return gripper.hold()


def _addressee(command: Command) -> str:
    if isinstance(command, GripperCommand):
        return GRIPPER
    return ARM if isinstance(command, MoveArm | StopArm) else FINGERTIPS
