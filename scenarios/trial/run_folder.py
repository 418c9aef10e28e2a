"""Folder of a run: `recording.mcap` and `result.json`, both complete or neither."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Self, TypeVar

import msgspec

from drivers.errors import BadFile, CouldNotRecord, UsageError
from drivers.interfaces import Vector3
from grasp.control.controller import GraspController
from grasp.control.fault import INTERNAL
from grasp.files import PATH_ERRORS, PROBE_BYTES, make_private_folder, write_whole
from grasp.run.clock import Clock
from grasp.run.loop import Tick
from grasp.run.messages import CHANNELS, CONTROL, PHASES, TRUTH, write_tick
from grasp.run.recording import UNIX_NS, Channels, RunRecorder, RunRecording
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import FinishedTrial, Watch
from scenarios.trial.foxglove import CHANNELS as VIEWER_CHANNELS
from scenarios.trial.foxglove import ViewerMessages
from scenarios.trial.result import REPORT, Bug, Failure, JudgedTrial, ResultT, versions
from scenarios.world.truth import Truth

WrittenT = TypeVar("WrittenT", bound=msgspec.Struct)  # with `started`
RUNS = Path("runs")  # default folder of recordings
RECORDING = "recording.mcap"
RESULT = "result.json"
POLICY = "policy"  # metadata of an episode of somebody else's policy, which has no result
RUN_CHANNELS: dict[str, type[msgspec.Struct]] = {**CHANNELS, TRUTH: Truth}
WRITTEN: dict[str, type[msgspec.Struct]] = {**RUN_CHANNELS, **VIEWER_CHANNELS}


def find_recording(path: Path) -> Path:
    """The recording of a run folder, which may be named as in `grasp runs`, or the file itself."""
    if not path.exists() and (RUNS / path).is_dir():
        path = RUNS / path
    return path / RECORDING if path.is_dir() else path


class _Start(msgspec.Struct):
    """When a run started, and where its arm did."""

    started: str | None = None
    arm: str | None = None
    home_m: Vector3 | None = None


def last_start(arm: str, run: Path | None) -> tuple[Path, Vector3]:
    """A run's folder, or the last one, and the position where the arm at this address began it, m.
    Raises UsageError where that is unknown, or the run was of another arm."""
    found = [RUNS / run if not (run / RESULT).exists() else run] if run else newest(RESULT)
    problem = f"{run or RUNS}: no result of a run"
    with suppress(OSError, msgspec.MsgspecError):
        for folder in found[:1]:
            start = msgspec.json.decode((folder / RESULT).read_bytes(), type=_Start)
            problem = f"the run {folder} ended before the arm's start was known"
            if start.arm == arm and start.home_m is not None:
                return folder, start.home_m
            if start.arm != arm:
                problem = f"the run {folder} was of {start.arm or 'no real arm'}, not of {arm}"
    remedy = "name a RUN of this arm, or move the arm with the teach pendant"
    raise UsageError(problem, remedy)


def newest(name: str) -> list[Path]:
    """Folders of the default folder that hold a file of that name, the last run first: by the time
    in its result, which no copy and no time zone changes."""
    return sorted((path.parent for path in RUNS.glob(f"*/{name}")), key=run_order, reverse=True)


def run_order(folder: Path) -> tuple[str, str]:
    """Sorting key of a run: when it started, which results of old versions lack, and its name."""
    with suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        known = msgspec.json.decode((folder / RESULT).read_bytes(), type=_Start)
        return known.started or "", folder.name
    return "", folder.name


def open_trial(path: Path) -> RunRecording:
    """Open the recording of a trial, given its folder or file; raises BadFile for other files."""
    recording = RunRecording(find_recording(path), RUN_CHANNELS)
    if next(recording.of(CONTROL), None) is None:
        raise BadFile(
            recording.path,
            "holds no control step: an acquisition, or cut off before the first step",
            "give the folder of a lift or a tap, as `grasp runs` lists them",
        )
    return recording


class RunFolder:
    """Records one run. ``write`` never raises; ``finish`` raises what went wrong."""

    def __init__(self, runs: Path, name: str, channels: Channels, known: Mapping[str, str]) -> None:
        """Make `runs/<stamp>-<name>/`; ``known``: metadata of the recording. Raises
        CouldNotRecord."""
        self._started = datetime.now(UTC).isoformat(timespec="milliseconds")
        self.path = _new_folder(runs, name)
        self._recorder = RunRecorder(self.recording, channels, known)
        self.write = self._recorder.write  # without a call in between, at every message

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """On an exception, keep what was recorded, without a result."""
        if kind is not None:
            self.abandon()

    @property
    def recording(self) -> Path:
        return self.path / RECORDING

    def finish(self, result: WrittenT) -> WrittenT:
        """Close the recording, write and return the result; on CouldNotRecord both are removed."""
        self._recorder.close()
        result = msgspec.structs.replace(result, started=self._started)
        failure: BaseException | None = self._recorder.failure
        if failure is None:
            try:
                text = msgspec.json.format(msgspec.json.encode(result), indent=2) + b"\n"
                write_whole(self.path / RESULT, text, private=True)
            except OSError as error:
                failure = error
        if failure is not None:
            self._remove()
            raise could_not_record(self.path, failure)
        return result

    def abandon(self) -> None:
        """End without a result: keep what was recorded, remove a folder without messages."""
        self._recorder.close()
        if self._recorder.empty or self._recorder.failure is not None:
            self._remove()

    def check(self) -> None:
        """Raise CouldNotRecord if a message could not be recorded."""
        if self._recorder.failure is not None:
            raise could_not_record(self.path, self._recorder.failure)

    def _remove(self) -> None:
        """Remove recording and folder; other files that were put into the folder stay."""
        with suppress(OSError):
            self.recording.unlink(missing_ok=True)
            self.path.rmdir()


def check_runs(runs: Path | None) -> None:
    """Make the folder and test-write a file, before a rig opens. Raises UsageError for an
    impossible path, CouldNotRecord where nothing can be written."""
    if runs is None:
        return
    try:
        make_private_folder(runs)
        with TemporaryFile(dir=runs) as file:
            file.write(bytes(PROBE_BYTES))
    except OSError as error:
        if error.errno in PATH_ERRORS:
            message = f"{error.strerror}: {runs}"  # the reason first: a long message is cut
            raise UsageError(message, "choose another folder with --runs") from None
        raise could_not_record(runs, error) from None


class Record:
    """Records and judges one run, in a new folder in ``runs``; None records nothing.

        with Record(config, "lift", seed, runs, rig.clock, watch) as record:
            trial = run_trial(config, rig, guard, record.tick)
            return record.finish(trial, lambda: judge(config, seed, trial, record.path))

    On an exception it keeps what was recorded, without a result. Enter it with signals deferred.
    """

    def __init__(
        self, config: TrialConfig, scenario: str, seed: int, runs: Path | None, clock: Clock,
        watch: Watch, home: Vector3 | None = None,
    ) -> None:  # fmt: skip
        """``home``: the arm's home from an earlier trial on this rig."""
        self._folder: RunFolder | None = None
        self._config, self._seed, self._home = config, seed, home
        self._runs, self._name = runs, f"{scenario}-{config.object.name}"
        self._clock = clock
        self._viewer_messages = ViewerMessages(config, clock.unix_ns)
        self._phases_written = 0
        self._watch = watch

    def __enter__(self) -> Self:
        """Raises CouldNotRecord if the folder cannot be made."""
        if self._runs is not None:
            self._folder = RunFolder(self._runs, self._name, WRITTEN, self._metadata())
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._abandon()

    def _metadata(self) -> dict[str, str]:
        config, seed, home = self._config, self._seed, self._home
        known = {**metadata(config, seed, self._clock), "config_hash": config.digest()}
        if home is not None:  # set by an earlier trial
            known["home_m"] = _json(home)
        return known

    def _abandon(self) -> None:
        if self._folder is not None:
            self._folder.abandon()

    @property
    def path(self) -> str | None:
        """Path of the recording."""
        return None if self._folder is None else str(self._folder.recording)

    def tick(self, tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        """Write one tick, then pass it to the observer."""
        if self._folder is not None:
            changes = controller.machine.log[self._phases_written :]
            self._phases_written += len(changes)
            write = self._folder.write
            write_tick(write, tick)
            for change in changes:
                write(PHASES, change.t_ns, change)
            if truth is not None:
                write(TRUTH, tick.t_ns, truth)
            self._viewer_messages.write(write, tick, truth, changes)
        self._watch(tick, truth, controller)

    def finish(self, trial: FinishedTrial, judge: Callable[[], ResultT]) -> JudgedTrial[ResultT]:
        """Judge the trial, close the recording and write the result. If one of these raises, the
        failure still states the final state of arm and hand; without a verdict there is no
        result."""
        result, failure = None, None
        try:
            result = judge()
            failure = trial.failure(self._config)
            if self._folder is not None:
                result = self._folder.finish(result)
            return JudgedTrial(result, failure)
        except CouldNotRecord as error:
            failure = failure or Failure(error.kind, error.message, error.remedy)
        except (Exception, SystemExit) as error:  # a plug-in may exit
            failure = _with_bug(failure, Bug.of(error), trial, self._config)
            self._abandon()
        if result is not None:
            result = msgspec.structs.replace(result, recording=None)
        return JudgedTrial(result, failure)


def _with_bug(
    failure: Failure | None, bug: Bug, trial: FinishedTrial, config: TrialConfig
) -> Failure:
    """The failure with the bug's message appended, or of kind internal if there was none."""
    if failure is not None:
        return msgspec.structs.replace(failure, message=f"{failure.message}; then {bug.fault.line}")
    end = None
    with suppress(Exception):
        end = trial.end(config)
    return Failure(INTERNAL, bug.fault.line, REPORT, end, (bug.fault,))


def metadata(config: msgspec.Struct, seed: int, clock: Clock) -> dict[str, str]:
    """Metadata of a recording: settings, seed and versions to repeat the run, and the start of its
    clock in Unix time."""
    return {
        "config": _json(config),
        "seed": str(seed),
        **{f"version.{name}": text for name, text in versions().items()},
        UNIX_NS: str(clock.unix_ns),
    }


def _json(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def could_not_record(path: Path, error: BaseException) -> CouldNotRecord:
    """The error for an exception while recording: of the disk, or a bug."""
    text, remedy = Bug.of(error).fault.message, REPORT
    if isinstance(error, OSError):
        text = error.strerror or str(error)
        remedy = "free disk space or choose another folder with --runs"
    return CouldNotRecord(f"{path}: the run could not be recorded: {text}", remedy)


def _new_folder(runs: Path, name: str) -> Path:
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")  # noqa: DTZ005  (the user's local time)
    attempt, path = 1, runs / f"{stamp}-{name}"
    try:
        while path.is_dir():
            attempt += 1
            path = runs / f"{stamp}-{name}-{attempt}"
        make_private_folder(path, exist_ok=False)
    except OSError as error:
        raise could_not_record(path, error) from None
    return path
