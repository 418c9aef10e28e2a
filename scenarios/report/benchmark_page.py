"""The page of a benchmark: `grasp benchmark`, or `grasp report benchmark.json`."""

import math
from collections.abc import Sequence
from pathlib import Path

from scenarios.benchmark.lifts import CRUSHED, LOST, MISSED, RIGHT
from scenarios.benchmark.protocol import load_evaluated
from scenarios.benchmark.run import BenchmarkFile, Cost, DetectorResult, Point, read_benchmark
from scenarios.benchmark.streams import Figure
from scenarios.report.page import Axis, Cell, Curve, Part, Plot, Section, Table, table_page
from scenarios.report.run_view import in_words

SHOWN_MS, END_MS = 300.0, 350.0  # between them: what is later, or never
DELAY = "median delay, ms (grey: later or never)"
RIGHT_AXIS = "lifts and taps done right, %"
SIMULATED = (
    'Everything is simulated, except the recordings under "Real recordings". Small: 95 % intervals.'
)
HARM = (MISSED, LOST, CRUSHED)  # the object is lost or damaged; other errors are false alarms
Where = tuple[float, float]


def benchmark_page(path: Path) -> str:
    """The page as HTML. Raises BadFile as ``read_benchmark``."""
    file, costs = read_benchmark(path)
    every = file.detectors
    sections = [
        Section("Result", [_results(file, costs)], [_plot(file)]),
        Section("Lifts", _lifts(every)),
        Section("Taps", [_taps(every)]),
        Section("Recordings", [_recordings(every)]),
        Section("Slip that lasts", [_lasting(every)]),
        Section("Real recordings", [_real(every)] if any(each.real for each in every) else [],
                hint="" if any(each.real for each in every) else "Not given (`--recording FILE`)."),
        Section("Run it again", hint=_origin(file), code=file.command),
    ]  # fmt: skip
    return table_page(
        "benchmark", f"version {file.version} · split {file.split}",
        sentence(file), sections, remarks=[SIMULATED], origins=_evaluations(),
    )  # fmt: skip


def sentence(file: BenchmarkFile) -> str:
    """The best detector with its share done right and its delay."""
    known = [each for each in file.detectors if each.point.right.value is not None]
    if not known:
        return "No detector was measured."
    best = max(known, key=lambda each: each.point.right.value or 0.0)
    p, most = best.point, f"Best of {len(known)} detectors: " if len(known) > 1 else ""
    delay = "It misses more than half of the slips."
    if p.delay_p50_ms is not None:
        delay = f"Its median delay is {p.delay_p50_ms:.0f} ms."
    share = f"{percent(p.right)} % {between(p.right)}"
    return f"{most}{best.detector} does {share} of lifts and taps right. {delay}"


def places(points: Sequence[Point], line: int, lines: int) -> list[Where]:
    """Where points are drawn: delay in ms, and share done right in %. Each of the ``lines`` has
    its own place for what is later than ``SHOWN_MS`` or never."""
    late_ms = SHOWN_MS + (END_MS - SHOWN_MS) * (line + 1) / (lines + 1)
    return [
        (late_ms if p.delay_p50_ms is None or p.delay_p50_ms > SHOWN_MS else p.delay_p50_ms,
         100.0 * p.right.value)
        for p in points if p.right.value is not None
    ]  # fmt: skip


def by_threshold(each: DetectorResult) -> list[Point]:
    """The points of a detector, with that of its rule."""
    return sorted([*each.curve, each.point], key=lambda p: p.threshold)


def lowest(points: Sequence[Where]) -> float:
    """A round share, %, below all points."""
    return 10.0 * math.floor(min((y for _, y in points), default=0.0) / 10.0)


def _plot(file: BenchmarkFile) -> Plot:
    curves, n = [], len(file.detectors)
    for line, each in enumerate(file.detectors):
        dot = next(iter(places([each.point], line, n)), None)
        curves.append(Curve(each.detector, places(by_threshold(each), line, n), dot=dot))
    curves.append(Curve("oracle", places(file.oracle, n, n), "soft"))
    low = lowest([point for curve in curves for point in curve.points])
    return Plot(
        "Delay and success of each threshold; dot: its rule", Axis(DELAY, 0.0, END_MS),
        Axis(RIGHT_AXIS, low, 100.0), curves, [(SHOWN_MS, END_MS)],
    )  # fmt: skip


