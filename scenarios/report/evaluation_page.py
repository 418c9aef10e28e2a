"""The page of an evaluation: `grasp report FILE.json`."""

import math
from collections.abc import Sequence
from pathlib import Path

import msgspec

from detector.decision import RuleSettings
from scenarios.benchmark.evaluation_file import (
    AFTER_S,
    BEFORE_S,
    DetectorEvaluation,
    SlipTrace,
    no_evaluation,
    read_evaluation,
)
from scenarios.report.page import Axis, Cell, Curve, Plot, Section, Table, cells, table_page
from scenarios.report.run_view import in_words

HEADINGS = (
    "detector", "AUC", "accuracy", "calibration error", "slips detected",
    "false alarms per minute (hand)", "delay, ms", "slip by then, mm", "one update, µs",
)  # fmt: skip
Ends = tuple[float | None, float | None]


class Spread(msgspec.Struct, frozen=True):
    """Quantiles of a score sheet; None: infinite."""

    p50: float | None = None
    p90: float | None = None
    p99: float | None = None


class Sheet(msgspec.Struct, frozen=True):
    """The values of an evaluation's score sheet that the page shows."""

    n_samples: int
    accuracy: float
    ece: float
    true_events: int
    missed_events: int
    false_events: int
    auc: float | None = None
    false_events_per_min_hand: float | None = None
    delay_ms: Spread = Spread()
    delay_mm: Spread | None = None
    compute_us: Spread | None = None
    intervals: dict[str, Ends] = {}
    detector_hash: str = ""


Scored = tuple[DetectorEvaluation, Sheet]


def evaluation_page(file: Path) -> str:
    """The page of an evaluation's file; raises BadFile as ``read_evaluation``."""
    evaluation = read_evaluation(file)
    try:
        every = [(each, msgspec.convert(each.sheet, Sheet)) for each in evaluation.detectors]
    except msgspec.ValidationError as error:
        raise no_evaluation(file, error) from None
    hashes = (f"{each.detector} {sheet.detector_hash}" for each, sheet in every)
    scores = Table(
        HEADINGS, [_row(each, sheet) for each, sheet in every],
        "Accuracy and calibration: of samples at the detector's threshold. Slips and delays: of "
        "its decision rule. Delay, distance and cost: 50, 90 and 99 % quantiles; –: infinite. "
        "Small: 95 % intervals.",
    )  # fmt: skip
    worst = [
        Section(f"Worst misses of {each.detector}: {_missed(trace)}", (),
                _plots(trace, each.rule))
        for each, _ in every for trace in each.worst
    ]  # fmt: skip
    again = Section("Run it again",
        hint=f"Hashes of weights or formula, and rule: {', '.join(hashes)}. "
        "Shaded above: labelled slip. Pressure: sum of a fingertip's taxels minus its mean "
        "before slip.", code=evaluation.command)  # fmt: skip
    versions = ", ".join(f"{name} {text}" for name, text in sorted(evaluation.versions.items()))
    sections = [Section("Scores", [scores], _speed_plots(every)), *worst, again]
    return table_page(
        f"evaluation on {evaluation.data}",
        f"label {evaluation.label} · {every[0][1].n_samples} samples",
        _sentence(every), sections, origins=[versions],
    )  # fmt: skip


def _row(each: DetectorEvaluation, s: Sheet) -> list[Cell]:
    def between(name: str) -> str:
        low, high = s.intervals.get(name, (None, None))
        return f"{_number(low)} to {_number(high)}" if name in s.intervals else ""

    return [
        Cell(each.detector, in_words(each.rule)),
        Cell(_number(s.auc), between("auc")),
        Cell(_number(s.accuracy), between("accuracy")),
        Cell(_number(s.ece)),
        Cell(f"{s.true_events - s.missed_events} of {s.true_events}"),
        Cell(_number(s.false_events_per_min_hand, "{:.2f}"), f"{s.false_events} in all"),
        *cells(_three(s.delay_ms), _three(s.delay_mm, "{:.1f}"), _three(s.compute_us)),
    ]


