"""A recorded trial as arrays, one row a control step, and the verdict that lies beside it."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.auxiliary_outputs import Motion
from detector.decision import RuleSettings
from drivers.errors import BadFile, ConfigError, GraspError
from drivers.interfaces import FINGERS, KIT_TAXELS, Applied, GripperState
from grasp.commands import Command
from grasp.guard import CapMode
from grasp.messages import (
    ARM,
    COMMANDS,
    CONTROL,
    GRIPPER,
    MOTION,
    PHASES,
    TACTILE,
    TRUTH,
    ArmMessage,
    CommandMessage,
    ControlMessage,
    TactileMessage,
)
from grasp.recording import RunRecording
from grasp.settings import Layer, checked
from grasp.states import PhaseChange
from scenarios.campaign.store import CampaignStore
from scenarios.report.run_settings import scenario_of
from scenarios.trial.run_folder import RESULT, open_trial
from scenarios.world.truth import Truth

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
ON_SAME_GRID_NS = 1_000  # two times that are one
GRIPPER_COMMANDS = ("MoveFingers", "CloseFast", "OpenFingers", "HoldFingers")


class BodyTold(msgspec.Struct, frozen=True):
    """Of the object's settings what a picture needs."""

    name: str
    shape: str = "straight"
    half_width_m: float = 0.04
    half_height_m: float = 0.1
    grip_height_m: float = 0.0
    body_above_grip_m: float = 0.15


class _Contact(msgspec.Struct, frozen=True):
    half_aperture_m: float
    pad_half_length_m: float


class _Fingertip(msgspec.Struct, frozen=True):
    taxels_mm: list[tuple[float, float]] = []


class _Guard(msgspec.Struct, frozen=True):
    force_limit_n: float
    overshoot_n: float = 0.0
    cap_mode: CapMode = "every_finger"


class _Calibration(msgspec.Struct, frozen=True):
    m_per_count: float


class Told(msgspec.Struct, frozen=True):
    """Of the recorded settings what a page needs; all of them are ``RunRecord.settings``."""

    rig: str
    profile: str
    detector_name: str
    object: BodyTold
    contact: _Contact
    guard: _Guard
    rule: RuleSettings
    calibration: _Calibration
    controller: dict[str, Any] = {}
    tap: dict[str, Any] | None = None
    fingertip: _Fingertip = _Fingertip()


class Ended(msgspec.Struct, frozen=True):
    """How a safe state was left, in words."""

    arm: str = ""
    hand: str = ""
    unreached: list[str] = []


class Raised(msgspec.Struct, frozen=True):
    """An exception of our own code."""

    name: str = ""
    text: str = ""


class Spread(msgspec.Struct, frozen=True):
    """Of many times; None: never came."""

    p50: float | None = None
    p99: float | None = None


class Timing(msgspec.Struct, frozen=True):
    """How the machine kept up: ``scenarios.trial.result.TimingResult``."""

    frame_to_decision_us: Spread | None = None
    decision_to_ack_us: Spread | None = None
    frame_age_ms: Spread | None = None
    missed_periods: int = 0
    repeated_frames: int = 0
    cell_stalls: int = 0


class Verdict(msgspec.Struct, frozen=True):
    """`result.json` of a lift or a tap, of this version or an older one: what a page tells of it,
    None where it does not say."""

    outcome: str
    success: bool | None = None
    slip_onset_s: float | None = None
    slip_registered_s: float | None = None
    detection_latency_ms: float | None = None
    slip_distance_m: float | None = None
    turned_rad: float | None = None
    paused_s: float | None = None
    moved: bool | None = None
    displacement_m: float | None = None
    direction: str | None = None
    struck_s: float | None = None
    nominal_again_ms: float | None = None
    peak_force_n: dict[str, float] | None = None
    peak_measured_n: dict[str, float] | None = None
    timing: Timing = Timing()
    versions: dict[str, str] = {}
    config_hash: str = ""
    detector_hash: str = ""
    end: Ended | None = None
    bug: Raised | None = None


class Sent(msgspec.Struct, frozen=True):
    """One command. ``confirmed_ns``: when the first status came that spoke of it, None if none did
    or nothing would (the arm's)."""

    decided_ns: int
    sent_ns: int
    confirmed_ns: int | None
    asked: Command
    admitted: Command
    applied: Applied | None
    refused: str


