"""The page of one run: `grasp report RUN`."""

import base64
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGER_NAMES
from grasp.commands import describe
from grasp.fault import lines
from grasp.states import State
from scenarios.report.page import render
from scenarios.report.run_record import RunRecord, Sent, Verdict, read_run
from scenarios.report.run_settings import command_of, object_file, settings_of
from scenarios.report.run_view import Bound, View, bound_of, decided, facts, scene
from scenarios.trial.foxglove import taxel_places
from scenarios.trial.result import spelt
from scenarios.trial.run_folder import RECORDING, find_recording

Floats = NDArray[np.float64]


def pack(columns: Mapping[str, Floats]) -> dict[str, Any]:
    """What `unpack()` of `page/data.js` takes: (n,) or (n, width) columns, equally long, as 32-bit
    floats, one after the other, deflated."""
    flat = {name: values.reshape(len(values), -1).astype("<f4") for name, values in columns.items()}
    content = b"".join(values.T.tobytes() for values in flat.values())
    return {
        "rows": len(next(iter(flat.values()))),
        "columns": [[name, values.shape[1]] for name, values in flat.items()],
        "deflated": base64.b64encode(zlib.compress(content, 9)).decode(),
    }


PAGE = "report.html"
SCRIPTS = (
    "uplot/uPlot.iife.min.js", "data.js", "run_scene.js", "run_plots.js", "run.js", "whole.js",
)  # fmt: skip
LEAD_S = 0.15  # the page begins so long after slip was registered: the fingers have closed


def page_path(run: Path) -> Path:
    """Where the page of a run goes when nobody says: beside its recording."""
    recording = find_recording(run)
    return recording.with_name(PAGE if recording.name == RECORDING else f"{recording.stem}.html")


def run_page(path: Path) -> str:
    """The page of a run folder or recording; raises BadFile as ``read_run``."""
    run = read_run(path)
    config = run.config
    rule = bound_of(config.rule)
    settings = settings_of(run.settings)
    known = run.truth is not None, run.motion is not None
    return render(
        "run.html", SCRIPTS,
        title=f"{run.scenario} · {config.object.name} · seed {run.metadata.get('seed', '?')}",
        badge=badge(run.verdict), sentence=sentence(run), remarks=remarks(run), run=run,
        fingers=FINGER_NAMES,
        view=View(*known, config.guard.force_limit_n, rule, evidence=not rule.probable),
        phases=_phase_rows(run), commands=[_command_row(sent) for sent in run.commands],
        own_settings=[setting for setting in settings if setting.own],
        compared=any(setting.usual is not None for setting in settings),
        other_settings=[setting for setting in settings if not setting.own],
        origins=_origins(run), command=command_of(run.settings, run.seed),
        object_file=object_file(run.settings), data=_data(run, rule),
    )  # fmt: skip


def _data(run: RunRecord, rule: Bound) -> dict[str, Any]:
    """What the scripts of the page are given."""
    marks = _marks(run)
    return {
        "series": pack(_columns(run, rule)),
        "fingers": FINGER_NAMES,
        "taxels": taxel_places(run.config.fingertip.taxels_mm, run.counts.shape[2]),
        "limit_n": run.config.guard.force_limit_n,
        "rule": {"limit": rule.limit, "probable": rule.probable, "label": rule.label},
        "phases": [{"t": c.t_ns * 1e-9, "name": c.phase} for c in run.phases],
        "marks": marks,
        "start": _start_s(run, marks),
        "scene": _scene(run),
    }


def _columns(run: RunRecord, rule: Bound) -> dict[str, Floats]:
    values = decided(run.config.rule, run.probabilities, run.armed, run.masked)
    status = run.armed * 1.0 + run.masked * 2.0 + run.registered * 4.0
    columns = {
        "t": run.t_s, "probability": run.known(run.probabilities), "felt": run.known(run.felt_n),
        "counts": run.counts, "positions": run.fingers_counts, "arm": run.arm_m[:, 2],
        "status": status,
    }  # fmt: skip
    if values.shape != run.probabilities.shape or not rule.probable:
        columns["decided"] = values
    if (motion := run.motion) is not None:
        columns |= {
            "told_speed": motion.speed_mps, "told_way": motion.direction_deg,
            "told_turning": motion.turning,
        }  # fmt: skip
    if (truth := run.truth) is not None:
        columns |= {
            "true": truth.normal_n, "shear": truth.shear_n, "height": truth.height_m,
            "slip": truth.slip_m, "slip_speed": truth.slip_mps, "across": truth.across_m,
            "turn": truth.turn_rad,
        }  # fmt: skip
    return columns


