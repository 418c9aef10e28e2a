"""The folder that a run leaves: `recording.mcap` and `result.json`, complete or not at all."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from datetime import datetime
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Self

import msgspec

from drivers.errors import BadFile, CouldNotRecord, SuppressBugs, UsageError
from drivers.interfaces import Vector3
from grasp import signals
from grasp.clock import VIRTUAL_EPOCH_NS, Clock
from grasp.controller import GraspController
from grasp.fault import INTERNAL
from grasp.files import LEADS_NOWHERE, make_private_folder, write_whole
from grasp.loop import Tick
from grasp.messages import CHANNELS, CONTROL, PHASES, TRUTH, Write, write_tick
from grasp.recording import UNIX_NS, Channels, RunRecorder, RunRecording
from grasp.states import PhaseChange
from scenarios.trial import pictures
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import FinishedTrial, Watch
from scenarios.trial.pictures import Pictures
from scenarios.trial.result import REPORT, Bug, Failure, FinishedRun, ResultT, Wanted, versions
from scenarios.world.truth import Truth

RECORDING = "recording.mcap"
RESULT = "result.json"
OF_THE_MACHINE = ("timing", "recording", "recordings")  # of a result
TRIED_BYTES = 65_536  # a second of a run
RUN_CHANNELS: dict[str, type[msgspec.Struct]] = {**CHANNELS, TRUTH: Truth}
WRITTEN: dict[str, type[msgspec.Struct]] = {**RUN_CHANNELS, **pictures.CHANNELS}
EPOCHS = {
    True: "virtual: 2000-01-01T00:00:00Z is when the rig was switched on",
    False: "wall clock",
}


def find_recording(path: Path) -> Path:
    """The recording of a run folder, or the file itself."""
    return path / RECORDING if path.is_dir() else path


def open_trial(path: Path) -> RunRecording:
    """The recording of a trial, given its folder or the file itself; raises BadFile for others."""
    recording = RunRecording.open(find_recording(path), RUN_CHANNELS)
    if next(recording.of(CONTROL), None) is None:
        raise BadFile(
            recording.path,
            "holds no control step: it is an acquisition's, or was cut off before the first",
            "give the folder of a lift or a tap, as `grasp runs` lists them",
        )
    return recording


class RunFolder:
    """Records one run. Nothing here raises while it runs; ``finish`` says how it went."""

    def __init__(self, runs: Path, name: str, channels: Channels, known: Mapping[str, str]) -> None:
        """Makes `runs/<stamp>-<name>/`; ``known``: of the recording's metadata. Raises
        CouldNotRecord if it cannot."""
        self.path = _new_folder(runs, name)
        self._recorder = RunRecorder(self.recording, channels, known)
        self._empty = True
        self._virtual = known.get(UNIX_NS) == str(VIRTUAL_EPOCH_NS)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Left by an exception it keeps what there is, without a result."""
        if kind is not None:
            self.abandon()

    @property
    def recording(self) -> Path:
        return self.path / RECORDING

    def write(self, topic: str, t_ns: int, message: msgspec.Struct) -> None:
        """One message, as the recorder does."""
        self._empty = False
        self._recorder.write(topic, t_ns, message)

    def finish(self, result: msgspec.Struct) -> None:
        """Close the recording, write the result; raises CouldNotRecord, and leaves neither."""
        self._recorder.attach(RESULT, "application/json", _pretty(_attached(result, self._virtual)))
        self._recorder.close()
        failure: BaseException | None = self._recorder.failure
        if failure is None:
            try:
                write_whole(self.path / RESULT, _pretty(result), private=True)
            except OSError as error:
                failure = error
        if failure is not None:
            self._remove()
            raise could_not_record(self.path, failure)

    def abandon(self) -> None:
        """End without a result: what was recorded is kept, a folder without a message goes."""
        self._recorder.close()
        if self._empty or self._recorder.failure is not None:
            self._remove()

    def _remove(self) -> None:
        """What else was put into the folder stays."""
        with suppress(OSError):
            self.recording.unlink(missing_ok=True)
            self.path.rmdir()


