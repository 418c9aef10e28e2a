"""The page of an evaluation: `grasp report FILE.json`."""

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import msgspec

from detector.decision import RuleSettings
from scenarios.benchmark.evaluation_file import (
    AFTER_S,
    BEFORE_S,
    Choice,
    Evaluated,
    SlipTrace,
    no_evaluation,
    read_evaluation,
)
from scenarios.report.charts import Axis, Curve, Mark, Plot, curves
from scenarios.report.page import render
from scenarios.report.run_decision import in_words

LEAST_SCALE_MS, STEP_MS = 100.0, 50.0  # of delays: what is later, or never came, is at its top
RATES = (0.1, 1000.0)  # false events a minute that have a place; fewer are drawn at the left
COST_US = 1.3  # room beside the quickest and the slowest, a factor


class Spread(msgspec.Struct, frozen=True):
    """Quantiles as a sheet has them; None: that share never came."""

    p10: float | None = None
    p50: float | None = None
    p90: float | None = None
    p99: float | None = None


class Sheet(msgspec.Struct, frozen=True):
    """Of an evaluation's sheet what a page tells."""

    n_samples: int
    accuracy: float
    threshold: float
    ece: float
    true_events: int
    missed_events: int
    false_events: int
    auc: float | None = None
    false_events_per_min_hand: float | None = None
    delay_ms: Spread | None = None
    delay_mm: Spread | None = None
    compute_us: Spread | None = None
    intervals: dict[str, tuple[float | None, float | None]] = {}
    detector_hash: str = ""  # older evaluations have none


class Missed(msgspec.Struct, frozen=True):
    """One slip of the worst: in words, and its two plots."""

    words: str
    plots: tuple[Plot, Plot]


class Shown(msgspec.Struct, frozen=True):
    """One detector of the page."""

    name: str
    rule: str
    sheet: Sheet
    worst: list[Missed]


def evaluation_page(file: Path) -> str:
    """The page of an evaluation's file; raises BadFile as ``read_evaluation``."""
    told = read_evaluation(file)
    try:
        every = [(each, msgspec.convert(each.sheet, Sheet)) for each in told.detectors]
    except msgspec.ValidationError as error:
        raise no_evaluation(file, error) from None
    return render(
        "evaluation.html",
        (),
        title=f"evaluation on {told.data}",
        told=told,
        sentence=_sentence(every),
        shown=[_shown(each, sheet) for each, sheet in every],
        overview=[plot for plot in (*_speed(every), _cost(every), _reliability(every)) if plot],
        data={},
    )


def _shown(each: Evaluated, sheet: Sheet) -> Shown:
    worst = [_missed(trace, each.rule) for trace in each.worst]
    return Shown(each.detector, in_words(each.rule), sheet, worst)


def _sentence(every: Sequence[tuple[Evaluated, Sheet]]) -> str:
    """What was scored, and which of them was best at what."""
    slips = max(sheet.true_events for _, sheet in every)
    first = f"{len(every)} {'detector' if len(every) == 1 else 'detectors'}, {slips} slips"
    ranked = [(sheet.auc, each.detector) for each, sheet in every if sheet.auc is not None]
    heard = min(every, key=lambda pair: pair[1].missed_events)
    told = [first]
    if ranked:
        auc, name = max(ranked)
        told.append(f"samples are told apart best by {name} (AUC {auc:.3f})")
    caught = heard[1].true_events - heard[1].missed_events
    told.append(f"{heard[0].detector} caught most slips, {caught} of {heard[1].true_events}")
    return f"{told[0]}: {'; '.join(told[1:])}."


# Figures over all


def _speed(every: Sequence[tuple[Evaluated, Sheet]]) -> list[Plot | None]:
    """What each rule of the sweep would make of a detector, and the rule that it has: in the
    median, and of nine slips in ten by the same rules, which go to and fro and would hide it."""
    return [
        _against(every, "median", lambda c: c.delay_ms, lambda q: q.p50),
        _against(every, "90 %", lambda c: c.p90_delay_ms, lambda q: q.p90),
    ]


def _against(
    every: Sequence[tuple[Evaluated, Sheet]], which: str,
    of_choice: Callable[[Choice], float | None], of_rule: Callable[[Spread], float | None],
) -> Plot | None:  # fmt: skip
    known = [of_choice(c) for each, _ in every for c in each.choices]
    known += [of_rule(sheet.delay_ms) for _, sheet in every if sheet.delay_ms is not None]
    delay = _delays("delay", known)
    drawn = []
    for each, sheet in every:
        points = [(c.false_per_min, _on(delay, of_choice(c))) for c in each.choices]
        rate, spread = sheet.false_events_per_min_hand, sheet.delay_ms
        marks = []
        if rate is not None and spread is not None:
            y = _on(delay, of_rule(spread))
            words = f"{each.detector} by its rule: {rate:.2f} a minute, {_three(spread)}"
            marks.append(Mark(rate, y, y, y, words))
        if points or marks:
            drawn.append(Curve(each.detector, points, marks, stairs=bool(points)))
    if not drawn:
        return None
    rates = Axis("false events a minute of three fingers", *RATES, log=True)
    return curves(f"False events against delay, {which}", rates, delay, drawn)


