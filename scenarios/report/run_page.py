"""The page of one run: `grasp report RUN`."""

import base64
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import FINGER_NAMES
from grasp.control.commands import describe
from grasp.control.fault import lines
from grasp.control.states import State
from scenarios.campaign.config import UNNAMED
from scenarios.report.page import Cell, Table, cells, render
from scenarios.report.run_record import RunRecord, Sent, Verdict, read_run
from scenarios.report.run_settings import Setting, command_of, object_file, settings_of
from scenarios.report.run_view import PHASE_NAMES, Bound, View, bound_of, decided, facts, page_data
from scenarios.trial.result import spelt
from scenarios.trial.run_folder import RECORDING, find_recording

Floats = NDArray[np.float64]


def pack(columns: Mapping[str, Floats]) -> dict[str, Any]:
    """Pack columns (n,) or (n, width) of equal length as deflated 32-bit floats, for `unpack()` of
    `page/data.js`."""
    flat = {name: values.reshape(len(values), -1).astype("<f4") for name, values in columns.items()}
    content = b"".join(values.T.tobytes() for values in flat.values())
    return {
        "rows": len(next(iter(flat.values()))),
        "columns": [[name, values.shape[1]] for name, values in flat.items()],
        "deflated": base64.b64encode(zlib.compress(content, 9)).decode(),
    }


PAGE = "report.html"
SCRIPTS = (
    "uplot/uPlot.iife.min.js", "data.js", "run_scene.js", "run_plots.js", "run.js",
    "finished_run.js",
)  # fmt: skip
LEAD_S = 0.15  # from the first shown instant to registered slip


def page_path(run: Path) -> Path:
    """Default path of a run's page: beside its recording."""
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
        figures="" if run.verdict is None else "; ".join(facts(run.verdict)),
        fingers=FINGER_NAMES,
        view=View(*known, config.guard.force_limit_n, rule, evidence=not rule.probable),
        phases=_phase_table(run), commands=_command_table(run),
        changed_settings=_settings_table(s for s in settings if s.changed),
        compared=any(setting.default is not None for setting in settings),
        other_settings=_settings_table(s for s in settings if not s.changed),
        origins=_origins(run), command=command_of(run.settings, run.seed),
        object_file=object_file(run.settings), data=_data(run, rule),
    )  # fmt: skip


def _data(run: RunRecord, rule: Bound) -> dict[str, Any]:
    """Input of the page's scripts."""
    marks = _marks(run)
    lift_m, top_m = float(run.arm_m[_lift_step(run), 2]), _top_m(run)
    return page_data(
        run.config, rule, run.counts.shape[2], lift_m if np.isfinite(lift_m) else 0.0, top_m
    ) | {
        "series": pack(_columns(run, rule)),
        "phases": [{"t": c.t_ns * 1e-9, "name": c.phase} for c in run.phases],
        "marks": marks,
        "start": _start_s(run, marks),
    }


def _columns(run: RunRecord, rule: Bound) -> dict[str, Floats]:
    values = decided(run.config.rule, run.probabilities, run.armed, run.masked)
    status = run.armed * 1.0 + run.masked * 2.0 + run.registered * 4.0
    columns = {
        "t": run.t_s, "probability": run.known(run.probabilities),
        "estimated": run.known(run.estimated_n), "counts": run.counts,
        "positions": run.fingers_counts, "arm": run.arm_m[:, 2],
        "status": status,
    }  # fmt: skip
    if values.shape != run.probabilities.shape or not rule.probable:
        columns["decided"] = values
    if (motion := run.motion) is not None:
        columns |= {
            "reported_speed": motion.speed_mps, "reported_direction": motion.direction_deg,
            "reported_turning": motion.turning,
        }  # fmt: skip
    if (truth := run.truth) is not None:
        columns |= {
            "true": truth.normal_n, "shear": truth.shear_n, "height": truth.height_m,
            "slip": truth.slip_m, "slip_speed": truth.slip_mps, "across": truth.across_m,
            "turn": truth.turn_rad,
        }  # fmt: skip
    return columns