def check_runs(runs: Path | None) -> None:
    """Raises UsageError where no folder can be, CouldNotRecord where nothing can be written, before
    a rig opens; makes the folder."""
    if runs is None:
        return
    try:
        make_private_folder(runs)
        with TemporaryFile(dir=runs) as file:
            file.write(bytes(TRIED_BYTES))
    except OSError as error:
        if error.errno in LEADS_NOWHERE:
            told = f"{error.strerror}: {runs}"  # the reason first: what is long is cut
            raise UsageError(told, "choose another folder with --runs") from None
        raise could_not_record(runs, error) from None


class Record:
    """What one run leaves: a folder of its own in ``runs``, or nothing where that is None. With
    ``wanted`` the run is kept in memory, and has a folder only if its result is wanted.

        with Record(config, "lift", seed, runs, watch) as record:
            trial = run_trial(config, rig, guard, record.tick)
            return record.finish(trial, lambda: judge(config, seed, trial, record.path))

    Left by an exception it keeps what there is, without a result. A signal never cuts it in two.
    """

    def __init__(
        self, config: TrialConfig, scenario: str, seed: int, runs: Path | None, watch: Watch,
        home: Vector3 | None = None, wanted: Wanted | None = None, clock: Clock | None = None,
    ) -> None:  # fmt: skip
        """``home``: of the arm, from an earlier trial on this rig; ``clock``: of the rig, virtual
        where nobody says."""
        self._folder: RunFolder | None = None
        self._runs, self._name = runs, f"{scenario}-{config.object.name}"
        virtual, unix_ns = clock is None or clock.virtual, VIRTUAL_EPOCH_NS
        unix_ns = unix_ns if clock is None else clock.unix_ns
        self._known = partial(_known, config, seed, home, (virtual, unix_ns))
        self._pictures = Pictures(config, unix_ns)
        self._wanted = None if runs is None else wanted
        self._kept: list[tuple[Tick, Truth | None, Sequence[PhaseChange]]] = []
        self._phases_written = 0
        self._config = config
        self._watch = watch
        self._uncut = ExitStack()

    def __enter__(self) -> Self:
        """Raises CouldNotRecord if there can be no folder."""
        with ExitStack() as uncut:
            uncut.enter_context(signals.deferred())
            self._folder = self._begun() if self._wanted is None else None
            self._uncut = uncut.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with self._uncut:
            if kind is not None:
                self._abandon()

    def _abandon(self) -> None:
        if self._folder is not None:
            self._draw_the_last(self._folder)
            self._folder.abandon()

    def _begun(self) -> RunFolder | None:
        if self._runs is None:
            return None
        return RunFolder(self._runs, self._name, WRITTEN, self._known())

    @property
    def path(self) -> str | None:
        """Of the recording."""
        return None if self._folder is None else str(self._folder.recording)

    def tick(self, tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        """Write one tick, or keep it, then let anyone watch."""
        if self._folder is not None or self._wanted is not None:
            changes = controller.machine.log[self._phases_written :]
            self._phases_written += len(changes)
            if self._folder is not None:
                self._write(self._folder.write, tick, truth, changes)
            else:
                self._kept.append((tick, truth, changes))
        self._watch(tick, truth, controller)

    def _write(
        self, write: Write, tick: Tick, truth: Truth | None, changes: Sequence[PhaseChange]
    ) -> None:
        """One tick, with the phase changes that it brought, and what viewers draw of it."""
        write_tick(write, tick)
        for change in changes:
            write(PHASES, change.t_ns, change)
        if truth is not None:
            write(TRUTH, tick.t_ns, truth)
        try:
            self._pictures.write(write, tick, truth, changes)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # no run shall end for a picture
            self._pictures.end(write, tick.t_ns, error)

    def _draw_the_last(self, folder: RunFolder) -> None:
        with SuppressBugs():  # whatever a picture lacks, the result is written
            self._pictures.flush(folder.write)

    def _write_kept(self, result: ResultT) -> ResultT:
        """The folder of a run that turned out to be wanted, and its result with the path."""
        if self._wanted is None or not self._wanted(result):
            return result
        self._folder = folder = self._begun()
        assert folder is not None  # noqa: S101  (nobody wants what has no place)
        for tick, truth, changes in self._kept:
            self._write(folder.write, tick, truth, changes)
        return msgspec.structs.replace(result, recording=str(folder.recording))

    def finish(self, trial: FinishedTrial, judge: Callable[[], ResultT]) -> FinishedRun[ResultT]:
        """Judge, close the recording and write the result. Whatever raises on the way, of arm and
        hand is told how they were left; a trial that could not be judged has no result."""
        result, failure = None, None
        try:
            result = judge()
            failure = trial.failure(self._config)
            result = self._written(result)
        except CouldNotRecord as error:
            if result is not None:
                result = msgspec.structs.replace(result, recording=None)
            failure = failure or Failure(error.kind, error.message, error.remedy)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            failure = _with_bug(failure, Bug.of(error), trial, self._config)
            if self._folder is not None:
                self._folder.abandon()
            if result is not None:
                result = msgspec.structs.replace(result, recording=None)
        return FinishedRun(result, failure)

    def _written(self, result: ResultT) -> ResultT:
        if self._folder is None and self._wanted is None:
            return result
        result = self._write_kept(result)
        if self._folder is not None:
            self._draw_the_last(self._folder)
            self._folder.finish(result)
        return result


def _with_bug(
    failure: Failure | None, bug: Bug, trial: FinishedTrial, config: TrialConfig
) -> Failure:
    """A trial that failed as well keeps its kind."""
    if failure is not None:
        return msgspec.structs.replace(failure, message=f"{failure.message}; then {bug.fault.line}")
    end = None
    with SuppressBugs():
        end = trial.end(config)
    return Failure(INTERNAL, bug.fault.line, REPORT, end, (bug.fault,))


def _known(
    config: TrialConfig, seed: int, home: Vector3 | None, epoch: tuple[bool, int]
) -> dict[str, str]:
    return {**metadata(config, seed, home), **stated(config, seed), **dated(*epoch)}


def dated(virtual: bool, unix_ns: int) -> dict[str, str]:
    """From when on the times of a recording count."""
    return {UNIX_NS: str(unix_ns), "epoch": EPOCHS[virtual]}


def _attached(result: msgspec.Struct, virtual: bool) -> dict[str, Any]:
    """The result as a recording holds it: in virtual time without what is this machine's and no
    part of the run, so that equal runs give equal files."""
    told: dict[str, Any] = msgspec.to_builtins(result)
    left_out = OF_THE_MACHINE if virtual else ()
    return {key: value for key, value in told.items() if key not in left_out}


def metadata(config: msgspec.Struct, seed: int, home: Vector3 | None = None) -> dict[str, str]:
    """What is needed to run the same again: settings, seed, versions, and the arm's home if it was
    another trial's."""
    return {
        **({} if home is None else {"home_m": msgspec.json.encode(home).decode()}),
        "config": msgspec.json.encode(config).decode(),
        "seed": str(seed),
        **{f"version.{name}": text for name, text in versions().items()},
    }


def stated(config: TrialConfig, seed: int) -> dict[str, str]:
    """What a recording says of itself beside its settings."""
    physics = config.physics(seed)
    world = {} if physics is None else {"physics": msgspec.json.encode(physics).decode()}
    return {"config_hash": config.digest(), **world}


def could_not_record(path: Path, cause: BaseException) -> CouldNotRecord:
    text = getattr(cause, "strerror", None) or str(cause)
    return CouldNotRecord(
        f"{path}: the run could not be recorded: {text}",
        "free disk space or choose another folder with --runs",
    )


def _pretty(result: msgspec.Struct | dict[str, Any]) -> bytes:
    return msgspec.json.format(msgspec.json.encode(result), indent=2) + b"\n"


def _new_folder(runs: Path, name: str) -> Path:
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")  # noqa: DTZ005  (a person's local time)
    for attempt in range(1, 1000):
        path = runs / (f"{stamp}-{name}" if attempt == 1 else f"{stamp}-{name}-{attempt}")
        try:
            make_private_folder(path, exist_ok=False)
        except FileExistsError:
            if path.is_dir():
                continue
            raise could_not_record(path, NotADirectoryError(0, f"{runs} is not a folder")) from None
        except OSError as error:
            raise could_not_record(path, error) from None
        return path
    raise could_not_record(runs / stamp, FileExistsError("too many runs within a second"))
