"""Acquisition of labelled slip data (paper, section III-B): one session, recorded and labelled.

Like every run it writes a folder with the recording of measurements and commands, and a result. In
addition it writes the labelled samples for training (``detector.recordings``).
"""

import math
from contextlib import nullcontext
from enum import StrEnum
from itertools import chain
from pathlib import Path

import msgspec
import numpy as np

from detector.recordings import SUFFIX, Metadata, write
from drivers.errors import CouldNotRecord, GraspError, describe_exception
from drivers.interfaces import PERIOD_S
from grasp.run import signals
from grasp.run.messages import (
    ARM,
    TACTILE,
    TRUTH,
    ArmMessage,
    TactileMessage,
    Write,
    arm_message,
    tactile_message,
)
from grasp.run.realtime import real_time
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.labels import recording, split_at_gaps
from scenarios.acquire.press import PressCommand, PressPhase, StrokeMotion
from scenarios.acquire.session import OnTick, Sample, Session, open_acquire_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.trial.final_state import FinalState
from scenarios.trial.foxglove import (
    EVERY_TICKS,
    INFO,
    LOG,
    TAXELS,
    TRANSFORMS,
    FrameTransform,
    FrameTransforms,
    Grid,
    Log,
    Time,
    grid,
    point,
)
from scenarios.trial.result import REPORT, Bug, Failure, versions
from scenarios.trial.run_folder import RunFolder, check_runs, could_not_record, metadata
from scenarios.world.truth import PressedTruth


class AcquireOutcome(StrEnum):
    """Outcome of an acquisition."""

    COMPLETE = "complete"
    FAULT = "fault"
    INTERRUPTED = "interrupted"
    INTERNAL_ERROR = "internal_error"


class AcquireResult(msgspec.Struct, frozen=True, kw_only=True):
    """Result of an acquisition; with a ``failure`` it ended early."""

    scenario: str
    rig: str
    surface: str
    direction: str
    seed: int
    outcome: str
    samples: int
    slip: int
    slip_true: int | None
    missed_periods: int  # sample periods missed because the process was late
    repeated: int  # samples without a new frame
    real_time: bool | None  # whether real-time priority was granted; None in virtual time
    force_mean_n: float | None  # estimated by the fingertip
    force_std_n: float | None
    speed_max_mps: float | None
    recording: str | None  # of the whole session
    recordings: list[str]  # labelled, for training
    versions: dict[str, str]
    started: str | None = None  # UTC of this machine, ISO 8601; None: not recorded
    failure: Failure | None = None
    bug: Bug | None = None  # internal error that ended it

    def as_json(self) -> str:
        return msgspec.json.encode(self).decode()

    @property
    def _labelled(self) -> str:
        true = "" if self.slip_true is None else f" (true slip of the contact: {self.slip_true})"
        return f"rig {self.rig}: {self.samples} samples, {self.slip} labelled slip{true}"

    def as_text(self) -> str:
        session = "" if self.recording is None else f"\nsession: {self.recording}"
        if not self.recordings:
            return f"rig {self.rig}: no labelled sample was recorded{session}"
        cut = "" if len(self.recordings) == 1 else ", split where too many samples were missing"
        return (
            f"{self._labelled}, {self.repeated} repeated, {self.missed_periods} periods missed\n"
            f"estimated force {self.force_mean_n:.1f} +- {self.force_std_n:.1f} N, "
            f"maximum speed {(self.speed_max_mps or 0.0) * 1e3:.0f} mm/s\n"
            f"recording: {', '.join(self.recordings)}{cut}{session}"
        )


PRESS = "/press"


class PressMessage(msgspec.Struct, frozen=True):
    """Step of the press controller: estimated force, and command to the arm."""

    phase: str
    force_n: float  # estimated by the fingertip
    command: PressCommand


CHANNELS: dict[str, type[msgspec.Struct]] = {
    TACTILE: TactileMessage,
    ARM: ArmMessage,
    PRESS: PressMessage,
    TRUTH: PressedTruth,
}


VIEWER_CHANNELS: dict[str, type[msgspec.Struct]] = {
    LOG: Log, TRANSFORMS: FrameTransforms, TAXELS: Grid,
}  # fmt: skip


class ViewerMessages:
    """Phases, the fingertip's pose and the taxels as a grid, for viewers of recordings."""

    def __init__(self, config: AcquireConfig, unix_ns: int) -> None:
        """``unix_ns``: Unix time at which the session's clock was 0."""
        self._taxels_mm = config.fingertip.taxels_mm
        self._unix_ns = unix_ns
        self._samples = 0
        self._phase: PressPhase | None = None

    def write(self, write: Write, sample: Sample) -> None:
        """Write a log line at the start of a phase, and the other messages every tenth sample."""
        now = Time.of(self._unix_ns + sample.t_ns)
        if sample.phase is not self._phase:
            self._phase = sample.phase
            write(LOG, sample.t_ns, Log(now, INFO, sample.phase.value, "phase"))
        self._samples += 1
        if self._samples % EVERY_TICKS != 1 or not all(map(math.isfinite, sample.arm.position_m)):
            return
        hand = FrameTransform(now, "world", "hand", point(*sample.arm.position_m))
        write(TRANSFORMS, sample.t_ns, FrameTransforms([hand]))
        write(TAXELS, sample.t_ns, grid(now, sample.frame.counts, self._taxels_mm))


