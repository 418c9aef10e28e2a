"""Replays a recorded fingertip through the control step as if it were lifting an object.

A recording does not react to commands. Stub devices that obey every command replace gripper and
arm. Two control steps run side by side. The first never closes, so that no mask hides slip: it
gives the registered slip. The second responds to slip; when its lift has ended a new one begins, so
that every slip of the recording gets a response.
"""

import itertools
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import registered_events
from detector.interface import SlipDetector
from detector.recordings import Recording
from detector.scores.evaluation import Evaluation, evaluate_recording, stream
from drivers.interfaces import (
    FINGER_NAMES,
    FINGERS,
    PERIOD_NS,
    ArmState,
    Counts3,
    Detection,
    FingerState,
    GripperState,
    TactileFrame,
    Vector3,
)
from grasp.control.commands import (
    BeginRest,
    CloseToLimit,
    Command,
    MoveArm,
    MoveFingers,
    OpenFingers,
    describe,
)
from grasp.control.monitors.checks import Monitors, failed
from grasp.control.observation import Observation
from grasp.control.slip_response.close import CLOSED_COUNTS
from grasp.control.step import StepResult
from grasp.run.clock import stopwatch_ns
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import make_controller, make_step

ORIGIN: Vector3 = (0.0, 0.0, 0.0)
PRESSED_COUNTS = -100  # a taxel that is clearly pressed
NOISE_COUNTS = 5  # a load that has grown by more has grown
# Time that a stub finger closes before it meets its object. No setting: it represents no real hand,
# and registered slip comes from the step that never closes.
CLOSING_NS = 80_000_000
# A recording may lack fingers: what they show is no reason to close them further
UNRECORDED = (failed("fingertip_few_taxels", finger="B, C"),)
Counts = NDArray[np.int16]  # (fingers, taxels)


class SentCommand(msgspec.Struct, frozen=True):
    """A command that the controller would have sent, after the guard."""

    t_s: float
    phase: str
    command: Command
    text: str


class TactileReplay(msgspec.Struct, frozen=True):
    """Slip registered without any response, and the commands of a responding controller."""

    registered: list[tuple[float, str]]  # (t_s, finger)
    commands: list[SentCommand]
    probabilities: list[list[float]]


