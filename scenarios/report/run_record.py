"""A recorded trial as arrays, one row per control step, with the verdict stored beside it."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.interface import Motion
from drivers.errors import BadFile, ConfigError, GraspError
from drivers.interfaces import FINGERS, KIT_TAXELS, GripperState
from grasp.control.states import PhaseChange
from grasp.run.messages import (
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
from grasp.run.recording import RunRecording
from grasp.settings import Layer, load
from scenarios.campaign.store import CampaignStore
from scenarios.lift.scoring import LiftResult
from scenarios.report.run_settings import scenario_of
from scenarios.tap.scoring import TapResult
from scenarios.trial.config import TrialConfig
from scenarios.trial.run_folder import POLICY, RESULT, open_trial
from scenarios.world.truth import Truth

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Verdict = LiftResult | TapResult
GRIPPER_COMMANDS = ("MoveFingers", "CloseToLimit", "OpenFingers", "HoldFingers")


class Sent(msgspec.Struct, frozen=True):
    """A sent command. ``confirmed_ns``: time of the first status that follows it, if any."""

    sent_ns: int
    confirmed_ns: int | None
    message: CommandMessage


class TrueWorld(msgspec.Struct, frozen=True):
    """The simulated truth, (n,) or (n, fingers); NaN where a row is missing."""

    normal_n: Floats
    shear_n: Floats
    height_m: Floats
    slip_m: Floats
    slip_mps: Floats
    across_m: Floats
    turn_rad: Floats
    onset_s: float | None
    impact_s: float | None


class ReportedMotion(msgspec.Struct, frozen=True):
    """The detector's auxiliary outputs, (n, fingers); NaN where it did not run."""

    speed_mps: Floats
    direction_deg: Floats
    turning: Floats  # probability


class RunRecord(msgspec.Struct, frozen=True):
    """A recorded trial. Arrays are (n,) or (n, fingers), ``counts`` (n, fingers, taxels) with NaN
    before rest counts were taken; ``truth`` and ``motion`` are None where not recorded."""

    path: Path
    complete: bool
    config: TrialConfig
    settings: dict[str, Any]  # all settings of the recording, also those of the experiment
    metadata: dict[str, str]
    verdict: Verdict | None
    verdict_problem: str
    t_s: Floats
    probabilities: Floats
    estimated_n: Floats
    counts: Floats
    fingers_counts: Floats
    arm_m: Floats
    armed: Flags
    masked: Flags
    registered: Flags
    truth: TrueWorld | None
    motion: ReportedMotion | None
    phases: list[PhaseChange]
    commands: list[Sent]

    @property
    def scenario(self) -> str:
        return scenario_of(self.settings)

    def known(self, values: Floats) -> Floats:
        """Values (n, 3) of the fingers, with NaN before rest counts were taken."""
        return np.where(np.isnan(self.counts[:, :, 0]), math.nan, values)

    @property
    def seed(self) -> str:
        return self.metadata.get("seed", "0")


def read_run(path: Path) -> RunRecord:
    """Read a run folder or its recording. Raises BadFile for other files and for a recording
    without a control step. The record states whether its end or its result are missing."""
    recording = open_trial(path)
    config, settings = _settings(recording)
    steps: list[tuple[int, ControlMessage]] = list(recording.of(CONTROL))
    times = [t_ns for t_ns, _ in steps]
    states: list[GripperState] = [state for _, state in recording.of(GRIPPER)]
    verdict, problem = _verdict(recording.path, TapResult if "tap" in settings else LiftResult)
    if POLICY in recording.metadata:
        problem = "An episode of a policy has no verdict."

    def flags(name: str) -> Flags:
        return np.array([getattr(message, name) for _, message in steps])

    def arm_row(arm: ArmMessage) -> Sequence[float]:
        return [math.nan if value is None else value for value in arm.position_m]

    return RunRecord(
        path=recording.path,
        complete=recording.complete,
        config=config,
        settings=settings,
        metadata=recording.metadata,
        verdict=verdict,
        verdict_problem=problem,
        t_s=np.array(times) * 1e-9,
        probabilities=_rows(recording, CONTROL, times, lambda m: m.probabilities, FINGERS),
        estimated_n=np.array([m.estimated_n for _, m in steps]),
        counts=_counts(recording, times),
        fingers_counts=_rows(recording, GRIPPER, times, lambda state: state.positions, FINGERS),
        arm_m=_rows(recording, ARM, times, arm_row, 3),
        armed=flags("armed"),
        masked=flags("masked"),
        registered=flags("registered"),
        truth=_truth(recording, times),
        motion=_motion(recording, times),
        phases=[change for _, change in recording.of(PHASES)],
        commands=_commands(list(recording.of(COMMANDS)), states),
    )