def write_sample(write: Write, sample: Sample) -> None:
    """Write all messages of one sample."""
    t_ns = sample.t_ns
    write(TACTILE, t_ns, tactile_message(sample.frame))
    write(ARM, t_ns, arm_message(sample.arm))
    write(PRESS, t_ns, PressMessage(sample.phase.value, sample.force_n, sample.command))
    if sample.truth is not None:
        write(TRUTH, t_ns, sample.truth)


SCENARIO = "acquire"
TURN_RADPS = 1.0  # paper, section III-B


def run(
    config: AcquireConfig, motion: StrokeMotion, seed: int, seconds: float, runs: Path, paced: bool,
    on_tick: OnTick, permit: MotionPermit | None = None,
) -> AcquireResult:  # fmt: skip
    """Run one session on the configured rig; writes `runs/<stamp>-acquire-<surface>/`.

    A device error, Ctrl-C or an internal error ends the session early, becomes the ``failure``, and
    the recorded data is kept. Labelled samples are split where too many are missing in a row.

    Raises ConfigError, CouldNotRecord and the drivers' errors before the arm moves.
    """
    check_runs(runs)
    with signals.deferred(), open_acquire_rig(config, seed, paced, permit) as rig:
        course = msgspec.json.encode(motion).decode()
        run_metadata = {**metadata(config, seed, rig.clock), "motion": course}
        name = f"{SCENARIO}-{config.surface.name}"
        viewer = ViewerMessages(config, rig.clock.unix_ns)
        with RunFolder(runs, name, {**CHANNELS, **VIEWER_CHANNELS}, run_metadata) as folder:

            def take(sample: Sample) -> None:
                write_sample(folder.write, sample)
                viewer.write(folder.write, sample)
                on_tick(sample)

            session = Session(config, motion, seed, rig, take)
            samples = round(seconds / PERIOD_S)
            with real_time(config.realtime) if rig.wall_time else nullcontext() as granted:
                ending = _run_to_end(session, samples)
            return _finish(config, motion, seed, session, folder, ending, granted)


Ending = tuple[AcquireOutcome, Failure | None, Bug | None]


def _run_to_end(session: Session, samples: int) -> Ending:
    """Run the session and stop the arm; returns how it ended."""
    try:
        session.run(samples)
    except GraspError as error:
        failure = Failure(error.kind, error.message, error.remedy, _stopped(session))
        return AcquireOutcome.FAULT, failure, None
    except KeyboardInterrupt as stop:
        cause = f"{signals.cause(stop)} in phase {session.phase}"
        failure = Failure("interrupted", cause, "", _stopped(session))
        return AcquireOutcome.INTERRUPTED, failure, None
    except BaseException as error:
        bug = Bug.of(error)
        failure = Failure("internal", bug.fault.line, REPORT, _stopped(session))
        return AcquireOutcome.INTERNAL_ERROR, failure, bug
    return AcquireOutcome.COMPLETE, None, None


def _stopped(session: Session) -> FinalState:
    """Stop the arm; returns the final state."""
    try:
        arm = session.stop_arm()
    except Exception as error:  # perhaps the error that ended the session
        arm = f"the arm may still move: the stop command failed: {describe_exception(error)}"
    return FinalState(arm, "no command was sent to the hand", "")


def _finish(
    config: AcquireConfig, motion: StrokeMotion, seed: int, session: Session, folder: RunFolder,
    ending: Ending, granted: bool | None,
) -> AcquireResult:  # fmt: skip
    """Label the samples and write all files; if one recording fails, the other is kept."""
    parts = split_at_gaps(session.ticks)
    known = Metadata(
        set="slide", split="train", surface=config.surface.name, motion=motion.kind,
        speed_mps=motion.speed_mps, spin_radps=motion.spin_radps, direction=motion.direction,
        seed=seed, commit=versions()["commit"],
    )  # fmt: skip
    numbers = [""] if len(parts) == 1 else [f"-{k + 1}" for k in range(len(parts))]
    made = [
        recording(part, config, known, str(folder.path / f"samples{n}{SUFFIX}"))
        for part, n in zip(parts, numbers, strict=True)
    ]
    kept, lost = [], None
    try:
        for each in made:
            write(each.source, each)
            kept.append(each.source)
    except OSError as error:
        lost = could_not_record(folder.path, error)
    samples = list(chain(*parts))
    force = np.array([sample.force_n for sample in samples])
    fastest = [np.hypot(*r.velocity_mps.T).max() for r in made if r.velocity_mps is not None]
    true = [int(r.slip_true.sum()) for r in made if r.slip_true is not None]
    outcome, failure, bug = ending
    result = AcquireResult(
        scenario=SCENARIO, rig=config.rig, surface=config.surface.name, direction=motion.direction,
        seed=seed, outcome=outcome, samples=len(samples), slip=sum(int(r.slip.sum()) for r in made),
        slip_true=sum(true) if true else None, missed_periods=session.missed_periods,
        repeated=sum(sample.frame.missed > 0 for sample in samples), real_time=granted,
        force_mean_n=float(force.mean()) if samples else None,
        force_std_n=float(force.std()) if samples else None,
        speed_max_mps=float(max(fastest)) if fastest else None, recording=str(folder.recording),
        recordings=kept, versions=versions(), failure=failure or _failure(lost), bug=bug,
    )  # fmt: skip
    try:
        result = folder.finish(result)
    except CouldNotRecord as error:
        failure = result.failure or _failure(error)
        result = msgspec.structs.replace(result, failure=failure, recording=None)
    return result


def _failure(error: CouldNotRecord | None) -> Failure | None:
    return None if error is None else Failure(error.kind, error.message, error.remedy)
