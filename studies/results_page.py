"""The page docs/results.md and its charts, from CSV files and the texts of studies/results.toml."""

import csv
import io
import json
import math
import subprocess
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from detector.scores.quantiles import Quantiles
from grasp.files import write_whole
from scenarios.benchmark.score_file import read_scores
from scenarios.campaign.summary import wilson
from scenarios.report.score_page import score_svg
from studies import difficulty_sweep, physics_levels
from studies.runner import Study, draw, markdown

ROOT = Path(__file__).parents[1]
ACCURACY = "accuracy at the packaged threshold, %"
AT_BEST = "accuracy at the best threshold, %"


class Row(msgspec.Struct, frozen=True):
    """One line of a CSV file: a figure with its 95 % interval, or a median with ``low`` empty and
    ``high`` its 90th percentile. ``n``: samples or trials. Infinite: that share never came."""

    item: str
    measure: str
    value: float | None
    low: float | None = None
    high: float | None = None
    n: int | None = None


Made = list[Row] | tuple[list[Row], Any]  # rows, and the content of a JSON file beside them


def percent(item: str, measure: str, hits: int, n: int) -> Row:
    """A share in per cent with its Wilson interval."""
    low, high = wilson(hits, n)
    return Row(item, measure, 100 * hits / n if n else None, 100 * low, 100 * high, n)


def between(
    item: str, measure: str, value: float | None, ends: Iterable[float], n: int, factor: float = 1.0
) -> Row:
    """A figure with its interval, in other units."""
    low, high = (factor * end for end in ends)
    return Row(item, measure, None if value is None else factor * value, low, high, n)


def median(item: str, measure: str, q: Quantiles | None) -> Row:
    """A median with its 90th percentile."""
    return (
        Row(item, measure, None) if q is None else Row(item, measure, q.p50, None, q.p90, q.count)
    )


