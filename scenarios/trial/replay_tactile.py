"""Feeds a recorded fingertip to the grasp step, as if it were lifting.

A recording cannot react: whatever is commanded, the signal goes on. Devices that simply obey stand
in for gripper and arm, and a step that has ended its lift is followed by a fresh one, so that every
stroke of the recording gets its answer.
"""

import itertools
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import make_rule
from detector.recordings import Recording
from drivers.interfaces import (
    FINGER_NAMES,
    FINGERS,
    PERIOD_NS,
    TAXELS,
    ArmState,
    Counts3,
    Detection,
    FingerState,
    GripperState,
    TactileFrame,
)
from grasp.commands import (
    BeginRest,
    CloseFast,
    Command,
    MoveArm,
    MoveFingers,
    OpenFingers,
    describe,
)
from grasp.controller import CLOSED_COUNTS
from grasp.doubt import Doubts
from grasp.observation import StepInput
from grasp.slip import SlipMonitor
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import make_step

PRESSED_COUNTS = -100  # a taxel that is surely touched
CLOSING_NS = 80_000_000  # how long a stand-in finger closes before it meets its object
Counts = NDArray[np.int16]  # (fingers, taxels)


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
        self.lifting = False

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
            self.lifting = True

    def gripper(self, now_ns: int) -> GripperState:
        """A thumb that closed stands on its object, short of where it was told to go."""
        detection = Detection.CONTACT_CLOSING if self._latched else Detection.AT_TARGET
        if now_ns < self._closes_until_ns:
            detection = Detection.MOVING
        a, b, c = self._targets
        thumb = FingerState(CLOSED_COUNTS[0] if self._latched else a, a, 0, detection)
        second, third = (FingerState(t, t, 0, Detection.AT_TARGET) for t in (b, c))
        return GripperState(now_ns, 0, True, 0, "", True, (thumb, second, third))

    def arm(self, now_ns: int) -> ArmState:
        return ArmState(now_ns, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), self.lifting)


class _Undoubted(Doubts):
    """Stand-ins are believed: missing fingers read nothing, and the arm stays where it is."""

    def of(self, *_: object) -> str:
        return ""


class _Lift:
    """A grasp step in the middle of a lift, on stand-in devices.

    It begins some time before ``t_ns``, on the frames that came before, so that at ``t_ns`` the
    arm has just been told to lift.
    """

    def __init__(self, config: TrialConfig, earlier: Sequence[Counts], t_ns: int) -> None:
        self._step = make_step(config, doubts=_Undoubted(config.doubt))
        self._devices = ObedientDevices()
        self._seq = 0
        times = itertools.count(t_ns - PERIOD_NS * len(earlier), PERIOD_NS)
        for counts in earlier:
            self.step(next(times), counts)

    @property
    def begun(self) -> bool:
        """The arm has been told to lift."""
        return self._devices.lifting

    @property
    def over(self) -> bool:
        """The object is being set down, or all has ended."""
        controller = self._step.controller
        return controller.finished or (self.begun and not controller.monitor.status.armed)

    def step(self, t_ns: int, counts: Counts) -> list[SentCommand]:
        self._seq += 1
        none = np.zeros_like(counts)
        frame = TactileFrame(t_ns, t_ns, self._seq, counts, counts, none, none)
        result = self._step.decide(
            StepInput(
                t_ns=t_ns,
                frame=frame,
                rest_taken=self._devices.rest_taken,
                gripper=self._devices.gripper(t_ns),
                arm=self._devices.arm(t_ns),
            )
        )
        phase = result.decision.phase.value
        for command in result.admitted:
            self._devices.obey(command, t_ns)
        return [SentCommand(t_ns * 1e-9, phase, c, describe(c)) for c in result.admitted]


def replay_tactile(config: TrialConfig, recording: Recording) -> TactileReplay:
    """Replay a recording of one to three fingers; missing fingers stay at rest."""
    detector = config.make_detector(FINGERS)
    monitor = SlipMonitor(make_rule(config.rule, FINGERS), config.slip)
    monitor.arm()
    frames = np.zeros((len(recording.t_s), FINGERS, TAXELS), np.int16)
    frames[:, : recording.counts.shape[1]] = recording.counts
    commands: list[SentCommand] = []
    probabilities: list[list[float]] = []
    lead = _steps_until_lift(config)
    lift: _Lift | None = None
    for k, t_s in enumerate(recording.t_s.tolist()):
        t_ns = round(t_s * 1e9)
        p = detector.update(frames[k])
        probabilities.append(p.tolist())
        monitor.update(t_ns, p)
        if (lift is None or lift.over) and not monitor.status.registered:
            # the first frame stands in for what came before the recording
            earlier = [frames[max(0, i)] for i in range(k - lead, k)]
            lift = _Lift(config, earlier, t_ns)
        if lift is not None:
            commands += lift.step(t_ns, frames[k])
    registered = [(t_ns * 1e-9, FINGER_NAMES[finger]) for t_ns, finger in monitor.events]
    return TactileReplay(registered, commands, probabilities)


def _steps_until_lift(config: TrialConfig) -> int:
    """How many frames a grasp takes until its arm lifts, with a thumb that presses."""
    lift = _Lift(config, (), 0)
    pressed = np.full((FINGERS, TAXELS), PRESSED_COUNTS, np.int16)
    for steps in itertools.count(1):
        lift.step(steps * PERIOD_NS, pressed)
        if lift.begun:
            return steps
    raise AssertionError