def _marks(run: RunRecord) -> list[dict[str, Any]]:
    """Instants that plots name: of the verdict, else of the world and the recording."""
    verdict, truth = run.verdict, run.truth
    registered = np.flatnonzero(run.registered)
    found = (
        ("struck", "tap", None if truth is None else truth.impact_s),
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
    top_m = float(known.max()) if len(known) else 0.0
    return scene(run.config, grip_m if np.isfinite(grip_m) else 0.0, top_m)


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
        "t": sent.decided_ns * 1e-9, "sent_ms": (sent.sent_ns - sent.decided_ns) * 1e-6,
        "confirmed_ms": confirmed_ms, "asked": asked, "notes": notes,
    }  # fmt: skip


def _origins(run: RunRecord) -> list[tuple[str, str]]:
    """What ran, where from, and how the machine that ran it kept up."""
    verdict, metadata, config = run.verdict, run.metadata, run.config
    rows = [
        ("rig", config.rig), ("profile", config.profile), ("detector", config.detector_name),
        ("object", config.object.name), ("seed", metadata.get("seed", "")),
        ("home of the arm, m", metadata.get("home_m", "")),
        ("settings' hash", metadata.get("config_hash", "")),
        ("detector's hash", "" if verdict is None else verdict.detector_hash),
    ]  # fmt: skip
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


# The verdict in sentences

# of outcomes whose word says too little
HEADS = {
    "expelled": "Squeezed out of the hand",
    "never_slipped": "Nothing slipped, and nothing was registered",
    "undetected": "Its slip was not registered",
    "false_start": "Slip was registered although nothing would have slipped",
    "cap_reached": "Still slipping at the force limit, and so set down",
    "alarm_stayed": "Slip stayed registered after its end",
    "over_force": "A force exceeded the limit",
    "registered": "Slip was registered in time, and no more when it was over",
    "unmoved_quiet": "The tap moved nothing, and nothing was registered",
    "unmoved_registered": "The tap moved nothing, but slip was registered",
    "late": "Slip was registered too late",
    "never_nominal": "Never struck, because slip stayed registered",
    "fault": "Ended in a safe state",
    "interrupted": "Interrupted, and not judged",
    "internal_error": "Ended by an error of the program, and not judged",
}


def badge(verdict: Verdict | None) -> str:
    """The verdict in a word or two."""
    if verdict is None:
        return "no verdict"
    return {True: "success", False: "failed", None: "not judged"}[verdict.success]


def sentence(run: RunRecord) -> str:
    """The verdict, with the figures that it was drawn from."""
    verdict = run.verdict
    if verdict is None:
        return "There is no verdict: the run left no result that can be read."
    head = HEADS.get(verdict.outcome) or spelt(verdict.outcome).capitalize()
    return f"{head}: {'; '.join(facts(verdict))}."


def remarks(run: RunRecord) -> list[str]:
    """What a reader must know before believing the page."""
    told, verdict = [], run.verdict
    if not run.complete:
        told.append(f"The recording was cut off at {run.t_s[-1]:.2f} s.")
    if run.verdict_problem:
        told.append(run.verdict_problem)
    if verdict is not None and verdict.bug is not None:
        told.append(f"Error of the program: {verdict.bug.name}: {verdict.bug.text}.")
    if verdict is not None and verdict.reported:
        told.append(
            f"Checks that failed and, in report mode, stopped nothing: {lines(verdict.reported)}."
        )
    if verdict is not None and verdict.end is not None:
        told.append(f"It ended in a safe state: {verdict.end.arm}; {verdict.end.hand}.")
        if verdict.end.unconfirmed:
            told.append(f"Of that this was not seen: {', '.join(verdict.end.unconfirmed)}.")
    if run.truth is None:
        told.append("True forces, slip and height are not known on this rig.")
    return told
