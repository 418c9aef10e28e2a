"""The page of a file of scores: `grasp benchmark`, or `grasp report FILE.json`."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from detector.decision import RuleSettings
from detector.scores.figures import Figure
from scenarios.benchmark.lifts import CRUSHED, LOST, MISSED, RIGHT
from scenarios.benchmark.quality import BUDGET_PER_MIN, resolved
from scenarios.benchmark.ranking import halves, ranked
from scenarios.benchmark.score_file import (
    DetectorScores,
    Point,
    ScoreFile,
    SlipTrace,
    read_scores,
)
from scenarios.benchmark.slips import AFTER_S, BEFORE_S
from scenarios.report.page import (
    Axis,
    Cell,
    Curve,
    Mark,
    Part,
    Plot,
    Section,
    Table,
    cells,
    plot_svg,
    table_page,
)
from scenarios.report.run_view import in_words

SHOWN_MS, END_MS = 300.0, 498.0  # between them: what is later, or never
DELAY = "median delay, ms (grey: later or never)"
SCORE_AXIS = "score (0: silence, 100: oracle)"
MEANING = (
    "The score is 0 for a detector that never registers slip and 100 for an oracle that registers "
    "it at once. It counts lifts, priced by the millimetre of slip, and taps, priced by the "
    "millisecond of delay, half each, less one hundredth for each false alarm a minute."
)
SIMULATED = "Everything is simulated, except real recordings. Small: 95 % intervals."
HARM = (MISSED, LOST, CRUSHED)  # the object is lost or damaged; other errors are false alarms
NONE = Figure(None)
Where = tuple[float, float]
Columns = dict[str, Callable[[DetectorScores], Cell]]  # by heading


def score_page(path: Path) -> str:
    """The page as HTML. Raises BadFile as ``read_scores``."""
    file, costs = read_scores(path)
    if file.source.version is None:
        return _evaluation_page(file)
    by_score = list({id(row.of): row.of for row in ranked(file)}.values())
    sections = [
        Section("Result", [results_table(file, costs)], [_plot(file)]),
        *(Section(title, [_table(by_score, *topic)]) for title, topic in TOPICS.items()),
        *([Section("Run it again", code=file.command)] if file.command else []),
    ]  # fmt: skip
    return table_page(
        "benchmark", f"version {file.source.version} · split {file.source.split}"
        + " · quick: not comparable with a full run" * file.source.quick,
        sentence(file), sections, [MEANING, SIMULATED], [_origin(file)],
    )  # fmt: skip


def _evaluation_page(file: ScoreFile) -> str:
    worst = [
        Section(f"Worst misses of {each.detector}: {_missed(trace)}", (), _plots(trace, each.rule))
        for each in file.detectors for trace in each.worst
    ]  # fmt: skip
    scores = Section("Scores", [_table(file.detectors, *EVALUATION)])
    again = Section("Run it again", code=file.command, hint=_hashes(file))
    versions = ", ".join(f"{name} {text}" for name, text in sorted(file.versions.items()))
    samples = number(file.detectors[0].figures.get("samples", NONE), 0)
    return table_page(
        f"evaluation on {file.source.data}", f"label {file.source.label} · {samples} samples",
        _best(file), [scores, *worst, again], origins=[versions],
    )  # fmt: skip


# Sentences


def sentence(file: ScoreFile) -> str:
    """The best row, and whether it is better than the best row of another detector."""
    first, *others = ranked(file)
    second = next((row for row in others if row.of is not first.of), None)
    text = f"{first.name}: score {percent(first.point.score)} {between(first.point.score)}"
    if second is None:
        return f"{text}."
    by = f"{percent(second.behind)} {between(second.behind)}"
    if not resolved(second.behind):
        return f"{text}. Not told apart from it: {second.name}, {by} behind."
    return f"Best of {len(file.detectors)} detectors: {text}. {second.name} is {by} behind."


def _best(file: ScoreFile) -> str:
    """Number of slips, and the best detectors by AUC and by detected slips."""

    def of(each: DetectorScores, name: str) -> float:
        return each.figures.get(name, NONE).value or 0.0

    best, most = (max(file.detectors, key=lambda d: of(d, name)) for name in ("auc", "recall"))
    slips = of(most, "slips")
    text = f"{slips:.0f} slips: "
    if of(best, "auc"):
        text += f"{best.detector} has the highest AUC ({of(best, 'auc'):.3f}); "
    detected = slips - of(most, "missed")
    return f"{text}{most.detector} detected most slips, {detected:.0f} of {slips:.0f}."


# The plot


def places(points: Sequence[Point], line: int, lines: int) -> list[Where]:
    """Where points are drawn: delay in ms, and score. Each of the ``lines`` has its own place for
    what is later than ``SHOWN_MS`` or never."""
    late_ms = SHOWN_MS + (END_MS - SHOWN_MS) * (line + 1) / (lines + 1)
    return [
        (late_ms if p.delay_p50_ms is None or p.delay_p50_ms > SHOWN_MS else p.delay_p50_ms,
         100.0 * p.score.value)
        for p in points if p.score.value is not None
    ]  # fmt: skip


def by_threshold(each: DetectorScores) -> list[Point]:
    """The points of a detector: those of its rows in place of the same with fewer lifts."""
    points = {p.threshold: p for p in (*each.curve, *each.rows)}
    return sorted(points.values(), key=lambda p: p.threshold)


def _plot(file: ScoreFile) -> Plot:
    curves, n, known = [], len(file.detectors), file.references
    ranks = {id(row.point): str(i) for i, row in enumerate(ranked(file), 1)}
    for line, each in enumerate(file.detectors):
        marks = [
            Mark(*where, ranks[id(p)], _percent(p.score.low), _percent(p.score.high),
                 hollow=p != each.point)
            for where, p in zip(places(each.rows, line, n), each.rows, strict=True)
        ]  # fmt: skip
        name = f"{', '.join(m.text for m in marks)}: {Path(each.detector).name}"
        curves.append(Curve(name, places(by_threshold(each), line, n), marks=marks))
    if known:
        curves.append(Curve("oracle with this delay", places(known.oracle, n, n), "soft"))
    curves.append(Curve("never registers", [(0.0, 0.0), (END_MS, 0.0)], "limit"))
    lowest = min(y for curve in curves for _, y in curve.points)
    return Plot(
        "Score of slip detectors over their delay", Axis(DELAY, 0.0, END_MS, SHOWN_MS),
        Axis(SCORE_AXIS, lowest, 100.0).rounded(), curves, [(SHOWN_MS, END_MS)],
        "best: upper left; line: thresholds; dot: own rule; ring: best one",
    )  # fmt: skip


def _percent(share: float | None) -> float:
    return 100.0 * (share or 0.0)


def score_svg(file: ScoreFile) -> str:
    """The chart of a benchmark."""
    return plot_svg(_plot(file))


# Tables


def _table(every: Sequence[DetectorScores], columns: Columns, hint: str) -> Table:
    rows = [
        [Cell(d.detector, in_words(d.rule)), *(made(d) for made in columns.values())]
        for d in every
    ]  # fmt: skip
    return Table(("detector", *columns), rows, hint)


def results_table(file: ScoreFile, costs: dict[str, float]) -> Table:
    """The rows of a benchmark by score, then the ends of the score."""

    def row(p: Point, behind: Cell, *more: str) -> list[Cell]:
        return [_share(p.score, bar=True), behind, *cells(
            *map(percent, (p.raw, p.lifts, p.moved, p.unmoved)), number(p.false_per_min, 2),
            delays(p), *(more or [""] * (2 + len(real))))]  # fmt: skip

    real = list(dict.fromkeys(name for each in file.detectors for name in each.real))
    headings = ("detector", "score", "behind the first", "raw, %", "lifts, %", "taps moved, %",
                "taps unmoved, %", "false alarms / min", "delay p50 / p90, ms", "update, µs",
                "AUC", *(f"AUC, {name}" for name in real))  # fmt: skip
    rows = []
    for i, each in enumerate(ranked(file), 1):
        of = each.of
        areas = (of.figures.get("auc", NONE), *(of.real.get(name, NONE) for name in real))
        behind = Cell(percent(each.behind), between(each.behind))
        update = f"{costs[of.detector]:.0f}" if of.detector in costs else "–"
        texts = [update, *(number(area, 3) for area in areas)]
        rows.append([Cell(f"{i}. {of.detector}", each.note), *row(each.point, behind, *texts)])
    if known := file.references:
        rows += [[Cell("oracle"), *row(known.oracle[0], Cell())],
                 [Cell("never registers"), *row(known.silence, Cell())]]  # fmt: skip
    return Table(
        headings, rows,
        "Raw: the score before it is scaled to the last two rows. Best threshold: of those within "
        f"{BUDGET_PER_MIN:g} false alarm a minute. Behind the first: on the same trials; not told "
        "apart if the interval contains 0. Lifts and taps: mean quality; moved: by 1 mm or more. "
        "Delay: from the onset of slip in lifts and taps; never: too many were missed. Update: of "
        "three fingertips, median. AUC: of the paper's strokes, and of real recordings. "
        f"{halves(file)}",
    )  # fmt: skip


def _causes(each: DetectorScores) -> Cell:
    """Number of lifts by result."""
    total = sum(each.causes.values())
    ordered = [(each.causes.get(RIGHT, 0), RIGHT), *by_number(each.causes)]
    kinds = {RIGHT: "good", **dict.fromkeys(HARM, "bad")}
    parts = [
        Part(f"{n} {cause}", n / max(total, 1), kinds.get(cause, "error")) for n, cause in ordered
    ]
    return Cell(f"{total}", parts=parts)


def by_number(counts: dict[str, int]) -> list[tuple[int, str]]:
    """What went wrong, the commonest first."""
    wrong = [(n, cause) for cause, n in counts.items() if cause != RIGHT]
    return sorted(wrong, key=lambda each: (-each[0], each[1]))


def _shares(name: str) -> Callable[[DetectorScores], Cell]:
    return lambda d: _share(d.figures.get(name, NONE))


def _values(name: str, digits: int = 1) -> Callable[[DetectorScores], Cell]:
    return lambda d: _value(d.figures.get(name, NONE), digits)


def _delays(name: str) -> Callable[[DetectorScores], Cell]:
    def cell(each: DetectorScores) -> Cell:
        f = each.figures.get(name, NONE)
        return Cell(ms(f.value), between(f, 1.0, 0))

    return cell


def _pairs(one: str, other: str) -> Callable[[DetectorScores], Cell]:
    return lambda d: Cell(
        " / ".join(number(d.figures.get(name, NONE)) for name in (one, other))
    )  # fmt: skip


TOPICS: dict[str, tuple[Columns, str]] = {
    "Lifts": ({"by result": _causes}, "Number of lifts with its own rule. Right: the object is "
              "held and whole, slip was not registered before it began, and no slip of 2 mm or "
              "more was missed."),
    "Recordings": ({
        "slip that lasts: reported, %": _shares("sustained"),
        "registered without slip, % of that time": _shares("lingering"),
    }, "With its own rule. Slip that lasts: from 0.2 s to 2 s after the onset."),
}  # fmt: skip
EVALUATION: tuple[Columns, str] = ({
    "AUC": _values("auc", 3),
    "accuracy, %": _shares("accuracy"),
    "calibration error": _values("ece", 3),
    "slips detected, %": _shares("recall"),
    "false alarms per minute of a hand": _values("false_per_min", 2),
    "delay p50, ms": _delays("delay_p50_ms"),
    "delay p90, ms": _delays("delay_p90_ms"),
    "slip by then p50 / p90, mm": _pairs("slid_p50_mm", "slid_p90_mm"),
    "one update, µs": _values("update_p50_us", 0),
}, "Accuracy and calibration: of samples at the detector's threshold. Slips and delays: of its "
   "decision rule. Distance and cost: –: infinite. Small: 95 % intervals.")  # fmt: skip


def _hashes(file: ScoreFile) -> str:
    hashes = ", ".join(f"{each.detector} {each.detector_hash}" for each in file.detectors)
    return f"Hashes of weights or formula, and rule: {hashes}."


def _origin(file: ScoreFile) -> str:
    source = file.source
    layout = f"layout {source.layout}, " if source.layout else ""
    return (
        f"Protocol version {source.version}, split {source.split}, {layout}digest of its seeds and "
        f"settings {source.seeds}. {_hashes(file)}"
    )


# Figures as text


def _share(f: Figure, bar: bool = False) -> Cell:
    known = None
    if bar and f.value is not None and f.low is not None and f.high is not None:
        known = (f.low, f.value, f.high)
    return Cell(percent(f), between(f), interval=known)


def _value(f: Figure, digits: int = 1) -> Cell:
    return Cell(number(f, digits), between(f, 1.0, digits))


def percent(f: Figure) -> str:
    """A share in per cent."""
    return "–" if f.value is None else f"{100 * f.value:z.1f}"


def number(f: Figure, digits: int = 1) -> str:
    """A value in its unit."""
    return "–" if f.value is None else f"{f.value:z.{digits}f}"


def between(f: Figure, scale: float = 100.0, digits: int = 1) -> str:
    """The interval in brackets, or nothing; by default that of a share, in per cent."""
    if f.low is None or f.high is None:
        return ""
    low, high = (
        f"{scale * x:z.{digits}f}" if math.isfinite(x) else "never" for x in (f.low, f.high)
    )
    return f"({low} to {high})"


def ms(value: float | None) -> str:
    """A delay, or that it is infinite."""
    return f"{value:.0f}" if value is not None and math.isfinite(value) else "never"


def delays(p: Point) -> str:
    """Median and 90 % quantile of the delay of a point."""
    return f"{ms(p.delay_p50_ms)} / {ms(p.delay_p90_ms)}"


# Traces of the worst misses


def _missed(trace: SlipTrace) -> str:
    slip = trace.slip
    late = "missed" if slip.delay_ms is None else f"registered {slip.delay_ms:.0f} ms late"
    slid = "" if slip.slid_mm is None else f", slipped {slip.slid_mm:.1f} mm"
    speed = f", {1e3 * slip.speed_mps:.0f} mm/s" if slip.speed_mps else ""
    return f"{slip.recording}, {slip.onset_s:.2f} s: {late}{slid}{speed}"


def _plots(trace: SlipTrace, rule: RuleSettings) -> list[Plot]:
    time = Axis("time from the onset of slip, s", -BEFORE_S, AFTER_S)
    values = [-1.0, 1.0, *(value for finger in trace.pressed for value in finger)]
    counts = Axis("pressure, counts", min(values), max(values)).rounded()
    names = ("A", "B", "C") if len(trace.pressed) > 1 else ("fingertip",)
    pressed = [
        Curve(name, list(zip(trace.t_s, finger, strict=True)), style=f"finger{i}")
        for i, (name, finger) in enumerate(zip(names, trace.pressed, strict=False))
    ]
    points = list(zip(trace.t_s, trace.probabilities, strict=True))
    curves = [Curve("probability", points, style="ink")]
    if rule.kind != "cusum":  # the limit of a sum has another scale
        ends = [(-BEFORE_S, rule.threshold), (AFTER_S, rule.threshold)]
        curves.append(Curve(f"threshold {rule.threshold:g}", ends, style="limit"))
    hint = "sum of the taxels, less its mean before the slip. Shaded: labelled slip"
    return [
        Plot("Pressure", time, counts, pressed, trace.slipping, hint),
        Plot("Slip", time, Axis("probability", 0.0, 1.0), curves, trace.slipping),
    ]