class TrueWorld(msgspec.Struct, frozen=True):
    """What only a simulation knows; (n,) or (n, fingers), NaN where a row of it is missing."""

    normal_n: Floats
    shear_n: Floats
    height_m: Floats
    slip_m: Floats
    slip_mps: Floats
    across_m: Floats
    turn_rad: Floats
    onset_s: float | None
    struck_s: float | None


class ToldMotion(msgspec.Struct, frozen=True):
    """What heads told of each fingertip, (n, fingers); NaN where they were not asked."""

    speed_mps: Floats
    direction_deg: Floats
    turning: Floats  # probability


class RunRecord(msgspec.Struct, frozen=True):
    """One trial. Arrays are (n,) or (n, fingers), ``counts`` (n, fingers, taxels) with NaN before
    rest counts were taken; ``truth`` is None where nobody knows it, ``motion`` where no head tells
    it."""

    path: Path
    complete: bool
    told: Told
    settings: dict[str, Any]
    metadata: dict[str, str]
    verdict: Verdict | None
    verdict_problem: str
    t_s: Floats
    probabilities: Floats
    felt_n: Floats
    counts: Floats
    fingers_counts: Floats
    arm_m: Floats
    armed: Flags
    masked: Flags
    registered: Flags
    truth: TrueWorld | None
    motion: ToldMotion | None
    phases: list[PhaseChange]
    commands: list[Sent]

    @property
    def scenario(self) -> str:
        """Of which experiment it is."""
        return scenario_of(self.settings)

    def heard(self, values: Floats) -> Floats:
        """Of each finger (n, 3), NaN until its fingertip was heard: before rest counts are taken
        nobody knows what it feels."""
        return np.where(np.isnan(self.counts[:, :, 0]), math.nan, values)

    @property
    def seed(self) -> str:
        return self.metadata.get("seed", "0")


def read_run(path: Path) -> RunRecord:
    """A run folder or its recording; raises BadFile where it is none or was cut off before the
    first step. What is missing at its end, or of its result, is said in the record."""
    recording = open_trial(path)
    told, settings = _settings(recording)
    steps: list[tuple[int, ControlMessage]] = list(recording.of(CONTROL))
    times = [t_ns for t_ns, _ in steps]
    states: list[GripperState] = [state for _, state in recording.of(GRIPPER)]
    verdict, problem = _verdict(recording.path)

    def flags(of: Callable[[ControlMessage], bool]) -> Flags:
        return np.array([of(message) for _, message in steps])

    def arm_row(arm: ArmMessage) -> Sequence[float]:
        return [math.nan if value is None else value for value in arm.position_m]

    return RunRecord(
        path=recording.path,
        complete=recording.complete,
        told=told,
        settings=settings,
        metadata=recording.metadata,
        verdict=verdict,
        verdict_problem=problem,
        t_s=np.array(times) * 1e-9,
        probabilities=np.array([m.probabilities for _, m in steps], np.float64),
        felt_n=np.array([m.measured_n for _, m in steps]),
        counts=_counts(recording, times),
        fingers_counts=_rows(recording, GRIPPER, times, lambda state: state.positions, FINGERS),
        arm_m=_rows(recording, ARM, times, arm_row, 3),
        armed=flags(lambda m: m.armed),
        masked=flags(lambda m: m.masked),
        registered=flags(lambda m: m.registered),
        truth=_truth(recording, times),
        motion=_motion(recording, times),
        phases=[change for _, change in recording.of(PHASES)],
        commands=_commands(list(recording.of(COMMANDS)), states),
    )


def _settings(recording: RunRecording) -> tuple[Told, dict[str, Any]]:
    text = recording.metadata.get("config", "")
    try:
        told, settings = msgspec.json.decode(text, type=Told), msgspec.json.decode(text)
        return told, checked(Layer("config", settings)).table
    except (msgspec.MsgspecError, RecursionError, ConfigError) as error:
        raise BadFile(
            recording.path,
            f"its settings do not fit this version: {error}",
            f"make the page with grasp {recording.metadata.get('version.grasp', 'of its time')}",
        ) from error


