"""Feeds what was recorded through the same detector, slip monitor, controller and guard."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from drivers.errors import ConfigError
from drivers.interfaces import FINGERS, TAXELS, ArmState, GripperState
from grasp.commands import GripperCommand, describe
from grasp.messages import (
    ARM,
    COMMANDS,
    CONTROL,
    GRIPPER,
    TACTILE,
    CommandMessage,
    ControlMessage,
    TactileMessage,
    observation,
)
from grasp.phases import Phase
from grasp.recording import BadRecordingFile, RunRecording
from grasp.settings import Layer, load
from scenarios.rigs.config import RunConfig
from scenarios.trial.execution import make_controller, make_guard
from scenarios.trial.run_folder import RECORDING, RUN_CHANNELS

COMPARED = (
    "phase",
    "probabilities",
    "armed",
    "masked",
    "registered",
    "event",
    "finger",
    "commands",
)


class Difference(msgspec.Struct, frozen=True):
    """One thing that the replay did otherwise than the recorded run."""

    t_s: float
    what: str
    recorded: str
    replayed: str


class Replay(msgspec.Struct, frozen=True):
    """What a recorded run was, and where a replay of it departs."""

    path: str
    steps: int
    complete: bool
    events: list[tuple[float, str]]  # (t_s, what): phases, registered slip, commands sent
    differences: list[Difference]


def find_recording(path: Path) -> Path:
    """The recording of a run folder, or the file itself."""
    return path / RECORDING if path.is_dir() else path


def replay_run(path: Path) -> Replay:
    """Replay a run; raises BadRecordingFile when it is none, or was made with other settings."""
    recording = RunRecording.open(find_recording(path), RUN_CHANNELS)
    stepper = _Stepper(_config(recording))
    for topic, t_ns, message in recording:
        stepper.take(topic, t_ns, message)
    if stepper.steps == 0:
        raise BadRecordingFile(f"{recording.path}: holds no control step", "record the run again")
    return Replay(str(path), stepper.steps, recording.complete, stepper.events, stepper.differences)


def _config(recording: RunRecording) -> RunConfig:
    try:
        table = msgspec.json.decode(recording.metadata["config"], type=dict[str, Any])
        return load(RunConfig, [Layer("metadata", table)])
    except (KeyError, msgspec.MsgspecError, ConfigError) as error:
        raise BadRecordingFile(
            f"{recording.path}: its settings do not fit this version: {error}",
            f"replay with grasp {recording.metadata.get('version.grasp', 'of its time')}",
        ) from error


class _Stepper:
    """Collects the messages of a step and replays it when its control message comes."""

    def __init__(self, config: RunConfig) -> None:
        self.steps = 0
        self.events: list[tuple[float, str]] = []
        self.differences: list[Difference] = []
        self._controller = make_controller(config)
        self._guard = make_guard(config)
        self._detector = config.make_detector(FINGERS)
        self._tactile: TactileMessage | None = None
        self._gripper: GripperState | None = None
        self._arm: ArmState | None = None
        self._measured_n = (0.0, 0.0, 0.0)

    def take(self, topic: str, t_ns: int, message: Any) -> None:
        """Take one message, in the order recorded."""
        if topic == TACTILE:
            self._tactile = message
        elif topic == GRIPPER:
            self._gripper = message
        elif topic == ARM:
            self._arm = message
        elif topic == COMMANDS:
            self._check_command(t_ns, message)
        elif topic == CONTROL:
            self._step(t_ns, message)

    def _step(self, t_ns: int, recorded: ControlMessage) -> None:
        assert self._gripper is not None and self._arm is not None  # noqa: S101
        before = self._controller.phase
        seen = observation(
            t_ns, self._tactile, recorded, self._gripper, self._arm, self._probabilities()
        )
        decision = self._controller.step(seen)
        if decision.reset_detector:
            self._detector.reset()
        if before is Phase.GRASP and decision.phase is Phase.LIFT:
            self._guard.anchor(self._gripper.positions, self._measured_n)
        slip = decision.slip
        replayed = msgspec.structs.replace(
            recorded, phase=decision.phase.value, probabilities=seen.probabilities.tolist(),
            armed=slip.armed, masked=slip.masked, registered=slip.registered, event=slip.event,
            finger=slip.finger, commands=list(decision.commands),
        )  # fmt: skip
        for name in COMPARED:
            self._compare(t_ns, name, getattr(recorded, name), getattr(replayed, name))
        self._note(t_ns, before, recorded)
        self._tactile = None  # a step without a frame has no message: rest is being taken anew
        self.steps += 1

    def _probabilities(self) -> Any:
        tactile = self._tactile
        if tactile is None:
            return np.zeros(FINGERS)
        counts = np.array(tactile.counts, np.int16).reshape(FINGERS, TAXELS)
        sums = counts.sum(axis=1).tolist()
        self._measured_n = self._guard.measured_n((sums[0], sums[1], sums[2]))
        if tactile.stale:
            self._detector.reset()
            return np.zeros(FINGERS)
        return self._detector.update(counts)

    def _check_command(self, t_ns: int, recorded: CommandMessage) -> None:
        asked = recorded.asked
        if self._gripper is None or not isinstance(asked, GripperCommand):
            return
        admitted = self._guard.admit(asked, self._gripper, self._measured_n)
        self._compare(t_ns, "admitted command", recorded.admitted, admitted)

    def _compare(self, t_ns: int, what: str, recorded: Any, replayed: Any) -> None:
        if recorded != replayed:
            self.differences.append(Difference(t_ns * 1e-9, what, str(recorded), str(replayed)))

    def _note(self, t_ns: int, before: Phase, recorded: ControlMessage) -> None:
        t_s = t_ns * 1e-9
        if recorded.event:
            self.events.append((t_s, "slip registered"))
        if self._controller.phase is not before:
            change = self._controller.machine.log[-1]
            self.events.append((t_s, f"phase {change.phase}: {change.cause}"))
        self.events += [(t_s, f"  {describe(command)}") for command in recorded.commands]
