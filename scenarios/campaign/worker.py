"""Runs one trial of a campaign in a worker process and returns its row."""

import fcntl
import os
import shutil
import tempfile
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Literal

import msgspec

from grasp.control.fault import INTERNAL, INTERRUPTED
from grasp.control.monitors.checks import DETECTOR_FAILED
from scenarios.campaign.experiments import EXPERIMENTS
from scenarios.campaign.spec import Task
from scenarios.trial.result import Failure, TrialResult, versions

FOLDER = ".grasp-trial-being-recorded-"  # beginning of a temporary folder's name
# columns that only one experiment has
EXPERIMENT_COLUMNS = (
    "reaction_latency_ms", "slip_distance_m", "turned_rad", "alarm_stayed", "moved", "direction",
    "nominal_again_ms",
)  # fmt: skip


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One row of the campaign's table; docs/data-formats.md explains the columns."""

    trial: int
    scenario: Literal["lift", "tap"]
    object: str
    profile: str
    detector: str
    swept: str
    repetition: int
    seed: int
    set_down: bool  # the trial includes the set-down
    status: str  # done, error
    success: bool | None = None
    outcome: str | None = None
    detection_latency_ms: float | None = None
    reaction_latency_ms: float | None = None
    alarm_stayed: bool | None = None  # a lift: slip was registered at the end of the hold
    moved: bool | None = None  # a tap: without displacement it is excluded from the rate
    direction: str | None = None
    nominal_again_ms: float | None = None
    slip_distance_m: float | None = None  # of a tap: the permanent displacement
    turned_rad: float | None = None  # in the hand, about the closing axis
    peak_force_n: float | None = None
    commanded_force_n: float | None = None
    paused_s: float | None = None  # stops of the arm to respond to slip
    result: str | None = None
    error: str | None = None
    config_hash: str
    detector_hash: str
    versions: str | None = None
    wall_s: float | None = None
    cpu_s: float | None = None
    timing: str | None = None
    recording: str | None = None


def run_once(trial: Task, runs: Path | None) -> tuple[TrialResult, Failure | None]:
    """Run and judge one trial. Raises RuntimeError for an internal error or one of the detector,
    KeyboardInterrupt."""
    judged = EXPERIMENTS[trial.scenario].run(trial.run_config, trial.seed, runs)
    result, failure = judged.result, judged.failure
    if result is not None and result.outcome == INTERRUPTED:
        raise KeyboardInterrupt
    if result is not None and result.bug is not None:
        raise RuntimeError(result.bug.traceback)
    if result is None or (failure is not None and failure.kind == INTERNAL):
        raise RuntimeError("no result" if failure is None else failure.message)
    broken = next((f.line for f in result.faults if f.code == DETECTOR_FAILED), None)
    if broken is not None:  # a trial without a working detector has no verdict
        raise RuntimeError(broken)
    return result, failure


def run_trial(trial: Task) -> tuple[Row, bytes | None]:
    """Run one trial; returns its row, and the bytes of its recording if that is kept. An exception
    in it becomes a row with its error."""
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        row, recording = _run(trial)
    except Exception:
        row, recording = error_row(trial, traceback.format_exc()), None
    return msgspec.structs.replace(row, **cost_columns(wall, cpu)), recording


def cost_columns(wall: float, cpu: float) -> dict[str, Any]:
    """Columns of run time since the two start times, s, and of the versions."""
    return {
        "wall_s": round(time.perf_counter() - wall, 4),
        "cpu_s": round(time.process_time() - cpu, 4),
        "versions": _json(versions()),
    }


def error_row(trial: Task, error: str, result: TrialResult | None = None) -> Row:
    """The row of a trial without a verdict, with its partial result if there is one."""
    partial = None if result is None else _table(result)
    return Row(**identity(trial), status="error", error=error, result=partial)


def _run(trial: Task) -> tuple[Row, bytes | None]:
    if trial.recordings != "all":
        result, failure = run_once(trial, None)
        if trial.recordings == "none" or not result.failed:
            return judged_row(trial, result, failure), None
    # a failed trial is repeated, with the same result, because most trials need no recording
    with tempfile.TemporaryDirectory(prefix=FOLDER) as folder, _locked(folder):
        result, failure = run_once(trial, Path(folder))
        if result.recording is None:
            raise OSError("nothing was recorded" if failure is None else failure.message)
        return judged_row(trial, result, failure), Path(result.recording).read_bytes()


@contextmanager
def _locked(folder: Path | str) -> Iterator[None]:
    """Lock a folder, also for processes of other containers, until its process ends. Raises
    OSError."""
    file = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(file)


def remove_left_folders() -> None:
    """Remove the folders of trials whose process was killed: nobody holds their lock."""
    for folder in Path(tempfile.gettempdir()).glob(f"{FOLDER}*"):
        with suppress(OSError), _locked(folder):
            if folder.lstat().st_uid == os.getuid():
                shutil.rmtree(folder)


def judged_row(trial: Task, result: TrialResult, failure: Failure | None) -> Row:
    """The row of a trial with a verdict."""
    special: dict[str, Any] = {name: getattr(result, name, None) for name in EXPERIMENT_COLUMNS}
    return Row(
        **identity(trial),
        **special,
        status="done",
        success=result.success,
        outcome=result.outcome,
        detection_latency_ms=result.detection_latency_ms,
        peak_force_n=max(result.peak_force_n.values()) if result.peak_force_n else None,
        commanded_force_n=result.commanded_force_n,
        paused_s=result.paused_s,
        result=_table(result),
        error=failure.message if failure else None,
        timing=_json(result.timing),
    )


def _table(result: TrialResult) -> str:
    """The result as JSON, without values that have their own columns or differ in a repetition."""
    table: dict[str, Any] = msgspec.to_builtins(result)
    for column in ("timing", "recording", "versions", "started"):
        del table[column]
    return _json(table)


def identity(trial: Task) -> dict[str, Any]:
    """The columns that are known before the trial runs."""
    return {
        "trial": trial.number,
        "scenario": trial.scenario,
        "object": trial.config.object.name,
        "profile": trial.config.profile,
        "detector": trial.config.detector_label,
        "swept": _json(trial.swept),
        "repetition": trial.repetition,
        "seed": trial.seed,
        "set_down": trial.set_down,
        "config_hash": trial.config.digest(),
        "detector_hash": trial.config.detector_hash(),
    }


def _json(value: Any) -> str:
    return msgspec.json.encode(value).decode()