def _cost(every: Sequence[tuple[Evaluated, Sheet]]) -> Plot | None:
    known = [
        (each.detector, sheet.compute_us.p50, sheet)
        for each, sheet in every
        if sheet.compute_us is not None and sheet.compute_us.p50 is not None
    ]
    if not known:
        return None
    drawn = []
    for name, cost_us, sheet in known:
        low, high = sheet.intervals.get("accuracy", (None, None))
        ends = [sheet.accuracy if end is None else end for end in (low, high)]
        words = f"{name}: accuracy {sheet.accuracy:.3f}, {cost_us:.0f} µs"
        mark = Mark(cost_us, 100 * sheet.accuracy, 100 * ends[0], 100 * ends[1], words)
        drawn.append(Curve(name, (), [mark]))
    costs = [cost_us for _, cost_us, _ in known]
    least = min(50.0, *(mark.low for curve in drawn for mark in curve.marks))
    low, high = min(10.0, min(costs) / COST_US), max(1000.0, max(costs) * COST_US)
    return curves(
        "Accuracy against compute", Axis("one update, µs (median)", low, high, log=True),
        Axis("samples told right, %", 10.0 * (least // 10.0), 100.0), drawn,
    )  # fmt: skip


def _reliability(every: Sequence[tuple[Evaluated, Sheet]]) -> Plot | None:
    drawn = [
        Curve(
            each.detector,
            [(b.said, b.slipped) for b in each.reliability],
            [
                Mark(b.said, b.slipped, b.slipped, b.slipped,
                     f"{each.detector}: said {b.said:.2f}, slipped {b.slipped:.2f} of {b.n}")
                for b in each.reliability
            ],
        )
        for each, _ in every
        if each.reliability
    ]  # fmt: skip
    if not drawn:
        return None
    sure = Curve("perfect", [(0.0, 0.0), (1.0, 1.0)], style="soft")
    return curves(
        "Calibration", Axis("probability that was said", 0.0, 1.0),
        Axis("share that slipped", 0.0, 1.0), [*drawn, sure],
    )  # fmt: skip


# The worst


def _missed(trace: SlipTrace, rule: RuleSettings) -> Missed:
    slip = trace.slip
    late = "missed" if slip.delay_ms is None else f"registered {slip.delay_ms:.0f} ms late"
    facts = [f"{slip.recording}, {slip.onset_s:.2f} s: {late}"]
    facts += [f"slid {slip.slid_mm:.1f} mm"] if slip.slid_mm is not None else []
    facts += [f"{1e3 * slip.speed_mps:.0f} mm/s"] if slip.speed_mps else []
    time = Axis("s from its begin", -BEFORE_S, AFTER_S)
    values = [value for finger in trace.pressed for value in finger]
    low, high = min([*values, -1.0]), max([*values, 1.0])
    names = ("A", "B", "C") if len(trace.pressed) > 1 else ("fingertip",)
    pressed = [
        Curve(name, list(zip(trace.t_s, finger, strict=True)), style=f"finger{i}")
        for i, (name, finger) in enumerate(zip(names, trace.pressed, strict=False))
    ]
    said = Curve("probability", list(zip(trace.t_s, trace.probabilities, strict=True)), style="ink")
    drawn = [said]
    if rule.kind == "consecutive":  # a sum has a limit of its own, on another scale
        ends = [(-BEFORE_S, rule.threshold), (AFTER_S, rule.threshold)]
        drawn.append(Curve(f"threshold {rule.threshold:g}", ends, style="limit"))
    return Missed(
        ", ".join(facts),
        (
            curves("Pressed", time, Axis("counts over before", low, high), pressed, trace.slipping),
            curves("Slip", time, Axis("probability", 0.0, 1.0), drawn, trace.slipping),
        ),
    )


def _delays(what: str, values: Iterable[float | None]) -> Axis:
    """An axis on which all of them have a place, those that never came at its top."""
    known = [value for value in values if value is not None and math.isfinite(value)]
    most = max([LEAST_SCALE_MS - STEP_MS / 2, *known])
    top = STEP_MS * (1 + math.ceil(most / STEP_MS))
    least = STEP_MS * math.floor(min([0.0, *known]) / STEP_MS)
    return Axis(f"{what}, ms; {top:g}: never", least, top)


def _on(axis: Axis, delay_ms: float | None) -> float:
    return axis.high if delay_ms is None else min(delay_ms, axis.high)


def _three(q: Spread) -> str:
    return f"{_ms(q.p50)} (90 %: {_ms(q.p90)}, 99 %: {_ms(q.p99)})"


def _ms(value: float | None) -> str:
    return "never" if value is None or math.isinf(value) else f"{value:.0f} ms"