def _marks(run: RunRecord) -> list[dict[str, Any]]:
    """Named instants: from the verdict, otherwise from the simulated truth or the recording."""
    verdict, truth = run.verdict, run.truth
    registered = np.flatnonzero(run.registered)
    found = (
        ("impact", "tap", None if truth is None else truth.impact_s),
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
    """The instant that the page shows first and prints: just before slip was registered, otherwise
    before it began, before the tap, or when the lift started."""
    times = {mark["kind"]: mark["t"] - LEAD_S for mark in marks}
    first = next((times[k] for k in ("registered", "onset", "impact") if k in times), None)
    return float(run.t_s[_lift_step(run)]) if first is None else max(first, float(run.t_s[0]))


def _lift_step(run: RunRecord) -> int:
    """Index of the sample at which the lift starts; 0 without a lift."""
    lift_s = [change.t_ns * 1e-9 for change in run.phases if change.phase == State.LIFT]
    first = int(np.searchsorted(run.t_s, lift_s[0])) if lift_s else 0
    return min(first, len(run.t_s) - 1)


def _top_m(run: RunRecord) -> float:
    """Greatest recorded height of the arm, m; 0 without one."""
    known = run.arm_m[:, 2][np.isfinite(run.arm_m[:, 2])]
    return float(known.max()) if len(known) else 0.0


def _phase_table(run: RunRecord) -> Table:
    begins = [change.t_ns * 1e-9 for change in run.phases]
    ends = [*begins[1:], float(run.t_s[-1])]
    rows = [
        [Cell(at_s=t), Cell(PHASE_NAMES.get(change.phase, change.phase), change.phase),
         *cells(f"{max(0.0, end - t):.2f}", change.cause)]
        for change, t, end in zip(run.phases, begins, ends, strict=True)
    ]  # fmt: skip
    return Table(("s", "phase", "lasted, s", "cause"), rows)


def _command_table(run: RunRecord) -> Table:
    headings = ("decided, s", "sent, ms later", "acknowledged, ms later", "command")
    hint = (
        "Acknowledged: by the first status, recorded at 100 Hz, that follows the command. Commands "
        "to the arm are not acknowledged."
    )
    return Table(headings, [_command_row(sent) for sent in run.commands], hint)


def _command_row(sent: Sent) -> list[Cell]:
    """A command with its time, its delays, and notes on what the guard and driver changed."""
    m = sent.message
    requested, admitted = describe(m.requested), describe(m.admitted)
    confirmed = ""
    if sent.confirmed_ns is not None:
        confirmed = f"{(sent.confirmed_ns - sent.sent_ns) * 1e-6:.1f}"
    notes = [f"admitted: {admitted}"] if admitted != requested else []
    if (a := m.applied) is not None:
        notes.append(
            f"applied: {tuple(a.targets_counts)} counts at {a.speed_mps * 1e3:.0f} mm/s, "
            f"{a.force_n:g} N"
        )
        notes += [] if a.effective else ["without effect"]
        notes += [a.note] if a.note else []
    notes += [f"refused: {m.refused}"] if m.refused else []
    delay_ms = f"{(sent.sent_ns - m.decided_ns) * 1e-6:.2f}"
    return [Cell(at_s=m.decided_ns * 1e-9), *cells(delay_ms, confirmed),
            Cell(requested, "; ".join(notes))]  # fmt: skip


def _settings_table(settings: Iterable[Setting]) -> Table:
    rows = [cells(s.key, s.value, s.default or "" if s.changed else "") for s in settings]
    return Table(("setting", "here", "default"), rows)


def _origins(run: RunRecord) -> Table:
    """Configuration, versions and timing of the run."""
    verdict, metadata, config = run.verdict, run.metadata, run.config
    rows = [
        ("rig", config.rig), ("profile", config.profile), ("detector", config.detector_name),
        ("object", config.object.name), ("seed", metadata.get("seed", "")),
        ("home of the arm, m", metadata.get("home_m", "")),
        ("hash of settings", metadata.get("config_hash", "")),
        ("hash of detector", "" if verdict is None else verdict.detector_hash),
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
            ("missed periods", timing.missed_periods),
            ("periods without a new frame", timing.repeated_frames),
            ("stalls of the emulated cell", timing.cell_stalls),
        ):
            rows.append((name, str(count or "")))
    return Table((), [cells(name, text) for name, text in rows if text])


# The verdict in sentences

HEADS = {
    "held_within_6cm": "The {it} was lifted and held",
    "held_within_12cm": "The {it} was lifted and held, after a slide of 6 to 12 cm",
    "held": "The {it} was lifted and held",
    "beyond_12cm": "The {it} was held only after a slide of more than 12 cm",
    "turned": "The {it} was held, but turned by more than 20 degrees in the hand",
    "crushed": "The {it} was held, with more force than it bears",
    "dropped": "The {it} was dropped",
    "expelled": "The {it} was squeezed out of the hand",
    "never_slipped": "The {it} did not slip, so there was no slip to respond to",
    "undetected": "The {it} slipped, but the slip was not registered",
    "false_start": "The hand responded to a slip of the {it} that did not happen",
    "limit_reached": "The {it} slipped on when the hand could close no further, so it was set down",
    "alarm_stayed": "The {it} was held, but slip stayed registered after it had stopped",
    "over_force": "A force on the {it} exceeded the limit",
    "registered": "The tap moved the {it}, and its slip was registered in time",
    "unmoved_quiet": "The tap did not move the {it}, and no slip was registered",
    "unmoved_registered": "The tap did not move the {it}, but slip was registered",
    "late": "The tap moved the {it}, but its slip was registered too late",
    "knocked_out": "The tap knocked the {it} out of the hand",
    "never_nominal": "There was no tap, because slip stayed registered",
    "fault": "A fault ended the run of the {it} in a safe state",
    "interrupted": "The run of the {it} was interrupted, without a verdict",
    "internal_error": "An internal error ended the run of the {it}, without a verdict",
}


def badge(verdict: Verdict | None) -> str:
    """The verdict in one or two words."""
    if verdict is None:
        return "no verdict"
    return {True: "success", False: "failed", None: "no verdict"}[verdict.success]


def sentence(run: RunRecord) -> str:
    """What happened, for a reader who knows neither the run nor the names of its settings."""
    verdict = run.verdict
    if verdict is None:
        return "No verdict: the run has no readable result."
    head = HEADS.get(verdict.outcome, spelt(verdict.outcome).capitalize())
    name = "object" if verdict.object == UNNAMED else verdict.object.replace("_", " ")
    texts = [head.format(it=name)]
    if (rise_mm := 1e3 * (_top_m(run) - run.arm_m[_lift_step(run), 2])) >= 1.0:
        texts[0] = texts[0].replace(" lifted", f" lifted {rise_mm:.0f} mm")
    onset_s, late_ms = verdict.slip_onset_s, verdict.detection_latency_ms
    if onset_s is not None:
        texts.append(f"It began to slip at {onset_s:.2f} s")
    elif verdict.slip_registered_s is not None:
        texts.append(f"Slip was registered at {verdict.slip_registered_s:.2f} s")
    if onset_s is not None and late_ms is not None:
        texts[-1] += f"; the hand registered it {abs(late_ms):.0f} ms "
        texts[-1] += "earlier" if late_ms < 0.0 else "later"
        rise_ms = getattr(verdict, "reaction_latency_ms", None)
        if rise_ms is not None and rise_ms >= late_ms:
            texts[-1] += f" and gripped tighter {rise_ms - late_ms:.0f} ms after that"
    if onset_s is not None and verdict.slip_distance_m is not None:
        texts[-1] += f". In all it slipped {verdict.slip_distance_m * 1e3:.1f} mm"
    if peaks_n := verdict.peak_force_n or verdict.peak_estimated_n:
        known = "" if verdict.peak_force_n else " estimated"
        each = "per finger" if verdict.limit_mode == "every_finger" else "per motor"
        texts.append(
            f"Largest{known} force on a finger: {max(peaks_n.values()):.1f} N; commanded: "
            f"{verdict.commanded_force_n:.1f} N of {verdict.force_limit_n:g} N allowed {each}"
        )
        if verdict.commanded_force_n > verdict.force_limit_n:
            texts[-1] += ", the least of this hand, so that position bounds the force"
    return ". ".join(texts) + "."


def remarks(run: RunRecord) -> list[str]:
    """Limitations of the recording and problems of the run, one sentence each."""
    texts, verdict = [], run.verdict
    if not run.complete:
        texts.append(f"The recording was cut off at {run.t_s[-1]:.2f} s.")
    if run.verdict_problem:
        texts.append(run.verdict_problem)
    if verdict is not None and verdict.bug is not None:
        texts.append(f"Internal error: {verdict.bug.name}: {verdict.bug.text}.")
    if verdict is not None and verdict.reported:
        texts.append(f"Checks that failed without a stop: {lines(verdict.reported)}.")
    if verdict is not None and verdict.end is not None:
        texts.append(f"It ended in a safe state: {verdict.end.arm}; {verdict.end.hand}.")
        if verdict.end.unconfirmed:
            texts.append(f"Not confirmed: {', '.join(verdict.end.unconfirmed)}.")
    if run.truth is None:
        texts.append("True forces, height and the moment of slip are not known on this rig.")
    return texts
