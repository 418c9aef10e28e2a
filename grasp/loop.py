"""ControlLoop: sample, detect, step, guard, command, record; once a tactile sample.

The loop owns the deadlines and the timing statistics; it knows devices by their interfaces alone.
"""

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Annotated, Protocol

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

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
from grasp.clock import Clock, stopwatch_ns
from grasp.commands import (
    BeginRest,
    CloseFast,
    Command,
    GripperCommand,
    HoldFingers,
    MoveArm,
    MoveFingers,
    OpenFingers,
    StopArm,
)
from grasp.controller import Decision, GraspController, Observation
from grasp.guard import ForceGuard
from grasp.phases import CONTACT_PHASES, Phase


class Detector(Protocol):
    """See ``detector.interface``."""

    def reset(self) -> None: ...

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]: ...


class LoopSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Pace of the loop."""

    period_s: Annotated[
        float, Meta(ge=0.002, le=0.1, description="one tactile sample (paper: 100 Hz)")
    ] = 0.01
    decision_delay_s: Annotated[
        float,
        Meta(
            ge=0.0,
            le=0.5,
            description="virtual time that a decision takes; default: p50 of frame "
            "to decision with `energy`, quiet; the paper's inference takes 0.021 s",
        ),
    ] = 0.00002
    stop_deceleration_mps2: Annotated[
        float, Meta(ge=0.1, le=10.0, description="of the arm when a person interrupts")
    ] = 1.0


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

    t_ns: int
    frame: TactileFrame | None
    gripper: GripperState
    arm: ArmState
    observation: Observation
    decision: Decision
    measured_n: Vector3
    issued: tuple[Issued, ...]  # since the tick before


class Timing:
    """Latency samples of a run, in nanoseconds, and missed periods."""

    def __init__(self) -> None:
        self.frame_to_decision_ns: list[int] = []
        self.decision_to_ack_ns: list[int] = []
        self.frame_age_ns: list[int] = []
        self.missed_periods = 0


class ControlLoop:
    """Runs one controller on one set of devices."""

    def __init__(
        self,
        devices: Devices,
        clock: Clock,
        detector: Detector,
        controller: GraspController,
        guard: ForceGuard,
        settings: LoopSettings,
        on_tick: Callable[[Tick], None] = lambda tick: None,
    ) -> None:
        self.timing = Timing()
        self.error: GraspError | None = None  # first device error of the run
        self.set_down = False  # whoever runs the experiment asks for it, once it is held
        self._devices = devices
        self._clock = clock
        self._detector = detector
        self._controller = controller
        self._guard = guard
        self._settings = settings
        self._on_tick = on_tick
        self._period_ns = round(settings.period_s * 1e9)
        self._delay_ns = round(settings.decision_delay_s * 1e9)
        self._next_ns = clock.now_ns
        self._queue: deque[tuple[int, int, Command]] = deque()  # (due, decided, command)
        self._issued: list[Issued] = []
        self._measured_n: Vector3 = (0.0, 0.0, 0.0)
        self._silent = np.zeros(3)
        self._trouble = ""
        self._gripper_lost = False

    def run(self, deadline_s: float) -> None:
        """Tick until the controller has finished; at the latest until deadline_s from now."""
        end_ns = self._clock.now_ns + round(deadline_s * 1e9)
        while not self._controller.finished and self._clock.now_ns < end_ns:
            self.tick()

    def tick(self) -> Tick:
        """One period: wait for the next sample, decide, queue what was decided."""
        self._next_ns += self._period_ns
        self._advance_to(self._next_ns)
        now_ns = self._clock.now_ns
        late = (now_ns - self._next_ns) // self._period_ns
        if late > 0:  # never catch up in a burst
            self.timing.missed_periods += int(late)
            self._next_ns += late * self._period_ns
        self._pump(now_ns)
        start_ns = stopwatch_ns()
        observation, decision = self._decide(now_ns)
        self.timing.frame_to_decision_ns.append(stopwatch_ns() - start_ns)
        due_ns = now_ns + self._delay_ns
        self._queue.extend((due_ns, now_ns, command) for command in decision.commands)
        tick = Tick(
            now_ns, self._devices.tactile.frame, observation.gripper, observation.arm, observation,
            decision, self._measured_n, tuple(self._issued),
        )  # fmt: skip
        self._issued.clear()
        self._on_tick(tick)
        return tick

    def interrupt(self) -> None:
        """A person wants it to stop: stop the arm, keep the grip, forget what was queued."""
        self._queue.clear()
        now_ns = self._clock.now_ns
        self._send(now_ns, now_ns, StopArm(self._settings.stop_deceleration_mps2))
        if self._controller.phase not in CONTACT_PHASES:
            self._send(now_ns, now_ns, HoldFingers())

    def _advance_to(self, t_ns: int) -> None:
        """Wait, and send on the way what has come due."""
        while self._queue and self._queue[0][0] <= t_ns:
            due_ns, decided_ns, command = self._queue.popleft()
            self._clock.sleep_until_ns(due_ns)
            self._send(self._clock.now_ns, decided_ns, command)
        self._clock.sleep_until_ns(t_ns)

    def _pump(self, now_ns: int) -> None:
        for name in ("tactile", "gripper", "arm"):
            self._guarded(name, partial(getattr(self._devices, name).pump, now_ns))

    def _guarded(self, device: str, action: Callable[[], None]) -> None:
        """Do it; an expected error becomes trouble for the next step, never an exception here."""
        try:
            action()
            if device == "gripper":
                self._gripper_lost = False
        except GraspError as error:
            self.error = self.error or error
            self._trouble = self._trouble or f"{error.kind}: {error.message}"
            if device == "gripper" and isinstance(error, LinkLost):
                self._gripper_lost = True

    def _decide(self, now_ns: int) -> tuple[Observation, Decision]:
        frame = self._devices.tactile.frame
        probabilities = self._silent
        if frame is not None:
            if frame.stale:
                self._detector.reset()
            else:
                probabilities = self._detector.update(frame.counts)
            self.timing.frame_age_ns.append(now_ns - frame.sampled_ns)
            self.timing.missed_periods += frame.missed > 0
            sums = frame.counts.sum(axis=1).tolist()
            self._measured_n = self._guard.measured_n((sums[0], sums[1], sums[2]))
        gripper, arm = self._devices.gripper.state, self._devices.arm.state
        assert gripper is not None and arm is not None  # noqa: S101  (a rig opens with both read)
        observation = Observation(
            t_ns=now_ns,
            probabilities=probabilities,
            tactile_stale=frame is not None and frame.stale,
            rest_taken=self._devices.tactile.rest_taken,
            gripper=gripper,
            arm=arm,
            pending=bool(self._queue),
            trouble=self._trouble,
            gripper_lost=self._gripper_lost,
            set_down=self.set_down,
        )
        self._trouble = ""
        before = self._controller.phase
        decision = self._controller.step(observation)
        if decision.reset_detector:
            self._detector.reset()
        if before is Phase.GRASP and decision.phase is Phase.LIFT:
            self._guard.anchor(gripper.positions, self._measured_n)
        return observation, decision

    def _send(self, now_ns: int, decided_ns: int, command: Command) -> None:
        start_ns = stopwatch_ns()
        admitted = command
        applied: Applied | None = None
        refused = ""
        try:
            if isinstance(command, GripperCommand):
                state = self._devices.gripper.state
                assert state is not None  # noqa: S101
                admitted = self._guard.admit(command, state, self._measured_n)
                applied = self._send_gripper(admitted)
                self._guarded("gripper", lambda: self._devices.gripper.pump(now_ns))
            else:
                self._send_other(command)
        except GraspError as error:
            self.error = self.error or error
            refused = f"{error.kind}: {error.message}"
            self._trouble = self._trouble or refused
        self.timing.decision_to_ack_ns.append(stopwatch_ns() - start_ns)
        self._issued.append(Issued(decided_ns, now_ns, command, admitted, applied, refused))

    def _send_other(self, command: BeginRest | MoveArm | StopArm) -> None:
        if isinstance(command, MoveArm):
            self._devices.arm.move_to(
                command.position_m, command.speed_mps, command.acceleration_mps2
            )
        elif isinstance(command, StopArm):
            self._devices.arm.stop(command.deceleration_mps2)
        else:
            self._devices.tactile.begin_rest()

    def _send_gripper(self, command: GripperCommand) -> Applied:
        gripper = self._devices.gripper
        if isinstance(command, MoveFingers):
            return gripper.move_to(command.targets_counts, command.speed_mps, command.force_n)
        if isinstance(command, CloseFast):
            return gripper.close_fast(
                command.force_cap_n, command.closing, command.limits_counts, command.speed_mps
            )
        if isinstance(command, OpenFingers):
            return gripper.open(command.speed_mps)
        return gripper.hold()
