"""The page of one run: `grasp report RUN`."""

import base64
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGER_NAMES
from grasp.commands import describe
from grasp.states import State
from scenarios.report.page import render
from scenarios.report.run_record import RunRecord, Sent, read_run
from scenarios.report.run_settings import command_of, object_file, settings_of
from scenarios.report.run_text import badge, remarks, sentence
from scenarios.report.run_view import Decided, View, decided, scene
from scenarios.trial.foxglove import taxel_places
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


PAGE = "report.html"
SCRIPTS = (
    "uplot/uPlot.iife.min.js", "data.js", "run_scene.js", "run_plots.js", "run.js", "whole.js",
)  # fmt: skip
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
    config = run.config
    by_rule = decided(config.rule, run.probabilities, run.armed, run.masked)
    settings = settings_of(run.settings)
    limit_n = config.guard.force_limit_n
    known = run.truth is not None, run.motion is not None
    return render(
        "run.html", SCRIPTS,
        title=f"{run.scenario} · {config.object.name} · seed {run.metadata.get('seed', '?')}",
        badge=badge(run.verdict), sentence=sentence(run), remarks=remarks(run), run=run,
        fingers=FINGER_NAMES,
        view=View(*known, limit_n, by_rule, evidence=not by_rule.probable),
        phases=_phase_rows(run), commands=[_command_row(sent) for sent in run.commands],
        own_settings=[setting for setting in settings if setting.own],
        compared=any(setting.usual is not None for setting in settings),
        other_settings=[setting for setting in settings if not setting.own],
        origins=_origins(run), command=command_of(run.settings, run.seed),
        object_file=object_file(run.settings), data=_data(run, by_rule),
    )  # fmt: skip


def _data(run: RunRecord, by_rule: Decided) -> dict[str, Any]:
    """What the scripts of the page are given."""
    marks = _marks(run)
    return {
        "series": pack(_columns(run, by_rule)),
        "fingers": FINGER_NAMES,
        "taxels": taxel_places(run.config.fingertip.taxels_mm, run.counts.shape[2]),
        "limit_n": run.config.guard.force_limit_n,
        "rule": {"limit": by_rule.limit, "probable": by_rule.probable, "label": by_rule.label},
        "phases": [{"t": c.t_ns * 1e-9, "name": c.phase} for c in run.phases],
        "marks": marks,
        "start": _start_s(run, marks),
        "scene": _scene(run),
    }


def _columns(run: RunRecord, by_rule: Decided) -> dict[str, Column]:
    status = run.armed * 1.0 + run.masked * 2.0 + run.registered * 4.0
    columns = {
        "t": Column(run.t_s, TIME_S),
        "probability": Column(run.known(run.probabilities), PROBABILITY),
        "felt": Column(run.known(run.felt_n), FORCE_N),
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


def _marks(run: RunRecord) -> list[dict[str, Any]]:
    """Instants that plots name: of the verdict, else of the world and the recording."""
    verdict, truth = run.verdict, run.truth
    registered = np.flatnonzero(run.registered)
    found = (
        ("struck", "tap", None if truth is None else truth.struck_s),
        ("slip_onset", "slip begins", None if truth is None else truth.onset_s),
        ("slip_registered", "slip registered",
         float(run.t_s[registered[0]]) if len(registered) else None),
    )  # fmt: skip
    judged = ((k, name, getattr(verdict, f"{k}_s", None) or t) for k, name, t in found)
    return [
        {"kind": kind.removeprefix("slip_"), "name": name, "t": t}
        for kind, name, t in judged
        if t is not None
    ]


def _start_s(run: RunRecord, marks: list[dict[str, Any]]) -> float:
    """The instant that the page shows first, and prints: just after slip was registered, or the
    middle of the run."""
    times = {mark["kind"]: mark["t"] for mark in marks}
    first = times.get("registered", times.get("onset", times.get("struck")))
    return float(run.t_s[len(run.t_s) // 2]) if first is None else first + LEAD_S


def _scene(run: RunRecord) -> dict[str, Any]:
    """Of the side view. Heights count from where the arm was when the lift began."""
    height_m = run.arm_m[:, 2]
    begun_ns = [change.t_ns for change in run.phases if change.phase == State.LIFT][:1]
    first = int(np.searchsorted(run.t_s, begun_ns[0] * 1e-9)) if begun_ns else 0
    grip_m = float(height_m[min(first, len(height_m) - 1)])
    known = height_m[np.isfinite(height_m)]
    return scene(
        run.config,
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
    """What ran, where from, and how the machine that ran it kept up."""
    verdict, metadata, config = run.verdict, run.metadata, run.config
    rows = [
        ("rig", config.rig),
        ("profile", config.profile),
        ("detector", config.detector_name),
        ("object", config.object.name),
        ("seed", metadata.get("seed", "")),
        ("home of the arm, m", metadata.get("home_m", "")),
        ("settings' hash", metadata.get("config_hash", "")),
        ("detector's hash", "" if verdict is None else verdict.detector_hash),
    ]
    for key, text in sorted(metadata.items()):
        if key.startswith("version."):
            rows.append((key.removeprefix("version."), text))
    if verdict is not None:
        timing = verdict.timing
        for name, spread, factor in (
            ("frame to decision", timing.frame_to_decision_us, 1e-3),
            ("decision to acknowledgement", timing.decision_to_ack_us, 1e-3),
            ("age of a frame", timing.frame_age_ms, 1.0),
        ):
            if spread is not None:
                p50, p99 = factor * spread.p50, factor * spread.p99
                rows.append((name, f"{p50:.2f} ms (99 %: {p99:.2f} ms)"))
        for name, count in (
            ("periods slept through", timing.missed_periods),
            ("periods without a new frame", timing.repeated_frames),
            ("times that the emulated cell stood still", timing.cell_stalls),
        ):
            rows.append((name, str(count or "")))
    return [(name, text) for name, text in rows if text]
