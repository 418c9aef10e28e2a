"""What a page says of a run in sentences."""

import math

from grasp.guard import limit_in_words
from scenarios.report.run_record import RunRecord, Verdict
from scenarios.tap.scoring import TapResult

HEADS = {
    "lift": {
        "held_within_6cm": "Held within 6 cm of the first grasp",
        "held_within_12cm": "Held within 12 cm of the first grasp",
        "held": "Held",
        "beyond_12cm": "Held, but more than 12 cm from the first grasp",
        "dropped": "Dropped",
        "expelled": "Squeezed out of the hand",
        "never_slipped": "Nothing slipped, and nothing was registered",
        "undetected": "Held, but its slip was not registered",
        "false_start": "Slip was registered although nothing would have slipped",
        "cap_reached": "Still slipping at the force limit, and so set down",
        "alarm_stayed": "Held and still, but slip stayed registered",
        "over_force": "A force exceeded the limit",
    },
    "tap": {
        "registered": "Slip was registered in time, and no more when it was over",
        "unmoved_quiet": "The tap moved nothing, and nothing was registered",
        "unmoved_registered": "The tap moved nothing, and slip was registered all the same",
        "undetected": "The tap moved the object, and slip was not registered",
        "late": "Slip was registered too late",
        "alarm_stayed": "Slip stayed registered when it was over",
        "knocked_out": "Knocked out of the hand",
        "never_nominal": "Never struck, for slip stayed registered",
        "over_force": "A force exceeded the limit before the tap",
    },
}
FOR_BOTH = {
    "fault": "Ended in a safe state",
    "interrupted": "Interrupted, and not judged",
    "internal_error": "Ended by an error of the program, and not judged",
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
    head = (HEADS[run.scenario] | FOR_BOTH).get(verdict.outcome, verdict.outcome)
    facts = list(filter(None, [_moved(verdict), _registered(verdict), _paused(verdict),
                               _forces(verdict)]))  # fmt: skip
    if not facts:
        return f"{head}."
    *first, last = facts
    return f"{head}: {', '.join(first)}{', and ' if first else ''}{last}."


def _moved(verdict: Verdict) -> str:
    turned_deg = abs(math.degrees(verdict.turned_rad or 0.0))
    angle = f"{turned_deg:.1f}°" if turned_deg >= LEAST_TURN_DEG else ""
    if isinstance(verdict, TapResult):
        if verdict.displacement_m is None:
            return ""
        turned = f" and turned it {angle}" if angle else ""
        moved = f"moved the {verdict.object} {verdict.displacement_m * 1e3:.1f} mm"
        return f"a tap ({verdict.direction}) {moved}{turned}"
    if verdict.slip_distance_m is None:
        return ""
    turned = f" and turned {angle}" if angle else ""
    return f"the {verdict.object} slid {verdict.slip_distance_m * 1e3:.1f} mm in the hand{turned}"


def _registered(verdict: Verdict) -> str:
    late_ms = verdict.detection_latency_ms
    if late_ms is None:
        return ""
    side = "after" if late_ms >= 0.0 else "before"
    return f"slip was registered {abs(late_ms):.0f} ms {side} it began"


def _paused(verdict: Verdict) -> str:
    return f"the arm stood {verdict.paused_s:.2f} s to answer it" if verdict.paused_s else ""


def _forces(verdict: Verdict) -> str:
    peaks_n = verdict.peak_force_n or verdict.peak_measured_n
    if not peaks_n:
        return ""
    limit = limit_in_words(verdict.force_limit_n, verdict.cap_mode)
    name, most_n = max(peaks_n.items(), key=lambda peak: peak[1])
    if verdict.peak_force_n:
        return f"finger {name} pressed hardest, {most_n:.1f} N ({limit})"
    return f"the fingertips felt {most_n:.1f} N at most, at finger {name} ({limit})"


def remarks(run: RunRecord) -> list[str]:
    """What a reader must know before believing the page."""
    told, verdict = [], run.verdict
    if not run.complete:
        told.append(
            f"The recording was cut off at {run.t_s[-1]:.2f} s: its writer ended before the run. "
            "What there is of it is shown."
        )
    if run.verdict_problem:
        told.append(run.verdict_problem)
    if verdict is not None and verdict.bug is not None:
        told.append(f"Error of the program: {verdict.bug.name}: {verdict.bug.text}.")
    if verdict is not None and verdict.end is not None:
        told.append(f"It ended in a safe state: {verdict.end.arm}; {verdict.end.hand}.")
        if verdict.end.unreached:
            told.append(f"Of that this was not seen: {', '.join(verdict.end.unreached)}.")
    if run.truth is None:
        told.append(
            "True forces, slip and height are not known on this rig, so they are left out: forces "
            "are as the fingertips felt them."
        )
    return told
