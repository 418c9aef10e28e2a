"""What a page says of a run in sentences."""

import math

from grasp.guard import limit_in_words
from scenarios.report.run_record import RunRecord, Verdict

HEADS = {
    "lift": {
        "held_within_6cm": "Held within 6 cm of the first grasp",
        "held_within_12cm": "Held within 12 cm of the first grasp",
        "held": "Held",
        "beyond_12cm": "Held, but more than 12 cm from the first grasp",
        "dropped": "Dropped",
        "expelled": "Squeezed out of the hand",
        "never_slipped": "Nothing slipped, and nothing was registered",
        "undetected": "Held, but nobody noticed that it slipped",
        "false_start": "Slip was registered although nothing would have slipped",
        "cap_reached": "Still slipping at the force limit, and so set down",
        "alarm_stayed": "Held and still, but slip stayed registered",
        "over_force": "A force went beyond the limit",
        "fault": "Ended in a safe state",
        "interrupted": "Interrupted, and not judged",
        "internal_error": "Ended by an error of the program, and not judged",
    },
    "tap": {
        "registered": "Slip was felt in time, and nominal again when it was over",
        "unmoved_quiet": "The blow moved nothing, and nothing was registered",
        "unmoved_registered": "The blow moved nothing, and slip was registered all the same",
        "undetected": "The blow moved the object, and nobody noticed",
        "late": "Slip was registered too late",
        "alarm_stayed": "Slip stayed registered when it was over",
        "knocked_out": "Knocked out of the hand",
        "never_nominal": "Never struck, for slip stayed registered",
        "over_force": "A force went beyond the limit before the blow",
        "fault": "Ended in a safe state",
        "interrupted": "Interrupted, and not judged",
        "internal_error": "Ended by an error of the program, and not judged",
    },
}
LEAST_TURN_DEG = 0.1


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
    head = HEADS[run.scenario].get(verdict.outcome, verdict.outcome)
    facts = [_moved(run, verdict), _registered(verdict), _paused(verdict), _forces(run, verdict)]
    told = [fact for fact in facts if fact]
    return f"{head}: {_listed(told)}." if told else f"{head}."


def _moved(run: RunRecord, verdict: Verdict) -> str:
    name, turned = run.told.object.name, verdict.turned_rad
    turned_deg = 0.0 if turned is None else abs(math.degrees(turned))
    angle = f"{turned_deg:.1f}°" if turned_deg >= LEAST_TURN_DEG else ""
    if verdict.displacement_m is not None:
        blow = f"a blow ({verdict.direction}) " if verdict.direction else "a blow "
        return f"{blow}moved the {name} {verdict.displacement_m * 1e3:.1f} mm" + (
            f" and turned it {angle}" if angle else ""
        )
    if verdict.slip_distance_m is not None:
        return f"the {name} slid {verdict.slip_distance_m * 1e3:.1f} mm in the hand" + (
            f" and turned {angle}" if angle else ""
        )
    return ""


def _registered(verdict: Verdict) -> str:
    late_ms = verdict.detection_latency_ms
    if late_ms is None:
        return ""
    side = "after" if late_ms >= 0.0 else "before"
    return f"slip was registered {abs(late_ms):.0f} ms {side} it began"


def _paused(verdict: Verdict) -> str:
    return f"the arm stood {verdict.paused_s:.2f} s to answer it" if verdict.paused_s else ""


def _forces(run: RunRecord, verdict: Verdict) -> str:
    limit = limit_in_words(run.told.guard.force_limit_n, run.told.guard.cap_mode)
    if verdict.peak_force_n:
        name, most_n = max(verdict.peak_force_n.items(), key=lambda peak: peak[1])
        return f"finger {name} pressed hardest, {most_n:.1f} N ({limit})"
    if verdict.peak_measured_n:
        name, most_n = max(verdict.peak_measured_n.items(), key=lambda peak: peak[1])
        return f"the fingertips felt {most_n:.1f} N at most, at finger {name} ({limit})"
    return ""


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])}, and {parts[-1]}"


def remarks(run: RunRecord) -> list[str]:
    """What a reader must know before believing the page."""
    told = []
    if not run.complete:
        told.append(
            f"The recording was cut off at {run.t_s[-1]:.2f} s: its writer ended before the run. "
            "What there is of it is shown."
        )
    if run.verdict_problem:
        told.append(run.verdict_problem)
    if run.verdict is not None:
        told += _endings(run.verdict)
    if run.truth is None:
        told.append(
            "Nobody knows true forces, slip and height on this rig, so they are left out: forces "
            "are as the fingertips felt them."
        )
    return told


def _endings(verdict: Verdict) -> list[str]:
    told = []
    if verdict.bug is not None:
        told.append(f"Error of the program: {verdict.bug.name}: {verdict.bug.text}.")
    if verdict.end is not None:
        told.append(f"It ended in a safe state: {verdict.end.arm}; {verdict.end.hand}.")
        if verdict.end.unreached:
            told.append(f"Of that this was not seen: {', '.join(verdict.end.unreached)}.")
    return told
