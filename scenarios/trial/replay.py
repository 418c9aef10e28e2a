"""Replays a recorded run through the same control step and compares every result."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from detector.network_file import is_weights
from detector.plugins import is_plugin_file
from drivers.errors import BadFile, ConfigError, UsageError
from drivers.interfaces import FINGERS, ArmState, Counts3, GripperState, TactileFrame, Vector3
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.hand_state import POSITION_ERROR_COUNTS, closing_targets, motion_registers
from drivers.robotiq.protocol import BASIC, BYTES, FULL_BYTE
from grasp.control.commands import (
    CloseToLimit,
    Command,
    GripperCommand,
    HoldFingers,
    MoveFingers,
    OpenFingers,
    describe,
)
from grasp.control.states import PhaseChange
from grasp.run.messages import (
    ARM,
    COMMANDS,
    CONTROL,
    GRIPPER,
    PHASES,
    TACTILE,
    CommandMessage,
    ControlMessage,
    control_message,
    recorded_arm,
    recorded_frame,
    recorded_input,
)
from grasp.run.recording import RunRecording
from grasp.settings import Layer, load
from scenarios.rigs.calibration import calibration
from scenarios.trial.config import TrialConfig, digest_of
from scenarios.trial.execution import make_controller, make_step
from scenarios.trial.run_folder import POLICY, open_trial

# Excludes the mode (in byte 0), individual scissor control (in byte 1), and the scissor's bytes
_COMPARED = (0b11111001, 0b11110111, *[FULL_BYTE] * 10, 0, 0, 0, FULL_BYTE)
_TARGETS, _SPEED = slice(3, 12, 3), 4  # in the 16 bytes
_FIRST = motion_registers(BASIC, (0, 0, 0), 0, (0, 0, 0)).to_bytes()[:2]  # the register of rACT

# Probabilities that differ less are equal: another processor adds in another order
_ROUNDING = 1e-5

Bounds = tuple[bytes, bytes]  # least and greatest of each byte


class WriteCheck:
    """Compares commands to the gripper with the register bytes that it acknowledged, in order."""

    def __init__(self, calibration: GripperCalibration) -> None:
        self.compared = 0
        self._calibration = calibration
        self._before: GripperState | None = None
        self._sent: list[GripperCommand] = []  # the last confirmed as written, and all later ones
        self._unconfirmed = False  # the latest command is not confirmed as written yet
        self._device_failed = False  # the driver may have stopped the hand itself

    def send(self, command: GripperCommand) -> None:
        self._sent.append(command)
        self._unconfirmed = True

    def take(self, state: GripperState, device_failed: bool) -> tuple[str, str] | None:
        """Recorded and expected bytes where they differ, else None. ``state``: a step's input.

        A new command replaces a waiting one, so a write may carry any command since the last write.
        A fresh status belongs to the latest command.
        """
        before, self._before = self._before or state, state
        self._device_failed = self._device_failed or device_failed or not state.active
        new = state.written_ns != before.written_ns
        due = self._unconfirmed and state.fresh and bool(state.written) and not self._device_failed
        if not self._sent or not (new or due):
            return None
        self.compared += new
        candidates = self._sent[-1:] if due else self._sent
        written, bounds = _bytes(state.written), (b"", b"")
        for i, command in enumerate(candidates, len(self._sent) - len(candidates)):
            bounds = self._bounds(command, before, state)
            if _within(written, bounds):
                self._unconfirmed = i < len(self._sent) - 1
                del self._sent[:i]
                return None
        if self._device_failed:  # the driver resets or holds the hand after a lost link
            hold = self._bounds(HoldFingers(), before, state)
            if not any(written) or _within(written, hold):
                return None
        self._unconfirmed, (low, high) = False, bounds
        return written.hex(" "), f"{low.hex(' ')} to {high.hex(' ')} ({describe(self._sent[-1])})"

    def _bounds(self, command: GripperCommand, before: GripperState, state: GripperState) -> Bounds:
        """Allowed range of each byte for a command."""
        written, known = _bytes(before.written), [before.positions, state.positions]
        if before.written:
            known.append(_counts(written[_TARGETS]))
        least = _counts([min(each) - POSITION_ERROR_COUNTS for each in zip(*known, strict=True)])
        most = _counts([max(each) + POSITION_ERROR_COUNTS for each in zip(*known, strict=True)])
        if isinstance(command, HoldFingers):
            low, high = self._image(command, least, 0), self._image(command, most, 0)
            return bytes((low[0] & ~8, *low[1:])), high  # it may stop by clearing rGTO instead
        slowest = speed = self._calibration.speed_byte_at_most(command.speed_mps)
        if isinstance(command, CloseToLimit):  # after an implausible status it may be lower
            slowest = min(speed, written[_SPEED])
        return self._image(command, least, slowest), self._image(command, most, speed)

    def _image(self, command: GripperCommand, stay: Counts3, speed: int) -> bytes:
        """The bytes for a command; fingers that do not move get the targets ``stay``."""
        targets, forces = stay, [0] * FINGERS
        if isinstance(command, OpenFingers):
            targets = (0, 0, 0)
        elif isinstance(command, MoveFingers):
            targets = command.targets_counts
            forces = [self._calibration.byte_at_most(command.force_n)] * FINGERS
        elif isinstance(command, CloseToLimit):
            targets = closing_targets(command.closing, command.ends_counts, stay)
            byte = self._calibration.byte_at_most(command.force_limit_n)
            forces = [byte if closes else 0 for closes in command.closing]
        return motion_registers(BASIC, targets, speed, forces).to_bytes()


def _counts(values: Sequence[int]) -> Counts3:
    a, b, c = (max(0, min(FULL_BYTE, value)) for value in values)
    return a, b, c


def _bytes(text: str) -> bytes:
    """All 16 bytes of a write, which may leave out an unchanged first register; where there was no
    write, bytes that match no command."""
    data = bytes.fromhex(text)
    whole = data if len(data) == BYTES else _FIRST + data
    return whole if len(whole) == BYTES else bytes([FULL_BYTE] * BYTES)


def _within(written: bytes, bounds: Bounds) -> bool:
    return all(
        low <= byte & compared <= high
        for byte, compared, low, high in zip(written, _COMPARED, *bounds, strict=True)
    )


class Difference(msgspec.Struct, frozen=True):
    """One value that differs between recorded run and replay."""

    t_s: float
    what: str
    recorded: str
    replayed: str


class Replay(msgspec.Struct, frozen=True):
    """Events of a recorded run, and differences of its replay."""

    path: str
    steps: int
    complete: bool
    events: list[tuple[float, str]]  # (t_s, what): phases, registered slip, commands sent
    differences: list[Difference]
    writes: int = 0  # to the gripper, compared byte by byte


def replay_run(path: Path, detector: str | None = None) -> Replay:
    """Replay a run. Raises BadFile for another kind of file or settings that do not fit this
    version, and UsageError for a recording with user code that the caller did not name.

    ``detector``: path of the user's code or weights that it was recorded with.
    """
    recording = open_trial(path)
    if POLICY in recording.metadata:
        remedy = "`grasp report` shows it; give a lift or a tap"
        raise BadFile(recording.path, "an episode of a policy cannot be replayed", remedy)
    config, settings, home = _settings(recording, detector)
    stepper = _Stepper(config, home)
    stepper.compare(0, "hash of the settings", recording.metadata.get("config_hash"), settings)
    for topic, t_ns, message in recording:
        stepper.take(topic, t_ns, message)
    stepper.end(recording.complete)
    if stepper.steps == 0:
        raise BadFile(recording.path, "holds no complete control step", "record the run again")
    return Replay(
        str(path), stepper.steps, recording.complete, stepper.events, stepper.differences,
        stepper.writes.compared,
    )  # fmt: skip


def _settings(
    recording: RunRecording, detector: str | None
) -> tuple[TrialConfig, str, Vector3 | None]:
    """Settings of rig and control, hash of all settings, and the arm's home if an earlier trial set
    it. A replay does not use the settings of the experiment."""
    recorded_home = recording.metadata.get("home_m")
    try:
        home = None
        if recorded_home is not None:
            home = msgspec.json.decode(recorded_home, type=Vector3)
        table = msgspec.json.decode(recording.metadata["config"], type=dict[str, Any])
        table["detector_name"] = _trusted(str(table["detector_name"]), detector)
        known = {k: v for k, v in table.items() if k in TrialConfig.__struct_fields__}
        return load(TrialConfig, [Layer("metadata", known)]), digest_of(table), home
    except (KeyError, RecursionError, msgspec.MsgspecError, ConfigError) as error:
        raise BadFile(
            recording.path,
            f"its settings do not fit this version: {error}",
            f"replay with grasp {recording.metadata.get('version.grasp', 'of its time')}",
        ) from error


def _trusted(recorded: str, given: str | None) -> str:
    """The detector to replay with. A recording never runs code that the caller did not name."""
    from_file = is_plugin_file(recorded) or is_weights(recorded)
    if given is None and is_plugin_file(recorded):
        raise UsageError(
            f"it was recorded with {recorded}, code that a replay does not run unasked",
            "if you trust it, name it: --detector FILE.py:NAME",
        )
    if given is not None and not from_file and given != recorded:
        raise UsageError(
            f"it was recorded with {recorded} and must be replayed with it", "omit --detector"
        )
    return given or recorded


class _Waiting(msgspec.Struct, frozen=True):
    """A command of a replayed step that the recording has not sent yet."""

    step_ns: int
    asked: Command
    admitted: Command


class _Stepper:
    """Collects the messages of a step and replays it when its control message comes."""

    def __init__(self, config: TrialConfig, home: Vector3 | None) -> None:
        self.steps = 0
        self.events: list[tuple[float, str]] = []
        self.differences: list[Difference] = []
        self._step = make_step(config, make_controller(config, home))
        self.writes = WriteCheck(calibration(config))
        self._foreign_gripper = bool(
            config.devices.gripper
        )  # another package's driver: other bytes
        self._delay_ns = round(config.loop.decision_delay_s * 1e9)
        self._frame: TactileFrame | None = None
        self._gripper: GripperState | None = None
        self._arm: ArmState | None = None
        self._latest_ns: dict[str, int] = {}  # time of the last message of each channel
        self._waiting: list[_Waiting] = []
        self._sent: list[tuple[int, CommandMessage]] = []  # not compared yet
        self._entered: list[PhaseChange] = []  # recorded since the last step
        self._changes: list[PhaseChange] = []  # made by the last replayed step

    def take(self, topic: str, t_ns: int, message: Any) -> None:
        """Take one message, in the order recorded."""
        self._latest_ns[topic] = t_ns
        if topic == TACTILE:
            self._frame = recorded_frame(t_ns, message)
        elif topic == GRIPPER:
            self._gripper = message
        elif topic == ARM:
            self._arm = recorded_arm(message)
        elif topic == COMMANDS:
            self._sent.append((t_ns, message))
        elif topic == PHASES:
            self._entered.append(message)
        elif topic == CONTROL:
            self._replay(t_ns, message)

    def end(self, complete: bool) -> None:
        """Finish; ``complete``: the recording was closed properly."""
        if complete:
            self._check_phases()
        if not self._step.controller.finished:
            ended_s = self._latest_ns[CONTROL] * 1e-9
            self.events.append((ended_s, "the recording ends before the run"))

    def _check_phases(self) -> None:
        """Compare the recorded changes of phase after a step with those of the replay."""
        for was, now in itertools.zip_longest(self._entered, self._changes):
            self.compare((now or was).t_ns, "change of phase", was, now)
        self._entered.clear()

    def _replay(self, t_ns: int, recorded: ControlMessage) -> None:
        if self._gripper is None or self._arm is None:
            return  # a recording that begins in the middle of a step
        self._check_phases()
        for topic in (GRIPPER, ARM):
            self.compare(t_ns, f"{topic} of this step", self._latest_ns[topic], t_ns)
        self._check_queue(t_ns, recorded)
        failed = recorded.gripper_lost or bool(recorded.errors)
        wrong = None if self._foreign_gripper else self.writes.take(self._gripper, failed)
        if wrong is not None:
            self.compare(t_ns, "bytes written to the gripper", *wrong)
        inputs = recorded_input(t_ns, self._frame, recorded, self._gripper, self._arm)
        known = len(self._step.controller.machine.log)
        result = self._step.decide(inputs)
        self._changes = self._step.controller.machine.log[known:]
        replayed = control_message(result.observation, result.decision)
        for name in msgspec.structs.asdict(recorded):
            before, now = getattr(recorded, name), getattr(replayed, name)
            if name != "probabilities" or not _near(before, now):
                self.compare(t_ns, name, before, now)
        decided = zip(result.decision.commands, result.admitted, strict=True)
        self._waiting += [_Waiting(t_ns, asked, admitted) for asked, admitted in decided]
        self._check_sent(math.inf)
        self._note(t_ns * 1e-9, recorded)
        self._frame = None  # a step without a frame has no message: rest counts are taken again
        self.steps += 1

    def _check_queue(self, t_ns: int, recorded: ControlMessage) -> None:
        """Check that every command that no longer waits was sent; a stopped run discards them."""
        self._check_sent(t_ns)
        if recorded.stop or recorded.errors:
            self._waiting = self._waiting if recorded.pending else []
        self.compare(t_ns, "a command waits", recorded.pending, bool(self._waiting))
        self._waiting = self._waiting if recorded.pending else []

    def _check_sent(self, until_ns: float) -> None:
        for sent_ns, message in self._sent:
            if sent_ns <= until_ns:
                self._check_command(sent_ns, message)
        self._sent = [each for each in self._sent if each[0] > until_ns]

    def _check_command(self, sent_ns: int, recorded: CommandMessage) -> None:
        """Check that a step decided this command, in this order, admitted it so, and that its delay
        had passed."""
        this = (recorded.decided_ns, recorded.requested)
        turn = next((i for i, w in enumerate(self._waiting) if (w.step_ns, w.asked) == this), None)
        if turn is None:
            self.compare(sent_ns, "command", describe(recorded.requested), "none")
            return
        for lost in self._waiting[:turn]:
            self.compare(sent_ns, "command", "none", describe(lost.asked))
        decided = self._waiting[turn]
        del self._waiting[: turn + 1]
        self.compare(sent_ns, "admitted command", recorded.admitted, decided.admitted)
        due_ns = decided.step_ns + self._delay_ns
        self.compare(sent_ns, "time of sending, at least", sent_ns, max(sent_ns, due_ns))
        if isinstance(decided.admitted, GripperCommand) and not recorded.refused:
            self.writes.send(decided.admitted)

    def compare(self, t_ns: int, what: str, recorded: Any, replayed: Any) -> None:
        """Record a difference, if there is one."""
        if recorded != replayed:
            self.differences.append(Difference(t_ns * 1e-9, what, str(recorded), str(replayed)))

    def _note(self, t_s: float, recorded: ControlMessage) -> None:
        if recorded.event:
            self.events.append((t_s, "slip registered"))
        self.events += [(t_s, f"phase {c.phase}: {c.cause}") for c in self._changes]
        self.events += [(t_s, f"  {describe(command)}") for command in recorded.commands]


def _near(before: list[float], now: list[float]) -> bool:
    return all(abs(a - b) <= _ROUNDING for a, b in zip(before, now, strict=True))
