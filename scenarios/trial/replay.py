"""Feeds what was recorded to the same grasp step, and compares all that it concludes."""

from pathlib import Path
from typing import Any

import msgspec

from drivers.errors import BadFile, ConfigError
from drivers.interfaces import ArmState, GripperState, TactileFrame, Vector3
from grasp.commands import describe
from grasp.messages import (
    ARM,
    COMMANDS,
    CONTROL,
    GRIPPER,
    TACTILE,
    CommandMessage,
    ControlMessage,
    control_message,
    recorded_arm,
    recorded_frame,
    recorded_input,
)
from grasp.recording import RunRecording
from grasp.settings import Layer, load, renamed
from grasp.step import StepResult
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import make_controller, make_step
from scenarios.trial.run_folder import open_trial


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


def replay_run(path: Path) -> Replay:
    """Replay a run; raises BadFile when it is none, or was made with other settings."""
    recording = open_trial(path)
    stepper = _Stepper(_config(recording), _home(recording))
    for topic, t_ns, message in recording:
        stepper.take(topic, t_ns, message)
    if stepper.steps == 0:
        raise BadFile(recording.path, "holds no whole control step", "record the run again")
    return Replay(str(path), stepper.steps, recording.complete, stepper.events, stepper.differences)


def _config(recording: RunRecording) -> TrialConfig:
    """The settings of rig and control; those of the scenario play no part in a replay."""
    try:
        table = msgspec.json.decode(recording.metadata["config"], type=dict[str, Any])
        known = {k: v for k, v in table.items() if k in TrialConfig.__struct_fields__ or renamed(k)}
        return load(TrialConfig, [Layer("metadata", known)])
    except (KeyError, RecursionError, msgspec.MsgspecError, ConfigError) as error:
        raise BadFile(
            recording.path,
            f"its settings do not fit this version: {error}",
            f"replay with grasp {recording.metadata.get('version.grasp', 'of its time')}",
        ) from error


def _home(recording: RunRecording) -> Vector3 | None:
    """Of the arm, where an earlier trial had taken it."""
    said = recording.metadata.get("home_m")
    try:
        return None if said is None else msgspec.json.decode(said, type=Vector3)
    except msgspec.MsgspecError as error:
        raise BadFile(recording.path, f"home_m: {error}", "record the run again") from error


class _Stepper:
    """Collects the messages of a step and replays it when its control message comes."""

    def __init__(self, config: TrialConfig, home: Vector3 | None) -> None:
        self.steps = 0
        self.events: list[tuple[float, str]] = []
        self.differences: list[Difference] = []
        self._step = make_step(config, make_controller(config, home))
        self._frame: TactileFrame | None = None
        self._gripper: GripperState | None = None
        self._arm: ArmState | None = None
        self._replayed: dict[int, StepResult] = {}  # by time of the step
        self._sent: list[tuple[int, CommandMessage]] = []  # not compared yet

    def take(self, topic: str, t_ns: int, message: Any) -> None:
        """Take one message, in the order recorded."""
        if topic == TACTILE:
            self._frame = recorded_frame(t_ns, message)
        elif topic == GRIPPER:
            self._gripper = message
        elif topic == ARM:
            self._arm = recorded_arm(message)
        elif topic == COMMANDS:
            self._sent.append((t_ns, message))
        elif topic == CONTROL:
            self._replay(t_ns, message)

    def _replay(self, t_ns: int, recorded: ControlMessage) -> None:
        if self._gripper is None or self._arm is None:
            return  # a recording that begins in the middle of a step
        told = recorded_input(t_ns, self._frame, recorded, self._gripper, self._arm)
        result = self._step.decide(told)
        replayed = control_message(result.observation, result.decision)
        for name in msgspec.structs.asdict(recorded):
            self._compare(t_ns, name, getattr(recorded, name), getattr(replayed, name))
        if result.decision.commands:
            self._replayed[t_ns] = result
        for sent_ns, message in self._sent:
            self._check_command(sent_ns, message)
        self._sent.clear()
        self._note(t_ns, recorded)
        self._frame = None  # a step without a frame has no message: rest is being taken anew
        self.steps += 1

    def _check_command(self, sent_ns: int, recorded: CommandMessage) -> None:
        """Was this admitted as the step that decided it says, or as the guard says if none did?"""
        decided = self._replayed.get(recorded.decided_ns)
        asked = recorded.asked
        if decided is not None and asked in decided.decision.commands:
            admitted = decided.admitted[decided.decision.commands.index(asked)]
        else:
            assert self._gripper is not None  # noqa: S101  (a step has been replayed)
            admitted = self._step.admit(asked, self._gripper)
        self._compare(sent_ns, "admitted command", recorded.admitted, admitted)

    def _compare(self, t_ns: int, what: str, recorded: Any, replayed: Any) -> None:
        if recorded != replayed:
            self.differences.append(Difference(t_ns * 1e-9, what, str(recorded), str(replayed)))

    def _note(self, t_ns: int, recorded: ControlMessage) -> None:
        t_s = t_ns * 1e-9
        if recorded.event:
            self.events.append((t_s, "slip registered"))
        self.events += [
            (t_s, f"phase {change.phase}: {change.cause}")
            for change in self._step.controller.machine.log
            if change.t_ns == t_ns
        ]
        self.events += [(t_s, f"  {describe(command)}") for command in recorded.commands]