def _results(file: BenchmarkFile, costs: dict[str, Cost]) -> Table:
    headings = ("detector", "lifts and taps done right, %", "lifts done right, %",
                "taps done right, %", "delay p50 / p90, ms", "one update, µs")  # fmt: skip
    rows = []
    for each in file.detectors:
        p, cost = each.point, costs.get(each.detector)
        spent = Cell("–") if cost is None else Cell(f"{cost.update_us:.0f}", size(cost))
        rows.append([Cell(each.detector, in_words(each.rule)), *_shares(p), Cell(delays(p)), spent])
    for p in file.oracle[:1]:
        rows.append(
            [Cell("oracle", "the true slip, at once"), *_shares(p), Cell(delays(p)), Cell()]
        )
    hint = ("Delay: from the onset of slip in lifts and taps to its registration; never: too many "
            "were missed. One update: of three fingertips, median.")  # fmt: skip
    return Table(headings, rows, hint)


def _shares(p: Point) -> list[Cell]:
    return [_share(figure, bar=True) for figure in (p.right, p.lifts_right, p.taps_right)]


def _share(f: Figure, bar: bool = False) -> Cell:
    known = None
    if bar and f.value is not None and f.low is not None and f.high is not None:
        known = (f.low, f.value, f.high)
    return Cell(percent(f), between(f), interval=known)


def size(cost: Cost) -> str:
    """Size of a network; empty for a detector without weights."""
    if cost.parameters is None or cost.bytes is None:
        return ""
    return f"{cost.parameters} parameters, {cost.bytes / 1e3:.0f} kB"


def _lifts(every: Sequence[DetectorResult]) -> list[Table]:
    causes = Table(
        ("detector", "all lifts", "first grip too weak", "fragile object"),
        [[Cell(each.detector), *map(_causes, (each.lifts.causes, each.lifts.causes_weak,
                                              each.lifts.causes_fragile))] for each in every],
        "Number of lifts by result.",
    )  # fmt: skip
    weak = Table(
        ("detector", "right on smooth objects, %", "right on rough objects, %",
         "slip distance p50 / p90, mm", "force over the least that holds, p50 / p90"),
        [[Cell(each.detector), _share(s.right_smooth), _share(s.right_rough),
          Cell(pair(s.slip_p50_mm, s.slip_p90_mm)),
          Cell(pair(s.over_least_p50, s.over_least_p90, "–"))]
         for each in every for s in [each.lifts]],
        "Lifts with a first grip that is too weak. Force: the thumb's at the end of a right lift.",
    )  # fmt: skip
    return [causes, weak]


def _causes(counts: dict[str, int]) -> Cell:
    total = sum(counts.values())
    ordered = sorted(counts.items(), key=lambda item: (item[0] != RIGHT, -item[1], item[0]))
    return Cell(f"{total}", parts=[
        Part(f"{n} {cause}", n / total,
             "good" if cause == RIGHT else "bad" if cause in HARM else "error")
        for cause, n in ordered
    ])  # fmt: skip


def _taps(every: Sequence[DetectorResult]) -> Table:
    headings = ("detector", "detected and over, %", "of these on smooth objects, %",
                "on rough objects, %", "without motion, not answered, %")  # fmt: skip
    rows = [
        [Cell(each.detector), _share(t.detected), _share(t.detected_smooth),
         _share(t.detected_rough), _share(t.unanswered)]
        for each in every for t in [each.taps]
    ]  # fmt: skip
    first = every[0].taps
    return Table(headings, rows, (
        f"{first.moved} taps moved the object by 2 mm or more: to be registered within 100 ms, and "
        f"the status nominal again within 1 s. {first.unmoved} moved it by less than 0.5 mm."
    ))  # fmt: skip