def _verdict(recording: Path) -> tuple[Verdict | None, str]:
    """The result beside a recording, or in its campaign's file, or why there is none."""
    campaign = recording.parent.with_suffix(".sqlite")
    kept = recording.parent.suffix == ".recordings" and campaign.is_file()
    place = campaign if kept else recording.with_name(RESULT)
    try:
        content = _of_a_row(campaign, recording) if kept else place.read_bytes()
        return msgspec.json.decode(content, type=Verdict), ""
    except FileNotFoundError:
        return None, (
            f"There is no {RESULT} beside the recording: the run did not come to its end, or it is "
            "one of a campaign, whose file has its verdict."
        )
    except (OSError, GraspError, msgspec.MsgspecError, ValueError, RecursionError) as error:
        return None, f"The {place.name} beside the recording cannot be read: {error}."


def _of_a_row(campaign: Path, recording: Path) -> str:
    """The result of the row that kept a recording; empty where it has none."""
    with CampaignStore.open(campaign) as store:
        name = f"{recording.parent.name}/{recording.name}"
        return next((row.result or "" for row in store.rows() if row.recording == name), "")


def _rows(
    recording: RunRecording, topic: str, times: Sequence[int],
    row: Callable[[Any], Sequence[float]], width: int,
) -> Floats:  # fmt: skip
    """(n, width) of the messages that belong to the steps at ``times``; NaN where there is none."""
    found = {t_ns: row(message) for t_ns, message in recording.of(topic)}
    missing = [math.nan] * width
    return np.array([found.get(t_ns, missing) for t_ns in times], np.float64)


def _counts(recording: RunRecording, times: Sequence[int]) -> Floats:
    first: TactileMessage | None = next((m for _, m in recording.of(TACTILE)), None)
    width = FINGERS * KIT_TAXELS if first is None else len(first.counts)
    rows = _rows(recording, TACTILE, times, lambda message: message.counts, width)
    return rows.reshape(len(times), FINGERS, -1)


def _motion(recording: RunRecording, times: Sequence[int]) -> ToldMotion | None:
    if next(recording.of(MOTION), None) is None:
        return None

    def row(told: Motion) -> Sequence[float]:
        return [*told.speed_mps, *told.direction_deg, *told.turning]

    return ToldMotion(*np.split(_rows(recording, MOTION, times, row, 3 * FINGERS), 3, axis=1))


def _truth(recording: RunRecording, times: Sequence[int]) -> TrueWorld | None:
    last: Truth | None = None
    for _, message in recording.of(TRUTH):
        last = message
    if last is None:
        return None

    def row(t: Truth) -> Sequence[float]:
        moved = (t.height_m, t.slip_distance_m, t.slip_speed_mps, t.across_m, t.turn_rad)
        return [*t.normal_n, *t.shear_n, *moved]

    rows = _rows(recording, TRUTH, times, row, 2 * FINGERS + 5)
    normal, shear, rest = np.split(rows, [FINGERS, 2 * FINGERS], axis=1)
    height, slip, speed, across, turn = rest.T
    return TrueWorld(
        normal, shear, height, slip, speed, across, turn, last.slip_onset_s, last.struck_s
    )


def _commands(
    messages: Sequence[tuple[int, CommandMessage]], states: Sequence[GripperState]
) -> list[Sent]:
    found = []
    to_hand = [t_ns for t_ns, m in messages if _for_hand(m.admitted)]
    for sent_ns, message in messages:
        confirmed_ns = None
        if message.applied is not None:
            until_ns = next((t_ns for t_ns in to_hand if t_ns > sent_ns), None)
            confirmed_ns = _confirmed_ns(states, sent_ns, until_ns)
        found.append(
            Sent(
                message.decided_ns,
                sent_ns,
                confirmed_ns,
                message.asked,
                message.admitted,
                message.applied,
                message.refused,
            )
        )
    return found


def _for_hand(command: Command) -> bool:
    return type(command).__name__ in GRIPPER_COMMANDS


def _confirmed_ns(states: Sequence[GripperState], sent_ns: int, until_ns: int | None) -> int | None:
    """When the first status came that is known to speak of what was sent, before the next was."""
    for state in states:
        if state.t_ns > sent_ns and state.fresh:
            return None if until_ns is not None and state.t_ns >= until_ns else state.t_ns
    return None
