"""The page of a benchmark: `grasp benchmark`, or `grasp report benchmark.json`."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from scenarios.benchmark.lifts import CRUSHED, LOST, MISSED, RIGHT
from scenarios.benchmark.protocol import load_evaluated
from scenarios.benchmark.run import BenchmarkFile, Cost, DetectorResult, Point, read_benchmark
from scenarios.benchmark.streams import Figure
from scenarios.report.page import Axis, Cell, Curve, Part, Plot, Section, Table, table_page
from scenarios.report.run_view import in_words

SHOWN_MS, END_MS = 300.0, 350.0  # between them: what is later, or never
DELAY = "median delay, ms (grey: later, or more than half were missed)"
RIGHT_AXIS = "lifts and taps done right, %"
REAL = "Real recordings"
SIMULATED = f'Everything is simulated, except what is under "{REAL}". Small: 95 % intervals.'
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
        _real(every),
        Section("Run it again", hint=_origin(file), code=file.command),
    ]  # fmt: skip
    return table_page(
        "benchmark", f"version {file.version} · split {file.split}",
        sentence(file), sections, remarks=[SIMULATED], origins=_evaluations(),
    )  # fmt: skip


def sentence(file: BenchmarkFile) -> str:
    """The best detector with its share done right and its delay."""
    n, best = len(file.detectors), max(file.detectors, key=lambda d: d.point.right.value or 0.0)
    p, most = best.point, f"Best of {n} detectors: " if n > 1 else ""
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
    return 10.0 * math.floor(min([99.0, *(y for _, y in points)]) / 10.0)


def _plot(file: BenchmarkFile) -> Plot:
    curves, n = [], len(file.detectors)
    for line, each in enumerate(file.detectors):
        dot = next(iter(places([each.point], line, n)), None)
        curves.append(Curve(each.detector, places(by_threshold(each), line, n), dot=dot))
    curves.append(Curve("oracle", places(file.oracle, n, n), "soft"))
    low = lowest([point for curve in curves for point in curve.points])
    return Plot(
        "Lines: thresholds of a detector; dots: its own rule; oracle: reports slip that late",
        Axis(DELAY, 0.0, END_MS),
        Axis(RIGHT_AXIS, low, 100.0), curves, [(SHOWN_MS, END_MS)],
    )  # fmt: skip


def _table(
    every: Sequence[DetectorResult], columns: dict[str, Callable[[DetectorResult], Cell]],
    hint: str = "", small: Callable[[DetectorResult], str] = lambda _: "",
) -> Table:  # fmt: skip
    rows = [[Cell(d.detector, small(d)), *(made(d) for made in columns.values())] for d in every]
    return Table(("detector", *columns), rows, hint)


def _results(file: BenchmarkFile, costs: dict[str, Cost]) -> Table:
    table = _table(file.detectors, {
        "lifts and taps done right, %": lambda d: _share(d.point.right, bar=True),
        "lifts done right, %": lambda d: _share(d.point.lifts_right, bar=True),
        "taps done right, %": lambda d: _share(d.point.taps_right, bar=True),
        "delay p50 / p90, ms": lambda d: Cell(delays(d.point)),
        "one update, µs": lambda d: _cost(costs.get(d.detector)),
    }, "Delay: from the onset of slip in lifts and taps to its registration; never: too many were "
       "missed. One update: of three fingertips, median.", lambda d: in_words(d.rule))  # fmt: skip
    oracle = [
        [Cell("oracle", "the true slip, at once"),
         *map(_share, (p.right, p.lifts_right, p.taps_right)), Cell(delays(p)), Cell()]
        for p in file.oracle[:1]
    ]  # fmt: skip
    return msgspec.structs.replace(table, rows=[*table.rows, *oracle])


def _cost(cost: Cost | None) -> Cell:
    if cost is None:
        return Cell("–")
    size = ""
    if cost.parameters is not None and cost.bytes is not None:
        size = f"{cost.parameters} parameters, {cost.bytes / 1e3:.0f} kB"
    return Cell(f"{cost.update_us:.0f}", size)


def _lifts(every: Sequence[DetectorResult]) -> list[Table]:
    return [
        _table(every, {
            "all lifts": lambda d: _causes(d.lifts.causes),
            "first grip too weak": lambda d: _causes(d.lifts.causes_weak),
            "fragile object": lambda d: _causes(d.lifts.causes_fragile),
        }, "Number of lifts by result."),
        _table(every, {
            "right on smooth objects, %": lambda d: _share(d.lifts.right_smooth),
            "right on rough objects, %": lambda d: _share(d.lifts.right_rough),
            "slip distance p50 / p90, mm":
                lambda d: Cell(pair(d.lifts.slip_p50_mm, d.lifts.slip_p90_mm)),
            "force over the least that holds, p50 / p90":
                lambda d: Cell(pair(d.lifts.over_least_p50, d.lifts.over_least_p90)),
        }, "Lifts with a first grip that is too weak. Force: the thumb's, of right ones."),
    ]  # fmt: skip


def _causes(counts: dict[str, int]) -> Cell:
    total = sum(counts.values())
    ordered = [(counts.get(RIGHT, 0), RIGHT), *by_number(counts)]
    kinds = {RIGHT: "good", **dict.fromkeys(HARM, "bad")}
    parts = [Part(f"{n} {cause}", n / total, kinds.get(cause, "error")) for n, cause in ordered]
    return Cell(f"{total}", parts=parts)


def by_number(counts: dict[str, int]) -> list[tuple[int, str]]:
    """What went wrong, the commonest first."""
    wrong = [(n, cause) for cause, n in counts.items() if cause != RIGHT]
    return sorted(wrong, key=lambda each: (-each[0], each[1]))


def _taps(every: Sequence[DetectorResult]) -> Table:
    first = every[0].taps
    return _table(every, {
        "detected and over, %": lambda d: _share(d.taps.detected),
        "of these on smooth objects, %": lambda d: _share(d.taps.detected_smooth),
        "on rough objects, %": lambda d: _share(d.taps.detected_rough),
        "without motion, not answered, %": lambda d: _share(d.taps.unanswered),
    }, f"{first.moved} taps moved the object by 2 mm or more: to be registered within 100 ms, and "
       f"over within 1 s. {first.unmoved} moved it by less than 0.5 mm.")  # fmt: skip


def _recordings(every: Sequence[DetectorResult]) -> Table:
    return _table(every, {
        "slips detected, %": lambda d: _share(d.streams.recall),
        "delay p50, ms": lambda d: _delay(d.streams.delay_p50_ms),
        "delay p90, ms": lambda d: _delay(d.streams.delay_p90_ms),
        "false alarms per minute of a hand": lambda d: _value(d.streams.false_per_min),
        "while hand or arm moves": lambda d: _value(d.streams.false_per_min_actuation),
        "registered without slip, % of that time": lambda d: _share(d.streams.lingering),
        "samples right (balanced), %": lambda d: _share(d.streams.balanced_accuracy),
        "AUC": lambda d: _value(d.streams.auc, 3),
    }, "Slips: true slides of 0.5 mm or more. False alarm: an event that begins although nothing "
       "slides from 0.1 s before to 0.3 s after. Balanced accuracy and AUC: of the paper's strokes."
    )  # fmt: skip


def _lasting(every: Sequence[DetectorResult]) -> Table:
    def at(speed: str) -> Callable[[DetectorResult], Cell]:
        return lambda d: _share(d.streams.sustained_by_speed.get(speed, Figure(None)))

    speeds = dict.fromkeys(name for each in every for name in each.streams.sustained_by_speed)
    return _table(every, {
        "reported, %": lambda d: _share(d.streams.sustained),
        **{f"{speed}, %": at(speed) for speed in speeds},
        "smooth objects, %": lambda d: _share(d.streams.sustained_smooth),
        "rough objects, %": lambda d: _share(d.streams.sustained_rough),
        "status lost per second": lambda d: _value(d.streams.dropped_per_s),
    }, "Share of the time, from 0.2 s to 2 s after the onset, with slip registered.")  # fmt: skip


def _real(every: Sequence[DetectorResult]) -> Section:
    def on(name: str) -> Callable[[DetectorResult], Cell]:
        return lambda d: _value(d.real[name], 3) if name in d.real else Cell("not given")

    if names := dict.fromkeys(name for each in every for name in each.real):
        return Section(REAL, [_table(every, {f"AUC on {name}": on(name) for name in names})])
    return Section(REAL, hint="Not given (`--recording FILE`).")


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


def _share(f: Figure, bar: bool = False) -> Cell:
    known = None
    if bar and f.value is not None and f.low is not None and f.high is not None:
        known = (f.low, f.value, f.high)
    return Cell(percent(f), between(f), interval=known)


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


def pair(p50: float | None, p90: float | None) -> str:
    """Two quantiles."""
    return " / ".join("–" if x is None else f"{x:.1f}" for x in (p50, p90))


def ms(value: float | None) -> str:
    """A delay, or that it is infinite."""
    return f"{value:.0f}" if value is not None and math.isfinite(value) else "never"


def delays(p: Point) -> str:
    """Median and 90 % quantile of the delay of a point."""
    return f"{ms(p.delay_p50_ms)} / {ms(p.delay_p90_ms)}"
