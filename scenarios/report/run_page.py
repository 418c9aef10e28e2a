"""The page of one run: `grasp report RUN`."""

import base64
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGER_NAMES
from grasp.commands import describe
from grasp.states import State
from scenarios.report.drawn import Seen, scene
from scenarios.report.page import render
from scenarios.report.run_decision import Decided, decided
from scenarios.report.run_record import RunRecord, Sent, read_run
from scenarios.report.run_settings import (
    NAMED,
    command_of,
    object_file,
    settings_of,
    shell,
)
from scenarios.report.run_words import badge, remarks, sentence
from scenarios.trial.pictures import taxel_places
from scenarios.trial.run_folder import RECORDING, find_recording

MISSING = -(2**31)  # no number


class Column(msgspec.Struct, frozen=True):
    """Values (n,) or (n, width), NaN where there is none, kept to the nearest ``step``."""

    values: NDArray[np.float64]
    step: float


def pack(columns: Mapping[str, Column]) -> dict[str, Any]:
    """What `unpack()` of `page/data.js` takes; all columns are equally long."""
    flat = {name: column.values.reshape(len(column.values), -1) for name, column in columns.items()}
    steps = [_differences(flat[name], columns[name].step) for name in columns]
    content = b"".join(values.tobytes() for values in steps)
    return {
        "rows": len(next(iter(flat.values()))),
        "columns": [[name, flat[name].shape[1], columns[name].step] for name in columns],
        "deflated": base64.b64encode(zlib.compress(content, 9)).decode(),
    }


def _differences(values: NDArray[np.float64], step: float) -> NDArray[np.int32]:
    """(width, n) little-endian; 32 bits wrap around here as they do where they are added up."""
    whole = np.clip(np.round(values / step), MISSING + 1, -MISSING - 1)
    counts = np.where(np.isnan(whole), MISSING, whole).astype(np.int64).T
    return np.diff(counts, axis=1, prepend=0).astype(np.uint32).astype("<u4").view("<i4")


