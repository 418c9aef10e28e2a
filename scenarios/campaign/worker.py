"""Runs one trial of a campaign in a worker process and makes its row."""

import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

import msgspec

from grasp.fault import INTERRUPTED
from scenarios.campaign.config import EXPERIMENTS
from scenarios.campaign.spec import Task
from scenarios.trial.result import Failure, FinishedRun, TrialResult, versions

AnyRun = FinishedRun[Any]
# columns of a row that only one of the experiments has
OWN_COLUMNS = (
    "reaction_latency_ms", "slip_distance_m", "turned_rad", "alarm_stayed", "moved", "direction",
    "nominal_again_ms",
)  # fmt: skip


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the campaign's table; docs/data-formats.md explains the columns."""

    trial: int
    scenario: str
    object: str
    profile: str
    detector: str
    swept: str
    repetition: int
    seed: int
    status: str  # done, error
    success: bool | None = None
    outcome: str | None = None
    detection_latency_ms: float | None = None
    reaction_latency_ms: float | None = None
    alarm_stayed: bool | None = None  # a lift: slip was registered at the end of the hold
    moved: bool | None = None  # a tap: what moved nothing is counted apart
    direction: str | None = None
    nominal_again_ms: float | None = None
    slip_distance_m: float | None = None  # of a tap: the permanent displacement
    turned_rad: float | None = None  # in the hand, about the closing axis
    peak_force_n: float | None = None
    commanded_force_n: float | None = None
    paused_s: float | None = None  # the arm, for answers to slip
    result: str | None = None
    error: str | None = None
    config_hash: str
    detector_hash: str
    versions: str | None = None
    wall_s: float | None = None
    cpu_s: float | None = None
    timing: str | None = None
    recording: str | None = None


class Finished(msgspec.Struct, frozen=True):
    """A row and, if it is to be kept, the bytes of its recording."""

    row: Row
    recording: bytes | None = None


def run_once(trial: Task, runs: Path | None) -> tuple[TrialResult, Failure | None]:
    """One judged trial; KeyboardInterrupt passes."""
    finished: AnyRun = EXPERIMENTS[trial.scenario].run(trial.config, trial.seed, runs)
    result, failure = finished.result, finished.failure
    if result is not None and result.outcome == INTERRUPTED:
        raise KeyboardInterrupt
    if result is not None and result.bug is not None:
        raise RuntimeError(result.bug.traceback)
    if result is None or (failure is not None and failure.kind == "internal"):
        raise RuntimeError("no result" if failure is None else failure.message)
    return result, failure


def run_trial(trial: Task) -> Finished:
    """Never raises for what goes wrong in the trial: that is a row with its error."""
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        finished = _run(trial)
    except Exception:
        finished = Finished(error_row(trial, traceback.format_exc()))
    row = msgspec.structs.replace(finished.row, **spent(wall, cpu))
    return Finished(row, finished.recording)


def spent(wall: float, cpu: float) -> dict[str, Any]:
    """What a row says of its machine: time since then, s, and what ran there."""
    return {
        "wall_s": round(time.perf_counter() - wall, 4),
        "cpu_s": round(time.process_time() - cpu, 4),
        "versions": _json(versions()),
    }


def error_row(trial: Task, error: str, result: TrialResult | None = None) -> Row:
    """The row of a trial that could not be judged, with what it left, if it left something."""
    left = None if result is None else _table(result)
    return Row(**identity(trial), status="error", error=error, result=left)


def _run(trial: Task) -> Finished:
    if trial.recordings != "all":
        result, failure = run_once(trial, None)
        if trial.recordings == "none" or not result.failed:
            return Finished(judged(trial, result, failure))
    # one that failed is run again: it comes out alike, and most trials need no recording
    with tempfile.TemporaryDirectory(prefix="grasp-campaign-") as folder:
        result, failure = run_once(trial, Path(folder))
        if result.recording is None:
            raise OSError("nothing was recorded" if failure is None else failure.message)
        return Finished(judged(trial, result, failure), Path(result.recording).read_bytes())


def judged(trial: Task, result: TrialResult, failure: Failure | None) -> Row:
    """The row of a trial that was judged, whatever its verdict."""
    own: dict[str, Any] = {name: getattr(result, name, None) for name in OWN_COLUMNS}
    return Row(
        **identity(trial),
        **own,
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
    """All of a result that has no column of its own."""
    table: dict[str, Any] = msgspec.to_builtins(result)
    for column in ("timing", "recording", "versions"):
        del table[column]
    return _json(table)


def identity(trial: Task) -> dict[str, Any]:
    """The columns that a row has before its trial has run."""
    return {
        "trial": trial.number,
        "scenario": trial.scenario,
        "object": trial.config.object.name,
        "profile": trial.config.profile,
        "detector": trial.config.detector_label,
        "swept": _json(trial.swept),
        "repetition": trial.repetition,
        "seed": trial.seed,
        "config_hash": trial.config.digest(),
        "detector_hash": trial.config.detector_hash(),
    }


def _json(value: Any) -> str:
    return msgspec.json.encode(value).decode()
