"""Acquisition of labelled slip data (paper, section III-B): one session, recorded and labelled.

Like every run it leaves a folder with the recording of all that was read and told, and a result.
Beside them lie the labelled samples as training reads them (``detector.recordings``).
"""

from contextlib import nullcontext
from itertools import chain
from pathlib import Path

import msgspec

from detector.recordings import SUFFIX, Metadata, Recording, write
from drivers.errors import CouldNotRecord, GraspError
from grasp import interruption
from grasp.realtime import real_time
from scenarios.acquire import pictures
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.labels import parts_of, recording
from scenarios.acquire.messages import CHANNELS, write_sample
from scenarios.acquire.pictures import PressPictures
from scenarios.acquire.press import StrokeMotion
from scenarios.acquire.result import AcquireOutcome, AcquireResult, figures
from scenarios.acquire.rig import open_acquire_rig
from scenarios.acquire.session import OnTick, Sample, Session
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import PressRig
from scenarios.trial.ending import End
from scenarios.trial.execution import REPORT
from scenarios.trial.result import Bug, Failure, versions
from scenarios.trial.run_folder import RunFolder, check_runs, could_not_record, dated, metadata

SCENARIO = "acquire"
SAMPLES = "samples"  # the labelled ones, beside the recording
TURN_RADPS = 1.0  # paper, section III-B


def run(
    config: AcquireConfig, motion: StrokeMotion, seed: int, seconds: float, runs: Path, paced: bool,
    on_tick: OnTick, permit: MotionPermit | None = None,
) -> AcquireResult:  # fmt: skip
    """One session on the rig of the configuration; leaves `runs/<stamp>-acquire-<surface>/`.

    What was recorded is kept, whatever ends the session: a device's error, Ctrl-C or a bug of ours
    becomes the ``failure``. Labelled samples may not lack many in a row, so they are cut in two
    there.

    Raises ConfigError, CouldNotRecord and the drivers' errors before anything moves.
    """
    check_runs(runs)
    with interruption.held(), open_acquire_rig(config, seed, paced, permit) as rig:
        dates = dated(rig.clock.virtual, rig.clock.unix_ns)
        known = {**metadata(config, seed), **dates, "motion": msgspec.json.encode(motion).decode()}
        name = f"{SCENARIO}-{config.surface.name}"
        drawn = PressPictures(config, rig.clock.unix_ns)
        with RunFolder(runs, name, {**CHANNELS, **pictures.CHANNELS}, known) as folder:

            def take(sample: Sample) -> None:
                write_sample(folder.write, sample)
                drawn.write(folder.write, sample)
                on_tick(sample)

            session = Session(config, motion, seed, rig, take)
            samples = round(seconds / config.sampling.period_s)
            ended, granted = _run_to_end(config, rig, session, samples)
            interruption.seal()  # what is left is labelling and writing
            return _finish(config, motion, seed, session, folder, ended, granted)


class _Ended(msgspec.Struct, frozen=True):
    """How a session ended: by itself where nothing failed."""

    failure: Failure | None = None
    bug: Bug | None = None

    @property
    def outcome(self) -> AcquireOutcome:
        if self.bug is not None:
            return AcquireOutcome.INTERNAL_ERROR
        if self.failure is None:
            return AcquireOutcome.COMPLETE
        interrupted = self.failure.kind == "interrupted"
        return AcquireOutcome.INTERRUPTED if interrupted else AcquireOutcome.FAULT


def _run_to_end(
    config: AcquireConfig, rig: PressRig, session: Session, samples: int
) -> tuple[_Ended, bool | None]:
    """How it ended, with the arm at rest; and whether a real-time priority was granted (None in
    virtual time)."""
    with real_time(config.realtime) if rig.on_wall else nullcontext() as granted:
        try:
            session.run(samples)
        except GraspError as error:
            failure = Failure(error.kind, error.message, error.remedy, _left(session))
            return _Ended(failure), granted
        except KeyboardInterrupt as stop:
            cause = f"{interruption.cause(stop)} in phase {session.phase}"
            return _Ended(Failure("interrupted", cause, "", _left(session))), granted
        except BaseException as error:
            bug = Bug.of(error)
            return _Ended(Failure("internal", bug.line, REPORT, _left(session)), bug), granted
    return _Ended(), granted


def _left(session: Session) -> End:
    try:
        arm = session.stand()
    except BaseException:  # what ended the session, perhaps
        arm = "the arm may still move: it cannot be told to stand"
    return End(arm, "the hand was told nothing", "")


def _finish(
    config: AcquireConfig, motion: StrokeMotion, seed: int, session: Session, folder: RunFolder,
    ended: _Ended, granted: bool | None,
) -> AcquireResult:  # fmt: skip
    parts = parts_of(session.ticks)
    told = Metadata(
        set="slide", split="train", surface=config.surface.name, motion=motion.kind,
        speed_mps=motion.speed_mps, spin_radps=motion.spin_radps, direction=motion.direction,
        seed=seed, commit=versions()["commit"],
    )  # fmt: skip
    paths = [folder.path / f"{name}{SUFFIX}" for name in _names(len(parts))]
    made = [
        recording(part, config, told, str(path)) for part, path in zip(parts, paths, strict=True)
    ]
    result = AcquireResult(
        **figures(list(chain(*parts)), made),
        scenario=SCENARIO,
        rig=config.rig,
        surface=config.surface.name,
        direction=motion.direction,
        seed=seed,
        outcome=ended.outcome,
        missed_periods=session.missed_periods,
        real_time=granted,
        recording=str(folder.recording),
        versions=versions(),
        failure=ended.failure,
        bug=ended.bug,
    )
    return _written(folder, made, result)


def _names(count: int) -> list[str]:
    return [SAMPLES] if count == 1 else [f"{SAMPLES}-{k}" for k in range(1, count + 1)]


def _written(folder: RunFolder, made: list[Recording], result: AcquireResult) -> AcquireResult:
    """What of it the disk took: one of the two recordings is kept where the other cannot be."""
    kept: list[str] = []
    try:
        for each in made:
            write(each.source, each)
            kept.append(each.source)
    except OSError as error:
        result = _without(result, could_not_record(folder.path, error), recordings=kept)
    try:
        folder.finish(result)
    except CouldNotRecord as error:
        result = _without(result, error, recording=None)
    return result


def _without(
    result: AcquireResult, error: CouldNotRecord, **lost: list[str] | None
) -> AcquireResult:
    failure = result.failure or Failure(error.kind, error.message, error.remedy)
    return msgspec.structs.replace(result, failure=failure, **lost)