def thinned(n: int, most: int, peaks: Sequence[NDArray[np.float64]]) -> NDArray[np.intp]:
    """Which of n samples to show, at most about ``most``: all, or of each stretch the first one and
    the largest of each of ``peaks`` (n,), so that no peak is lost."""
    if n <= most:
        return np.arange(n)
    stretches = np.array_split(np.arange(n), max(1, most // (1 + len(peaks))))
    kept = {int(stretch[0]) for stretch in stretches} | {n - 1}
    for values in peaks:
        known = np.nan_to_num(values, nan=-np.inf)
        kept |= {int(stretch[known[stretch].argmax()]) for stretch in stretches}
    return np.array(sorted(kept))


PAGE = "report.html"
LIBRARY = "uplot/uPlot.iife.min.js"
SCRIPTS = (LIBRARY, "data.js", "run_scene.js", "run_plots.js", "run.js", "whole.js")
MOST_ROWS = 6_000  # a minute at 100 Hz; a longer run is thinned, its peaks kept
LEAD_S = 0.15  # the page begins so long after slip was registered: the fingers have closed

# steps to which columns are kept: well below what is drawn, felt or told in digits
TIME_S, FORCE_N, LENGTH_M, SPEED_MPS, ANGLE_RAD = 1e-5, 1e-3, 1e-5, 1e-4, 1e-4
PROBABILITY, SHARE, LOG_ODDS = 1e-5, 1e-3, 1e-3


def page_path(run: Path) -> Path:
    """Where the page of a run goes when nobody says: beside its recording."""
    recording = find_recording(run)
    return recording.with_name(PAGE if recording.name == RECORDING else f"{recording.stem}.html")


def run_page(path: Path) -> str:
    """The page of a run folder or recording; raises BadFile as ``read_run``."""
    run = read_run(path)
    told = run.told
    by_rule = decided(told.rule, run.probabilities, run.armed, run.masked)
    settings = settings_of(run.settings)
    return render(
        "run.html",
        SCRIPTS,
        title=f"{run.scenario} · {told.object.name} · seed {run.metadata.get('seed', '?')}",
        badge=badge(run.verdict),
        sentence=sentence(run),
        remarks=remarks(run),
        run=run,
        fingers=FINGER_NAMES,
        view=Seen(
            hand=True,
            truth=run.truth is not None,
            motion=run.motion is not None,
            limit_n=run.told.guard.force_limit_n,
            rule=by_rule,
            evidence=not by_rule.probable,
        ),
        phases=_phase_rows(run),
        commands=[_command_row(sent) for sent in run.commands],
        own_settings=[setting for setting in settings if setting.own],
        compared=any(setting.usual is not None for setting in settings),
        other_settings=[setting for setting in settings if not setting.own],
        origins=_origins(run),
        timing=_timing(run),
        command=shell(command_of(run.settings, run.seed)),
        object_file=object_file(run.settings),
        data=_data(run, by_rule),
    )


def _data(run: RunRecord, by_rule: Decided) -> dict[str, Any]:
    """What the scripts of the page are given."""
    columns = _columns(run, by_rule)
    kept = _kept(run)
    thin = {name: Column(column.values[kept], column.step) for name, column in columns.items()}
    return {
        "series": pack(thin),
        "fingers": FINGER_NAMES,
        "taxels": taxel_places(run.told.fingertip.taxels_mm, run.counts.shape[2]),
        "limit_n": run.told.guard.force_limit_n,
        "rule": {"limit": by_rule.limit, "probable": by_rule.probable, "label": by_rule.label},
        "phases": [{"t": c.t_ns * 1e-9, "name": c.phase} for c in run.phases],
        "marks": _marks(run),
        "start": _start_s(run),
        "scene": _scene(run),
    }


def _columns(run: RunRecord, by_rule: Decided) -> dict[str, Column]:
    status = run.armed * 1.0 + run.masked * 2.0 + run.registered * 4.0
    columns = {
        "t": Column(run.t_s, TIME_S),
        "probability": Column(run.heard(run.probabilities), PROBABILITY),
        "felt": Column(run.heard(run.felt_n), FORCE_N),
        "counts": Column(run.counts, 1.0),
        "positions": Column(run.fingers_counts, 1.0),
        "arm": Column(run.arm_m[:, 2], LENGTH_M),
        "status": Column(status, 1.0),
    }
    if by_rule.values.shape != run.probabilities.shape or not by_rule.probable:
        step = PROBABILITY if by_rule.probable else LOG_ODDS
        columns["decided"] = Column(by_rule.values, step)
    if run.motion is not None:
        columns |= {
            "told_speed": Column(run.motion.speed_mps, SPEED_MPS),
            "told_way": Column(run.motion.direction_deg, 1.0),
            "told_turning": Column(run.motion.turning, SHARE),
        }
    if run.truth is not None:
        columns |= {
            "true": Column(run.truth.normal_n, FORCE_N),
            "shear": Column(run.truth.shear_n, FORCE_N),
            "height": Column(run.truth.height_m, LENGTH_M),
            "slip": Column(run.truth.slip_m, LENGTH_M),
            "slip_speed": Column(run.truth.slip_mps, SPEED_MPS),
            "across": Column(run.truth.across_m, LENGTH_M),
            "turn": Column(run.truth.turn_rad, ANGLE_RAD),
        }
    return columns


def _kept(run: RunRecord) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Of a long run the steps that are shown."""
    peaks = [run.felt_n.max(axis=1), run.probabilities.max(axis=1)]
    if run.truth is not None:
        peaks += [run.truth.normal_n.max(axis=1), np.abs(run.truth.slip_mps)]
    return thinned(len(run.t_s), MOST_ROWS, peaks)


def _marks(run: RunRecord) -> list[dict[str, Any]]:
    """Instants that plots name."""
    verdict, truth = run.verdict, run.truth
    onset_s = None if truth is None else truth.onset_s
    struck_s = None if truth is None else truth.struck_s
    registered = np.flatnonzero(run.registered)
    registered_s = float(run.t_s[registered[0]]) if len(registered) else None
    if verdict is not None:
        onset_s = verdict.slip_onset_s if verdict.slip_onset_s is not None else onset_s
        struck_s = verdict.struck_s if verdict.struck_s is not None else struck_s
        registered_s = verdict.slip_registered_s or registered_s
    found = (
        ("struck", "blow", struck_s),
        ("onset", "slip begins", onset_s),
        ("registered", "slip registered", registered_s),
    )
    return [{"kind": kind, "name": name, "t": t} for kind, name, t in found if t is not None]


def _start_s(run: RunRecord) -> float:
    """The instant that the page shows first, and prints: just after slip was registered, or the
    middle of the run."""
    marks = {mark["kind"]: mark["t"] for mark in _marks(run)}
    first = marks.get("registered", marks.get("onset", marks.get("struck")))
    return float(run.t_s[len(run.t_s) // 2]) if first is None else first + LEAD_S


def _scene(run: RunRecord) -> dict[str, Any]:
    """Of the side view. Heights count from where the arm was when the lift began."""
    known = run.arm_m[:, 2][np.isfinite(run.arm_m[:, 2])]
    begun_ns = [change.t_ns for change in run.phases if change.phase == State.LIFT][:1]
    first = int(np.searchsorted(run.t_s, begun_ns[0] * 1e-9)) if begun_ns else 0
    grip_m = float(run.arm_m[min(first, len(run.t_s) - 1), 2])
    return scene(
        run.told,
        grip_m if np.isfinite(grip_m) else 0.0,
        float(known.max()) if len(known) else 0.0,
    )


def _phase_rows(run: RunRecord) -> list[dict[str, Any]]:
    """Each phase, when it began and how long it lasted, in seconds."""
    begins = [change.t_ns * 1e-9 for change in run.phases]
    ends = [*begins[1:], float(run.t_s[-1])]
    return [
        {"t": t, "lasted_s": max(0.0, end - t), "phase": change.phase, "cause": change.cause}
        for change, t, end in zip(run.phases, begins, ends, strict=True)
    ]


def _command_row(sent: Sent) -> dict[str, Any]:
    """Times in seconds, and in milliseconds after the one before; words of what was done."""
    asked, admitted = describe(sent.asked), describe(sent.admitted)
    confirmed_ms = None
    if sent.confirmed_ns is not None:
        confirmed_ms = (sent.confirmed_ns - sent.sent_ns) * 1e-6
    notes = [f"admitted: {admitted}"] if admitted != asked else []
    if sent.applied is not None:
        a = sent.applied
        notes.append(
            f"applied: {tuple(a.targets_counts)} counts at {a.speed_mps * 1e3:.0f} mm/s, "
            f"{a.force_n:g} N"
        )
        notes += [] if a.effective else ["without effect"]
        notes += [a.note] if a.note else []
    notes += [f"refused: {sent.refused}"] if sent.refused else []
    return {
        "t": sent.decided_ns * 1e-9,
        "sent_ms": (sent.sent_ns - sent.decided_ns) * 1e-6,
        "confirmed_ms": confirmed_ms,
        "asked": asked,
        "notes": notes,
    }


def _origins(run: RunRecord) -> list[tuple[str, str]]:
    """What ran, where from."""
    verdict, metadata = run.verdict, run.metadata
    versions = [
        (key.removeprefix("version."), text)
        for key, text in sorted(metadata.items())
        if key.startswith("version.")
    ]
    hashes = [("settings' hash", metadata.get("config_hash", ""))]
    if verdict is not None:
        hashes.append(("detector's hash", verdict.detector_hash))
    named = [(name, str(_at(run.settings, name))) for name in NAMED]
    return [
        *((name.replace("_name", "").replace(".name", ""), text) for name, text in named),
        ("seed", metadata.get("seed", "")),
        ("home of the arm, m", metadata.get("home_m", "")),
        *hashes,
        *versions,
    ]


def _at(table: dict[str, Any], key: str) -> Any:
    value: Any = table
    for part in key.split("."):
        value = value[part]
    return value


def _timing(run: RunRecord) -> list[tuple[str, str]]:
    """How the machine that ran it kept up; nothing where the result does not say."""
    if run.verdict is None:
        return []
    timing = run.verdict.timing
    spreads = (
        ("frame to decision", timing.frame_to_decision_us, 1e-3),
        ("decision to acknowledgement", timing.decision_to_ack_us, 1e-3),
        ("age of a frame", timing.frame_age_ms, 1.0),
    )
    counts = (
        ("periods slept through", timing.missed_periods),
        ("periods without a new frame", timing.repeated_frames),
        ("times that the emulated cell stood still", timing.cell_stalls),
    )
    rows = [
        (name, f"{factor * spread.p50:.2f} ms (99 %: {factor * spread.p99:.2f} ms)")
        for name, spread, factor in spreads
        if spread is not None and spread.p50 is not None and spread.p99 is not None
    ]
    return [*rows, *((name, str(count)) for name, count in counts if count)]