def _three(spread: Spread | None, form: str = "{:.0f}") -> str:
    known = () if spread is None else (spread.p50, spread.p90, spread.p99)
    return " / ".join(_number(value, form) for value in known)


def _number(value: float | None, form: str = "{:.3f}") -> str:
    return "–" if value is None or math.isinf(value) else form.format(value)


def _sentence(every: Sequence[Scored]) -> str:
    """Number of slips, and the best detectors by AUC and by detected slips."""
    slips = max(sheet.true_events for _, sheet in every)
    text = f"{slips} slips: "
    ranked = [(sheet.auc, each.detector) for each, sheet in every if sheet.auc is not None]
    if ranked:
        auc, name = max(ranked)
        text += f"{name} has the highest AUC ({auc:.3f}); "
    each, sheet = min(every, key=lambda pair: pair[1].missed_events)
    detected = sheet.true_events - sheet.missed_events
    return f"{text}{each.detector} detected most slips, {detected} of {sheet.true_events}."


def _speed_plots(every: Sequence[Scored]) -> list[Plot]:
    """Delay over false alarms for all thresholds, and accuracy over the cost of an update.

    The dot is the detector's own rule. A detector that misses half of the slips has no median
    delay."""
    delays, costs = [], []
    for each, s in every:
        known = [(c.false_per_min, c.delay_ms) for c in each.choices if c.delay_ms is not None]
        rate, delay_ms = s.false_events_per_min_hand, s.delay_ms.p50
        dot = None if rate is None or delay_ms is None else (rate, delay_ms)
        delays.append(Curve(each.detector, [(at, ms) for at, ms in known], dot=dot))
        if s.compute_us is not None and s.compute_us.p50 is not None:
            costs.append(Curve(each.detector, (), dot=(s.compute_us.p50, 100 * s.accuracy)))
    slowest_ms = max([100.0, *(ms for curve in delays for _, ms in curve.points)])
    rates = Axis("false alarms per minute of three fingers", 0.1, 1000.0, log=True)
    cost = Axis("one update, µs (median)", 10.0, 1000.0, log=True)
    return [
        Plot("Delay", rates, Axis("median delay, ms", 0.0, slowest_ms), delays),
        Plot("Accuracy", cost, Axis("samples classified correctly, %", 50.0, 100.0), costs),
    ]


def _missed(trace: SlipTrace) -> str:
    slip = trace.slip
    late = "missed" if slip.delay_ms is None else f"registered {slip.delay_ms:.0f} ms late"
    slid = "" if slip.slid_mm is None else f", slipped {slip.slid_mm:.1f} mm"
    speed = f", {1e3 * slip.speed_mps:.0f} mm/s" if slip.speed_mps else ""
    return f"{slip.recording}, {slip.onset_s:.2f} s: {late}{slid}{speed}"


def _plots(trace: SlipTrace, rule: RuleSettings) -> list[Plot]:
    time = Axis("s from onset", -BEFORE_S, AFTER_S)
    values = [value for finger in trace.pressed for value in finger]
    counts = Axis("counts above the mean before slip", min([*values, -1.0]), max([*values, 1.0]))
    names = ("A", "B", "C") if len(trace.pressed) > 1 else ("fingertip",)
    pressed = [
        Curve(name, list(zip(trace.t_s, finger, strict=True)), style=f"finger{i}")
        for i, (name, finger) in enumerate(zip(names, trace.pressed, strict=False))
    ]
    points = list(zip(trace.t_s, trace.probabilities, strict=True))
    curves = [Curve("probability", points, style="ink")]
    if rule.kind == "consecutive":  # the limit of a sum has another scale
        ends = [(-BEFORE_S, rule.threshold), (AFTER_S, rule.threshold)]
        curves.append(Curve(f"threshold {rule.threshold:g}", ends, style="limit"))
    probability = Axis("probability", 0.0, 1.0)
    return [
        Plot("Pressure", time, counts, pressed, trace.slipping),
        Plot("Slip", time, probability, curves, trace.slipping),
    ]