def _recordings(every: Sequence[DetectorResult]) -> Table:
    headings = (
        "detector", "slips detected, %", "delay p50, ms", "delay p90, ms",
        "false alarms per minute of a hand", "while hand or arm moves",
        "samples right (balanced), %", "AUC",
    )  # fmt: skip
    rows = [
        [Cell(each.detector), _share(s.recall), _delay(s.delay_p50_ms), _delay(s.delay_p90_ms),
         _value(s.false_per_min), _value(s.false_per_min_actuation), _share(s.balanced_accuracy),
         _value(s.auc, 3)]
        for each in every for s in [each.streams]
    ]  # fmt: skip
    return Table(headings, rows, "Balanced accuracy and AUC: of the paper's strokes.")


def _lasting(every: Sequence[DetectorResult]) -> Table:
    speeds = dict.fromkeys(name for each in every for name in each.streams.sustained_by_speed)
    headings = ("detector", "reported, %", *(f"{name}, %" for name in speeds),
                "smooth objects, %", "rough objects, %", "status lost per second")  # fmt: skip
    rows = [
        [Cell(each.detector), _share(s.sustained),
         *(_share(s.sustained_by_speed.get(name, Figure(None))) for name in speeds),
         _share(s.sustained_smooth), _share(s.sustained_rough), _value(s.dropped_per_s)]
        for each in every for s in [each.streams]
    ]  # fmt: skip
    hint = "Share of the time, from 0.2 s to 2 s after the onset, for which slip is registered."
    return Table(headings, rows, hint)


def _real(every: Sequence[DetectorResult]) -> Table:
    names = dict.fromkeys(name for each in every for name in each.real)
    rows = [
        [Cell(each.detector), *(_value(each.real[n], 3) if n in each.real else Cell("not given")
                                for n in names)]
        for each in every
    ]  # fmt: skip
    return Table(("detector", *(f"AUC on {name}" for name in names)), rows)


def _origin(file: BenchmarkFile) -> str:
    hashes = ", ".join(f"{each.detector} {each.digest}" for each in file.detectors)
    layout = f"layout {file.layout}, " if file.layout else ""
    return (
        f"Protocol version {file.version}, split {file.split}, {layout}digest of its seeds and "
        f"settings {file.seeds}. Hashes of weights or formula, and rule: {hashes}."
    )


def _evaluations() -> list[str]:
    found = load_evaluated()
    listed = [f"{each.date}: {each.detector} {each.digest}" for each in found]
    return [f"Evaluations of candidates for the package on the split test: {len(found)}.", *listed]


def _value(f: Figure, digits: int = 1) -> Cell:
    return Cell(number(f, digits), between(f, 1.0, digits))


def _delay(f: Figure) -> Cell:
    return Cell(ms(f.value), between(f, 1.0))


def percent(f: Figure) -> str:
    """A share in per cent."""
    return "–" if f.value is None else f"{100 * f.value:.1f}"


def number(f: Figure, digits: int = 1) -> str:
    """A value in its unit."""
    return "–" if f.value is None else f"{f.value:.{digits}f}"


def between(f: Figure, scale: float = 100.0, digits: int = 0) -> str:
    """The interval in brackets, or nothing; by default that of a share, in per cent."""
    if f.low is None or f.high is None:
        return ""
    low, high = (
        f"{scale * x:.{digits}f}" if math.isfinite(x) else "never" for x in (f.low, f.high)
    )
    return f"({low} to {high})"


def pair(p50: float | None, p90: float | None, missing: str = "never") -> str:
    """Two quantiles."""
    known = (f"{x:.1f}" if x is not None and math.isfinite(x) else missing for x in (p50, p90))
    return " / ".join(known)


def ms(value: float | None) -> str:
    """A delay, or that it is infinite."""
    return f"{value:.0f}" if value is not None and math.isfinite(value) else "never"


def delays(p: Point) -> str:
    """Median and 90 % quantile of the delay of a point."""
    return f"{ms(p.delay_p50_ms)} / {ms(p.delay_p90_ms)}"