class _Lift:
    """A control step in the middle of a lift, with stub devices that obey at once.

    Closing takes 80 ms and ends in contact; a first stage takes half of that and ends at its
    target. The arm never arrives, so the lift lasts as long as the recording. The step first
    processes the ``earlier`` frames, so that at ``t_ns`` the lift has just begun. ``detector`` is
    reset; no two lifts at the same time may have the same.
    """

    def __init__(
        self, config: TrialConfig, detector: SlipDetector, earlier: Sequence[Counts], t_ns: int
    ) -> None:
        self.lifting = False  # the arm has been commanded to lift
        detector.reset()
        monitors = Monitors(config.monitors, enabled=False)
        self._step = make_step(
            config, make_controller(config), monitors=monitors, detector=detector
        )
        self._seq = 0
        self._rest_taken = False
        self._targets: Counts3 = (0, 0, 0)
        self._closes_until_ns = -1
        self._latched = False  # the thumb is stopped by the object
        times = itertools.count(t_ns - PERIOD_NS * len(earlier), PERIOD_NS)
        for counts in earlier:
            self.step(next(times), counts)

    @property
    def over(self) -> bool:
        """Whether the object is being set down, or the run has ended."""
        controller = self._step.controller
        return controller.finished or (self.lifting and not controller.slip_monitor.status.armed)

    def step(self, t_ns: int, counts: Counts) -> StepResult:
        self._seq += 1
        none = np.zeros_like(counts)
        frame = TactileFrame(t_ns, t_ns, self._seq, counts, counts, none, none)
        moves = self.lifting and not self._step.controller.in_safe_state
        arm = ArmState(t_ns, 0, ORIGIN, ORIGIN, moves)
        result = self._step.decide(
            Observation(
                t_ns=t_ns, frame=frame, rest_taken=self._rest_taken, gripper=self._gripper(t_ns),
                arm=arm, reported=UNRECORDED,
            )
        )  # fmt: skip
        for command in result.admitted:
            self._obey(command, t_ns)
        return result

    def _obey(self, command: Command, now_ns: int) -> None:
        if isinstance(command, MoveFingers):
            self._targets, self._latched = command.targets_counts, False
        elif isinstance(command, OpenFingers):
            self._targets, self._latched = (0, 0, 0), False
        elif isinstance(command, BeginRest):
            self._rest_taken = True
        elif isinstance(command, MoveArm):
            self.lifting = True
        elif isinstance(command, CloseToLimit) and not self._latched:
            self._latched = not command.first_stage
            self._closes_until_ns = now_ns + (CLOSING_NS if self._latched else CLOSING_NS // 2)
            if command.first_stage:
                self._targets = (command.ends_counts[0], *self._targets[1:])

    def _gripper(self, now_ns: int) -> GripperState:
        """The gripper's state; a thumb that closed is stopped by the object before its target."""
        detection = Detection.CONTACT_CLOSING if self._latched else Detection.AT_TARGET
        if now_ns < self._closes_until_ns:
            detection = Detection.MOVING
        a, b, c = self._targets
        thumb = FingerState(CLOSED_COUNTS[0] if self._latched else a, a, 0, detection)
        second, third = (FingerState(t, t, 0, Detection.AT_TARGET) for t in (b, c))
        return GripperState(now_ns, 0, True, 0, "", True, (thumb, second, third))


def replay_tactile(config: TrialConfig, recording: Recording) -> TactileReplay:
    """Replay a recording of one to three fingers. Slip is registered from these fingers alone, as
    `detector evaluate` does; to the controller the others feel what the last one of them feels."""
    frames = recording.counts[:, np.minimum(range(FINGERS), recording.fingers - 1)]
    made = config.make_detector(recording.fingers, recording.taxels)
    probabilities, _ = stream(made, recording.counts)
    on = [slice(first, after) for first, after in registered_events(probabilities, config.rule)]
    registered = [
        (float(recording.t_s[event.start]), FINGER_NAMES[int(probabilities[event.start].argmax())])
        for event in on
    ]
    replay = TactileReplay(registered, [], probabilities.tolist())
    detector = config.make_detector(FINGERS)
    lead = _steps_until_lift(config, detector)
    slips = np.zeros(len(frames), np.bool_)
    for event in on:
        slips[event] = True
    lift: _Lift | None = None
    began, next_lift = 0, 0  # frames
    thumb = frames[:, 0].min(axis=1)
    for k, t_s in enumerate(recording.t_s.tolist()):
        t_ns = round(t_s * 1e9)
        if lift is not None and lift.over and k <= began + 1:
            # it failed at once, with an unloaded thumb: the next one takes as long as a grasp,
            # unless the thumb is loaded more before
            next_lift = began + lead
        due = k >= next_lift or thumb[k] < thumb[began] - NOISE_COUNTS
        if (lift is None or lift.over) and not slips[k] and due:
            # the first frame repeats for the time before the recording
            earlier = [frames[max(0, i)] for i in range(k - lead, k)]
            lift, began = _Lift(config, detector, earlier, t_ns), k
        if lift is not None:
            result = lift.step(t_ns, frames[k])
            phase = result.decision.state.value
            replay.commands.extend(
                SentCommand(t_ns * 1e-9, phase, c, describe(c)) for c in result.admitted
            )
    return replay


def score(config: TrialConfig, recording: Recording) -> Evaluation | None:
    """Evaluation of the configured detector; None without labels."""
    if not recording.labelled:
        return None
    detector = config.make_detector(recording.fingers, recording.taxels)
    return evaluate_recording(detector, config.rule, recording, clock_ns=stopwatch_ns)


def _steps_until_lift(config: TrialConfig, detector: SlipDetector) -> int:
    """Number of frames that a grasp with a pressed thumb takes until the arm lifts."""
    lift = _Lift(config, detector, (), 0)
    pressed = np.full((FINGERS, config.tactile.taxels), PRESSED_COUNTS, np.int16)
    for steps in itertools.count(1):
        lift.step(steps * PERIOD_NS, pressed)
        if lift.lifting:
            return steps
    raise AssertionError