class Claim(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """One figure beside the paper's; ``part`` makes it and names its CSV file."""

    claim: str
    paper: str
    part: str
    item: str
    measure: str


class Topic(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A section of the page. Each of ``tables``: a part, the heading of its items, and the measure
    of every other heading. ``only``: items to show, instead of all."""

    title: str
    text: str
    claims: list[Claim] = []
    tables: list[tuple[str, str, dict[str, str]]] = []
    only: list[str] = []
    figure: str = ""
    lanes: bool = False  # with the table of what the nightly tests have written


class Kept:
    """What is stored of the results in a checkout: a CSV file a part, and run.json."""

    def __init__(self, root: Path) -> None:
        self.page, self.figures, self.folder = (
            root / "docs/results.md", root / "docs/figures", root / "studies/results"
        )  # fmt: skip
        for each in (self.figures, self.folder):
            each.mkdir(parents=True, exist_ok=True)

    def csv(self, part: str) -> Path:
        return self.folder / f"{part}.csv"

    def add(self, part: str, rows: Sequence[Row], more: Any, seconds: float) -> None:
        """Write a part: its rows, what its chart needs, and commit, date and duration."""
        out = io.StringIO()
        lines = csv.writer(out, lineterminator="\n")
        lines.writerow(Row.__struct_fields__)
        for row in rows:
            values = msgspec.structs.astuple(row)
            lines.writerow(f"{v:.6g}" if isinstance(v, float) else v for v in values)
        write_whole(self.csv(part), out.getvalue().encode())
        if more is not None:
            write_whole(self.folder / f"{part}.json", msgspec.json.encode(more) + b"\n")
        done = {"commit": self._commit(), "date": f"{datetime.now(UTC):%Y-%m-%d}",
                "seconds": round(seconds)}  # fmt: skip
        every = json.dumps(self.done() | {part: done}, indent=1, sort_keys=True)
        write_whole(self.folder / "run.json", every.encode() + b"\n")

    def done(self) -> dict[str, Any]:
        """Commit, date and duration of every finished part."""
        path = self.folder / "run.json"
        found: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
        return found

    def rows(self, part: str) -> list[Row]:
        """Rows of a part; none of one that never ran."""
        return [
            msgspec.convert({k: v or None for k, v in line.items()}, Row, strict=False)
            for line in self.lines(part)
        ]

    def lines(self, part: str) -> list[dict[str, str]]:
        """Lines of a CSV file, also of one that a nightly test writes."""
        if not self.csv(part).exists():
            return []
        with self.csv(part).open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))

    def _commit(self) -> str:
        """Commit of the checkout, marked where more than results differ from it."""

        def git(*words: str) -> str:
            run = subprocess.run(("git", *words), cwd=ROOT, capture_output=True, text=True,
                                 check=False)  # fmt: skip
            return run.stdout.strip()

        ours = ("--", ".", ":!studies/results", ":!docs")
        changed = git("status", "--porcelain", "--untracked-files=no", *ours)
        return (git("rev-parse", "--short=10", "HEAD") or "unknown") + "-changed" * bool(changed)


def page(topics: Sequence[Topic], intro: str, kept: Kept) -> str:
    """The Markdown text."""
    done = list(kept.done().values())
    commits = ", ".join(f"`{commit}`" for commit in sorted({each["commit"] for each in done}))
    minutes = sum(each["seconds"] for each in done) / 60.0
    date = max((each["date"] for each in done), default="never")
    parts = ["# Results", f"Generated by `make results` on {date} at commit {commits}, in "
             f"{minutes:.0f} minutes.", intro.strip()]  # fmt: skip
    for topic in topics:
        parts += [f"## {topic.title}", topic.text.strip()]
        if made_by := [claim.part for claim in topic.claims] + [part for part, *_ in topic.tables]:
            parts.append(f"`{command(*dict.fromkeys(made_by))}`")
        if topic.claims:
            parts.append(claims_table(topic.claims, kept))
        parts += [table(kept, *each, only=topic.only) for each in topic.tables]
        if topic.lanes:
            parts.append(lanes_table())
        if (kept.figures / f"{topic.figure}.svg").exists():
            parts.append(f"![{topic.figure}](figures/{topic.figure}.svg)")
    return "\n\n".join(filter(None, parts)) + "\n"


def command(*parts: str) -> str:
    """Makes these parts again."""
    names = f'"{" ".join(parts)}"' if len(parts) > 1 else parts[0]
    return f"make results ONLY={names}" + " REAL=FILE" * ("benchmark" in parts)


def claims_table(claims: Sequence[Claim], kept: Kept) -> str:
    found = [
        next((r for r in kept.rows(c.part) if (r.item, r.measure) == (c.item, c.measure)),
             Row(c.item, c.measure, None)) for c in claims
    ]  # fmt: skip
    return markdown({
        "figure": [c.claim for c in claims],
        "paper": [c.paper for c in claims],
        "here": [number(row, row.value) for row in found],
        "interval": [spread(row) for row in found],
    })  # fmt: skip


def table(
    kept: Kept, part: str, heading: str, measures: dict[str, str], only: Sequence[str] = ()
) -> str:
    """One line per item, one column per measure. ``only``: items to show, instead of all."""
    rows = [row for row in kept.rows(part) if row.measure in measures.values()]
    items = [i for i in dict.fromkeys(row.item for row in rows) if not only or i in only]
    cells = {(r.item, r.measure): number(r, r.value) + (f" ({s})" if (s := spread(r)) else "")
             for r in rows}  # fmt: skip
    columns = {title: [cells.get((i, m), "") for i in items] for title, m in measures.items()}
    return markdown({heading: items} | columns) if items else "Not measured yet."


def lanes_table() -> str:
    """Sums over the CSV files that the nightly tests write in the checkout."""
    faults, mutants = (Kept(ROOT).lines(name) for name in ("faults", "mutants"))

    def total(lines: Sequence[dict[str, str]], name: str) -> int | str:
        return sum(int(line[name]) for line in lines) if lines else "not run"

    return markdown({
        "evidence": ["faults injected into simulated lifts", "changed lines of the safety code"],
        "cases": [total(faults, "runs"), total(mutants, "mutants")],
        "failed": [total(faults, "failures"), total(mutants, "survived")],
        "data": ["`studies/results/faults.csv`", "`studies/results/mutants.csv`"],
        "command": ["`make test-faults`", "`make test-mutation`"],
    })  # fmt: skip


def number(row: Row, value: float | None) -> str:
    """Per cent with one decimal, anything else with three significant digits."""
    if value is None:
        return "not given"
    if math.isinf(value):
        return "never"
    if row.measure.endswith("%"):
        return f"{value:.1f}"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def spread(row: Row) -> str:
    """The interval, or the 90th percentile."""
    if row.high is None:
        return ""
    high = number(row, row.high)
    return high if row.low is None else f"{number(row, row.low)}\N{EN DASH}{high}"


def charts(kept: Kept) -> None:
    """Draw the charts of the parts that are there."""
    scores, lifts, points = (
        kept.folder / f"{name}.json" for name in ("benchmark", "difficulty", "contact")
    )
    if scores.exists():
        chart = score_svg(read_scores(scores)[0])
        write_whole(kept.figures / "benchmark.svg", chart.encode())
    if points.exists():
        costs = msgspec.json.decode(points.read_bytes(), type=list[physics_levels.Row])
        _draw(physics_levels.chart, costs, kept.figures / "contact.svg", (11.0, 5.5))
    if lifts.exists():
        sweep = msgspec.json.decode(lifts.read_bytes(), type=list[difficulty_sweep.Row])
        _draw(difficulty_sweep.chart, sweep, kept.figures / "difficulty.svg", (16.0, 7.5))


def _draw(chart: Any, rows: Sequence[Any], out: Path, size: tuple[float, float]) -> None:
    nothing: Any = None
    draw(Study("", nothing, nothing, Row, nothing, chart, figure_size=size), rows, out)
