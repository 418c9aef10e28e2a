"""Feeds a recorded fingertip through detector, slip monitor and controller, as if it were lifting.

A recording cannot react: whatever is commanded, the signal goes on. Devices that simply obey stand
in for gripper and arm, and a controller that has ended its lift is followed by a fresh one, so that
every stroke of the recording gets its answer.
"""

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import make_rule
from detector.recordings import Recording
from drivers.interfaces import (
    FINGER_NAMES,
    FINGERS,
    TAXELS,
    ArmState,
    Counts3,
    Detection,
    FingerState,
    GripperState,
)
from grasp.commands import (
    BeginRest,
    CloseFast,
    Command,
    GripperCommand,
    MoveArm,
    MoveFingers,
    OpenFingers,
    describe,
)
from grasp.controller import GraspController, Observation
from grasp.phases import Phase
from grasp.slip import SlipMonitor
from scenarios.rigs.config import RunConfig
from scenarios.trial.execution import make_controller, make_guard

CLOSING_NS = 80_000_000  # how long a stand-in finger closes before it meets its object
PERIOD_NS = 10_000_000
_LIFTING = frozenset({Phase.LIFT, Phase.COMPENSATE, Phase.HOLD})


class SentCommand(msgspec.Struct, frozen=True):
    """What the controller would have sent, after the guard."""

    t_s: float
    phase: str
    command: Command
    text: str


class TactileReplay(msgspec.Struct, frozen=True):
    """Registered slip of the monitor alone (never masked), and the controller's answers."""

    registered: list[tuple[float, str]]  # (t_s, finger)
    commands: list[SentCommand]
    probabilities: list[list[float]]


class ObedientDevices:
    """Gripper and arm that obey at once; closing takes 80 ms and ends in contact."""

    def __init__(self) -> None:
        self.rest_taken = False
        self._targets: Counts3 = (0, 0, 0)
        self._closes_until_ns = -1
        self._latched = False
        self._lifting = False

    def obey(self, command: Command, now_ns: int) -> None:
        if isinstance(command, MoveFingers):
            self._targets, self._latched = command.targets_counts, False
        elif isinstance(command, CloseFast) and not self._latched:
            self._closes_until_ns, self._latched = now_ns + CLOSING_NS, True
        elif isinstance(command, OpenFingers):
            self._targets, self._latched = (0, 0, 0), False
        elif isinstance(command, BeginRest):
            self.rest_taken = True
        elif isinstance(command, MoveArm):
            self._lifting = True

    def gripper(self, now_ns: int) -> GripperState:
        detection = Detection.CONTACT_CLOSING if self._latched else Detection.AT_TARGET
        if now_ns < self._closes_until_ns:
            detection = Detection.MOVING
        a, b, c = (FingerState(t, t, 0, detection) for t in self._targets)
        return GripperState(now_ns, 0, True, 0, "", True, (a, b, c))

    def arm(self, now_ns: int) -> ArmState:
        return ArmState(now_ns, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), self._lifting)


class _Lift:
    """A controller in the middle of a lift, on stand-in devices."""

    def __init__(self, config: RunConfig, now_ns: int) -> None:
        self.controller: GraspController = make_controller(config)
        self._guard = make_guard(config)
        self._devices = ObedientDevices()
        silent = np.zeros(FINGERS)
        t_ns = now_ns - round(config.controller.settle_s * 2e9)
        while self.controller.phase is not Phase.LIFT:
            t_ns += PERIOD_NS
            self.step(t_ns, silent)

    def step(self, t_ns: int, probabilities: NDArray[np.float64]) -> list[Command]:
        gripper = self._devices.gripper(t_ns)
        decision = self.controller.step(
            Observation(
                t_ns, probabilities, False, self._devices.rest_taken, gripper,
                self._devices.arm(t_ns),
            )
        )  # fmt: skip
        sent: list[Command] = []
        for command in decision.commands:
            admitted: Command = command
            if isinstance(command, GripperCommand):
                admitted = self._guard.admit(command, gripper, (0.0, 0.0, 0.0))
            self._devices.obey(admitted, t_ns)
            sent.append(admitted)
        return sent


def replay_tactile(config: RunConfig, recording: Recording) -> TactileReplay:
    """Replay a recording of one to three fingers; missing fingers stay at rest."""
    detector = config.make_detector(FINGERS)
    monitor = SlipMonitor(make_rule(config.rule, FINGERS), config.slip)
    monitor.arm()
    frame = np.zeros((FINGERS, TAXELS), np.int16)
    commands: list[SentCommand] = []
    probabilities: list[list[float]] = []
    lift: _Lift | None = None
    for t_s, counts in zip(recording.t_s.tolist(), recording.counts, strict=True):
        t_ns = round(t_s * 1e9)
        frame[: len(counts)] = counts
        p = detector.update(frame)
        probabilities.append(p.tolist())
        monitor.update(t_ns, p)
        ended = lift is None or lift.controller.phase not in _LIFTING
        if ended and not monitor.status.registered:
            lift = _Lift(config, t_ns - PERIOD_NS)
        if lift is not None:
            sent = lift.step(t_ns, p)
            phase = lift.controller.phase.value
            commands += [SentCommand(t_s, phase, c, describe(c)) for c in sent]
    registered = [(t_ns * 1e-9, FINGER_NAMES[finger]) for t_ns, finger in monitor.events]
    return TactileReplay(registered, commands, probabilities)