def _settings(recording: RunRecording) -> tuple[TrialConfig, dict[str, Any]]:
    try:
        table = msgspec.json.decode(recording.metadata["config"], type=dict[str, Any])
        known = {k: v for k, v in table.items() if k in TrialConfig.__struct_fields__}
        return load(TrialConfig, [Layer("config", known)]), table
    except (KeyError, msgspec.MsgspecError, RecursionError, ConfigError) as error:
        remedy = (
            f"make the page with grasp {recording.metadata.get('version.grasp', 'of its time')}"
        )
        problem = f"its settings do not fit this version: {error}"
        raise BadFile(recording.path, problem, remedy) from error


def _verdict(recording: Path, kind: type[Verdict]) -> tuple[Verdict | None, str]:
    """The result beside a recording or in its campaign's file, or the reason why there is none."""
    campaign = recording.parent.with_suffix(".sqlite")
    in_campaign = recording.parent.suffix == ".recordings" and campaign.is_file()
    place = campaign if in_campaign else recording.with_name(RESULT)
    try:
        content = _campaign_result(campaign, recording) if in_campaign else place.read_bytes()
        return msgspec.json.decode(content, type=kind), ""
    except FileNotFoundError:
        return None, (
            f"There is no {RESULT} beside the recording: the run did not end, or it belongs to a "
            "campaign, whose file contains the verdict."
        )
    except (OSError, GraspError, msgspec.MsgspecError, ValueError, RecursionError) as error:
        return None, f"The {place.name} beside the recording cannot be read: {error}."


def _campaign_result(campaign: Path, recording: Path) -> str:
    """The result in a campaign's row as JSON; empty where there is none."""
    with CampaignStore.open(campaign) as store:
        name = f"{recording.parent.name}/{recording.name}"
        return next((row.result or "" for row in store.rows() if row.recording == name), "")


def _rows(
    recording: RunRecording, topic: str, times: Sequence[int],
    row: Callable[[Any], Sequence[float]], width: int,
) -> Floats:  # fmt: skip
    """Rows (n, width) of a channel's messages at the steps' ``times``; NaN where there is none.
    Raises BadFile for a message with another number of values."""
    found = {t_ns: row(message) for t_ns, message in recording.of(topic)}
    if other := {len(values) for values in found.values()} - {width}:
        problem = f"a message on {topic} has {other.pop()} values, not {width}"
        raise BadFile(recording.path, problem, "record again, or restore the file from a copy")
    empty = [math.nan] * width
    return np.array([found.get(t_ns, empty) for t_ns in times], np.float64)


def _counts(recording: RunRecording, times: Sequence[int]) -> Floats:
    first: TactileMessage | None = next((m for _, m in recording.of(TACTILE)), None)
    taxels = KIT_TAXELS if first is None else len(first.counts) // FINGERS
    width = FINGERS * max(1, taxels)
    rows = _rows(recording, TACTILE, times, lambda message: message.counts, width)
    return rows.reshape(len(times), FINGERS, -1)


def _motion(recording: RunRecording, times: Sequence[int]) -> ReportedMotion | None:
    if next(recording.of(MOTION), None) is None:
        return None

    def row(reported: Motion) -> Sequence[float]:
        return [*reported.speed_mps, *reported.direction_deg, *reported.turning]

    return ReportedMotion(*np.split(_rows(recording, MOTION, times, row, 3 * FINGERS), 3, axis=1))


def _truth(recording: RunRecording, times: Sequence[int]) -> TrueWorld | None:
    every: list[Truth] = [message for _, message in recording.of(TRUTH)]
    if not every:
        return None

    def row(t: Truth) -> Sequence[float]:
        moved = (t.height_m, t.slip_distance_m, t.slip_speed_mps, t.across_m, t.turn_rad)
        return [*t.normal_n, *t.shear_n, *moved]

    rows = _rows(recording, TRUTH, times, row, 2 * FINGERS + 5)
    normal, shear, rest = np.split(rows, [FINGERS, 2 * FINGERS], axis=1)
    height, slip, speed, across, turn = rest.T
    return TrueWorld(
        normal, shear, height, slip, speed, across, turn, every[-1].slip_onset_s, every[-1].impact_s
    )


def _commands(
    messages: Sequence[tuple[int, CommandMessage]], states: Sequence[GripperState]
) -> list[Sent]:
    to_hand = [t_ns for t_ns, m in messages if type(m.admitted).__name__ in GRIPPER_COMMANDS]

    def confirmed_ns(sent_ns: int) -> int | None:
        """Time of the first status that follows the command, before the next command."""
        until_ns = next((t_ns for t_ns in to_hand if t_ns > sent_ns), None)
        first = next((s.t_ns for s in states if s.t_ns > sent_ns and s.fresh), None)
        late = first is not None and until_ns is not None and first >= until_ns
        return None if late else first

    return [
        Sent(sent_ns, None if m.applied is None else confirmed_ns(sent_ns), m)
        for sent_ns, m in messages
    ]
